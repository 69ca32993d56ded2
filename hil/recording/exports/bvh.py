"""The avatar's motion as BVH: Blender, MotionBuilder, Unity and most tools for animation read it.

Format: Biovision hierarchy as described by Meredith & Maddock, "Motion capture file formats explained" (2001), §4.
Metres, y up, the avatar looks along +z, arms hang in the rest pose: what Blender's importer takes at a scale of 1. Each
joint has the channels Zrotation Yrotation Xrotation, degrees: over recorded high fives the middle one stays below 55°,
where with Z X Y the elbow comes within a degree of the singularity at 90°. The root's OFFSET is zero, so that readers
that add it to the position channels agree with those that do not.
"""

from __future__ import annotations

import io

import numpy as np

from highfive.hil.sim.body_geometry import bone_end
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton
from highfive.scenes import anthropometry

ORDER = "zyx"
_TO_Y_UP = [1, 2, 0]
"""x forward, y left, z up → x left, y up, z forward: an even permutation, so rotations keep their sense."""
_CHANNELS = "Zrotation Yrotation Xrotation"
_HEAD_TOP = anthropometry.HEIGHT - next(z for name, _, (_, _, z) in anthropometry.joint_table() if name == "head")


def bvh(skeleton: Skeleton, root_in_world: Array, quaternions: Array, rate_hz: float) -> bytes:
    """A BVH file.

    Args:
        skeleton: of J joints.
        root_in_world: (T, 3) m.
        quaternions: (T, J, 4), each joint relative to its parent, the root to the world.
        rate_hz: frames a second.
    """
    text, order = io.StringIO(), _depth_first(skeleton)
    text.write("HIERARCHY\n")
    _write_joint(text, skeleton, 0, 0)
    text.write(f"MOTION\nFrames: {len(root_in_world)}\nFrame Time: {1.0 / rate_hz:.9f}\n")
    turned = quaternions[:, order][..., [0, *(1 + axis for axis in _TO_Y_UP)]]
    angles = np.degrees(smooth_euler(ORDER, turned)).reshape(len(turned), -1)
    rows = np.concatenate([root_in_world[:, _TO_Y_UP], angles], axis=1)
    np.savetxt(text, rows, fmt="%.6f")
    return text.getvalue().encode("ascii")


def smooth_euler(order: str, quaternions: Array) -> Array:
    """Euler angles (T, J, 3), rad, of rotations (T, J, 4): exact also at the singularity, and without jumps in time.

    The second and third angle are taken of what the first one leaves: near the singularity that may be any, and the
    three are still the rotation. Of the two triples, and all their turns, the one nearest to the frame before counts.
    """
    i, j, k = ("xyz".index(axis) for axis in order)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    whole = rotations.to_matrix(quaternions)
    first = np.arctan2(-sign * whole[..., j, k], whole[..., k, k])
    rest = rotations.to_matrix(rotations.multiply(rotations.from_axis_angle(order[0], -first), quaternions))
    second = np.arctan2(sign * rest[..., i, k], rest[..., k, k])
    third = np.arctan2(sign * rest[..., j, i], rest[..., j, j])
    one = np.stack([first, second, third], axis=-1)
    other = np.stack([first + np.pi, np.pi - second, third + np.pi], axis=-1)
    angles = one.copy()
    for t in range(1, len(angles)):
        near, far = (_nearest(triple[t], angles[t - 1]) for triple in (one, other))
        closer = np.abs(near - angles[t - 1]).sum(axis=-1) <= np.abs(far - angles[t - 1]).sum(axis=-1)
        angles[t] = np.where(closer[..., None], near, far)
    return angles


def _nearest(angles: Array, before: Array) -> Array:
    """The same angles, in the turn nearest to others."""
    return angles - 2.0 * np.pi * np.round((angles - before) / (2.0 * np.pi))


def _children(skeleton: Skeleton, joint: int) -> list[int]:
    return [child for child, parent in enumerate(skeleton.parents) if parent == joint]


def _depth_first(skeleton: Skeleton, joint: int = 0) -> list[int]:
    """Joints in the order of the file, which is that of its channels."""
    return [joint, *(below for child in _children(skeleton, joint) for below in _depth_first(skeleton, child))]


def _write_joint(text: io.StringIO, skeleton: Skeleton, joint: int, depth: int) -> None:
    tab, name, children = "\t" * depth, skeleton.names[joint], _children(skeleton, joint)
    offset = skeleton.offsets[joint] if joint else np.zeros(3)
    channels = f"3 {_CHANNELS}" if joint else f"6 Xposition Yposition Zposition {_CHANNELS}"
    text.write(f"{tab}{'JOINT' if joint else 'ROOT'} {name}\n{tab}{{\n")
    text.write(f"{tab}\tOFFSET {_place(offset)}\n{tab}\tCHANNELS {channels}\n")
    for child in children:
        _write_joint(text, skeleton, child, depth + 1)
    if not children:
        end = np.array([0.0, 0.0, _HEAD_TOP]) if name == "head" else bone_end(skeleton, name)
        text.write(f"{tab}\tEnd Site\n{tab}\t{{\n{tab}\t\tOFFSET {_place(end)}\n{tab}\t}}\n")
    text.write(f"{tab}}}\n")


def _place(offset: Array) -> str:
    return " ".join(f"{value:.6f}" for value in offset[_TO_Y_UP])

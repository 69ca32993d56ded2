"""Closed-form inverse kinematics of an arm with a given palm pose, and of a leg with a given foot."""

from __future__ import annotations

import numpy as np

from highfive.hil.sim.avatar import PALM_IN_RIGHT_WRIST
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def _across(vector: Array, axis: Array) -> Array:
    """The part of ``vector`` (..., 3) at right angles to the unit vector ``axis`` (..., 3)."""
    return vector - axis * np.sum(axis * vector, axis=-1, keepdims=True)


def _two_link(start: Array, end: Array, first: float, second: float, pole: Array) -> Array:
    """Middle joint (..., 3) of two links from ``start`` to ``end``, bent towards ``pole``; stretched if too far."""
    line = end - start
    axis = _unit(line)
    distance = np.linalg.norm(line, axis=-1, keepdims=True)
    reach = np.clip(distance, abs(first - second) + 1e-6, first + second - 1e-6)
    along = (first**2 - second**2 + reach**2) / (2.0 * reach)
    return start + axis * along + _unit(_across(pole, axis)) * np.sqrt(np.maximum(first**2 - along**2, 0.0))


def _limb_frame(upper: Array, middle: Array, lower: Array, flexion_sign: float) -> Array:
    """Orientation (..., 4) of the upper segment: -z along it, y the axis about which the lower segment bends."""
    z = _unit(upper - middle)
    x = _unit(_across(flexion_sign * (lower - middle), z))
    return rotations.from_matrix(np.stack([x, rotations.cross(z, x), z], axis=-1))


def _flexion(parent: Array, segment: Array) -> Array:
    """Rotation (...) about y that turns the parent's -z onto ``segment`` (a world vector in the parent's x–z plane)."""
    local = rotations.rotate(rotations.conjugate(parent), segment)
    return np.arctan2(-local[..., 0], -local[..., 2])


def hand_orientation(normal: Array, fingers: Array) -> Array:
    """Orientation (4,) of the right hand whose palm faces ``normal`` and whose fingers point to ``fingers``."""
    y = _unit(normal)
    z = -_unit(_across(fingers, y))
    return rotations.from_matrix(np.stack([rotations.cross(y, z), y, z], axis=-1))


def solve_arm(
    skeleton: Skeleton, clavicle: tuple[Array, Array], palm: Array, normal: Array, fingers: Array, elbow_out: float
) -> Array:
    """Hinge angles (3, 3), rad, of right shoulder, elbow and wrist for a palm pose.

    Args:
        skeleton: the body, scaled or not.
        clavicle: position (3,) m and orientation (4,) of the right clavicle joint in the world.
        palm: (3,) m, centre of the palm's surface.
        normal: (3,) unit vector out of the palm.
        fingers: (3,) unit vector to the fingers.
        elbow_out: swivel of the elbow from straight down, outwards, rad.

    A palm out of reach is answered with a stretched arm that points to it.
    """
    shoulder_offset, upper, fore = (
        skeleton.offsets[skeleton.index(f"right_{n}")] for n in ("shoulder", "elbow", "wrist")
    )
    knuckles = skeleton.offsets[skeleton.index("right_middle_1")]
    position, orientation = clavicle
    shoulder = position + rotations.rotate(orientation, shoulder_offset)
    hand = hand_orientation(normal, fingers)
    wrist = palm - rotations.rotate(hand, PALM_IN_RIGHT_WRIST * np.linalg.norm(knuckles) / _KNUCKLE_DISTANCE)
    axis = _unit(wrist - shoulder)
    down = _unit(_across(np.array([0.0, 0.0, -1.0]), axis))
    side = rotations.cross(axis, down)
    side = side if side @ rotations.rotate(orientation, [0.0, -1.0, 0.0]) > 0 else -side
    pole = np.cos(elbow_out) * down + np.sin(elbow_out) * side
    length, fore_length = np.linalg.norm(upper), np.linalg.norm(fore)
    elbow = _two_link(shoulder, wrist, float(length), float(fore_length), pole)
    upper_arm = _limb_frame(shoulder, elbow, wrist, 1.0)
    flexion = _flexion(upper_arm, wrist - elbow)
    forearm = rotations.multiply(upper_arm, rotations.from_axis_angle("y", flexion))
    twist, bend, deviation = rotations.to_euler("zxy", rotations.multiply(rotations.conjugate(forearm), hand))
    shoulder_angles = rotations.to_euler("yxz", rotations.multiply(rotations.conjugate(orientation), upper_arm))
    if shoulder_angles[0] > np.radians(120.0):  # the same direction, counted through raising the arm
        shoulder_angles[0] -= 2.0 * np.pi
    return np.array([shoulder_angles, [flexion, 0.0, twist], [bend, deviation, 0.0]])


def solve_leg(skeleton: Skeleton, side: str, pelvis: tuple[Array, Array], ankle: Array) -> Array:
    """Hinge angles (..., 3, 3), rad, of hip, knee and ankle of ``side`` with the foot flat and its ankle at ``ankle``.

    ``pelvis`` is its position (..., 3) m and orientation (..., 4) in the world; the foot points along +x.
    """
    hip_offset, thigh, shank = (skeleton.offsets[skeleton.index(f"{side}_{n}")] for n in ("hip", "knee", "ankle"))
    position, orientation = pelvis
    hip = position + rotations.rotate(orientation, hip_offset)
    pole = np.array([1.0, 0.0, 0.0])
    knee = _two_link(hip, ankle, float(np.linalg.norm(thigh)), float(np.linalg.norm(shank)), pole)
    upper_leg = _limb_frame(hip, knee, ankle, -1.0)
    # The shank's offset leans a little in the zero pose; the flexion is measured from there.
    flexion = _flexion(upper_leg, ankle - knee) - np.arctan2(-shank[0], -shank[2])
    lower_leg = rotations.multiply(upper_leg, rotations.from_axis_angle("y", flexion))
    angles = np.zeros((*position.shape[:-1], 3, 3))
    angles[..., 0, :] = rotations.to_euler("yxz", rotations.multiply(rotations.conjugate(orientation), upper_leg))
    angles[..., 1, 0] = flexion
    angles[..., 2, :] = rotations.to_euler("yxz", rotations.conjugate(lower_leg))
    return angles


_KNUCKLE_DISTANCE = float(np.linalg.norm([0.004, 0.098]))

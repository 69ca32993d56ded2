"""The avatar's bodies, hinges, contact shapes and masses, added to a MuJoCo specification."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from highfive.hil.sim.avatar import PALM_IN_RIGHT_WRIST
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton
from highfive.scenes import anthropometry, body_shapes

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
ROOT_JOINTS = ("root_x", "root_y", "root_z")
SHAPE_GROUP = 3
"""Geom group of the contact shapes: the viewer hides it until requested."""


@dataclass(frozen=True)
class Shape:
    """A contact shape in the frame of its joint.

    Attributes:
        centre: (3,) m.
        half_axes: (3,) m of an ellipsoid; None for a capsule.
        end: (3,) m, far end of a capsule that starts at the joint's centre; zero for an ellipsoid.
        radius: m, of a capsule; zero for an ellipsoid.
    """

    centre: Array
    half_axes: Array | None
    end: Array
    radius: float

    @property
    def volume(self) -> float:
        """Volume of the shape, m³."""
        if self.half_axes is not None:
            return 4.0 / 3.0 * np.pi * float(np.prod(self.half_axes))
        length = float(np.linalg.norm(self.end))
        return np.pi * self.radius**2 * (length + 4.0 / 3.0 * self.radius)


def split_side(joint: str) -> tuple[float, str]:
    """Sign of y (left +1, right -1, trunk +1) and the joint's name without its side."""
    side, _, name = joint.partition("_")
    if side in ("left", "right"):
        return (1.0 if side == "left" else -1.0), name
    return 1.0, joint


def is_finger(joint: str) -> bool:
    """True for the 30 joints of the fingers."""
    return split_side(joint)[1].partition("_")[0] in anthropometry.FINGER_NAMES


def bone_end(skeleton: Skeleton, joint: str) -> Array:
    """(3,) m, far end of a joint's bone in its own frame: the next joint of the chain, or the tip."""
    index = skeleton.index(joint)
    children = [i for i, parent in enumerate(skeleton.parents) if parent == index]
    if children:
        return skeleton.offsets[children[0]]
    _, name = split_side(joint)
    if name == "toe":
        return np.array([body_shapes.TOE_LENGTH, 0.0, 0.0])
    along = skeleton.offsets[index] / np.linalg.norm(skeleton.offsets[index])
    return along * anthropometry.FINGER_TIP_LENGTH[name.partition("_")[0]]


def shape_of(skeleton: Skeleton, joint: str) -> Shape:
    """The contact shape that a joint carries."""
    sign, name = split_side(joint)
    if name in body_shapes.ELLIPSOIDS:
        centre, half_axes = body_shapes.ELLIPSOIDS[name]
        return Shape(np.array(centre) * [1.0, sign, 1.0], np.array(half_axes), np.zeros(3), 0.0)
    end = bone_end(skeleton, joint)
    return Shape(0.5 * end, None, end, body_shapes.CAPSULE_RADIUS[name])


def segment_masses(skeleton: Skeleton) -> dict[str, float]:
    """Mass, kg, of the body of each joint; fingers by volume, out of the mass of their hand."""
    masses: dict[str, float] = {}
    for joint in skeleton.names:
        if is_finger(joint):
            masses[joint] = body_shapes.TISSUE_DENSITY * shape_of(skeleton, joint).volume
        else:
            masses[joint] = anthropometry.MASS * anthropometry.SEGMENT_MASS_FRACTION[split_side(joint)[1]]
    for side in ("left", "right"):
        fingers = sum(m for j, m in masses.items() if is_finger(j) and j.startswith(side))
        masses[f"{side}_wrist"] -= fingers
    return masses


def shape_name(joint: str) -> str:
    """Name of the contact geom of a joint; the hand's is the palm."""
    return joint.replace("_wrist", "_palm") if joint.endswith("_wrist") else joint


def add_shape(body: mujoco.MjsBody, name: str, shape: Shape, mass: float) -> None:
    """Adds a contact shape to ``body``; it collides through explicit pairs only."""
    geom = body.add_geom(name=name, mass=mass, contype=0, conaffinity=0, group=SHAPE_GROUP, rgba=[0.9, 0.6, 0.4, 0.5])
    if shape.half_axes is not None:
        geom.type, geom.size, geom.pos = mujoco.mjtGeom.mjGEOM_ELLIPSOID, shape.half_axes, shape.centre
    else:
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_CAPSULE, [shape.radius, 0.0, 0.0]
        geom.fromto = np.concatenate([np.zeros(3), shape.end])


def add_palm_site(hand: mujoco.MjsBody, name: str, side: str) -> None:
    """Adds the frame of a palm to a hand: origin on the palm's surface, x along the fingers, z out of the palm."""
    sign = 1.0 if side == "right" else -1.0
    site = hand.add_site(name=name, pos=PALM_IN_RIGHT_WRIST * [1.0, sign, 1.0])
    site.quat = rotations.frame_from([0.0, 0.0, -1.0], [0.0, sign, 0.0])
    site.size, site.group = [0.005] * 3, SHAPE_GROUP


def add_avatar(spec: mujoco.MjSpec, skeleton: Skeleton) -> dict[str, mujoco.MjsBody]:
    """Adds the avatar to ``spec`` and returns its 53 bodies of three hinges, with contact shapes and palm sites.

    The root has three slides rather than a free joint: the pelvis's own hinges already carry its orientation.
    """
    masses = segment_masses(skeleton)
    bodies: dict[str, mujoco.MjsBody] = {}
    for i, joint in enumerate(skeleton.names):
        parent = spec.worldbody if skeleton.parents[i] < 0 else bodies[skeleton.names[skeleton.parents[i]]]
        root = skeleton.parents[i] < 0
        body = parent.add_body(name=joint, pos=np.zeros(3) if root else skeleton.offsets[i], gravcomp=1.0)
        if root:
            for name in ROOT_JOINTS:
                body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=AXES[name[-1]], damping=1.0)
        armature = 2e-4 if is_finger(joint) else 5e-3
        for axis, (low, high) in zip(skeleton.hinge_orders[i], skeleton.hinge_limits[i], strict=True):
            hinge = body.add_joint(name=f"{joint}_{axis}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=AXES[axis])
            hinge.limited, hinge.range, hinge.armature = mujoco.mjtLimited.mjLIMITED_TRUE, [low, high], armature
        add_shape(body, shape_name(joint), shape_of(skeleton, joint), masses[joint])
        bodies[joint] = body
    for side in ("right", "left"):
        add_palm_site(bodies[f"{side}_wrist"], f"{side}_palm", side)
    return bodies

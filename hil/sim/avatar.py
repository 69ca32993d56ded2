"""The avatar's skeleton, made from the constants in ``scenes``, and its pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from jaxtyping import Float

from highfive.model.geometry import rotations
from highfive.model.geometry.arm_chain import ArmChain, arm_chain
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton, skeleton_from_table
from highfive.scenes import anthropometry


@cache
def avatar_skeleton() -> Skeleton:
    """The 53-joint avatar (23 body joints, then 30 finger joints) of standing height 1.75 m."""
    table = anthropometry.joint_table()
    hinges = {name: anthropometry.hinge_range(name) for name, _, _ in table}
    return skeleton_from_table(table, hinges, anthropometry.REST_DEGREES)


@cache
def avatar_arm() -> ArmChain:
    """The joints that carry the avatar's right palm."""
    return arm_chain(avatar_skeleton(), PALM_IN_RIGHT_WRIST)


@dataclass(frozen=True)
class Pose:
    """A pose of the avatar, as hinge angles: what the joint limits, the actuators and the correction are about.

    Attributes:
        root_in_world: (3,) m, centre of the pelvis.
        hinges: (53, 3) rad, angles of each joint's hinges in their order; the pelvis' are relative to the world.
    """

    root_in_world: Float[np.ndarray, "3"]
    hinges: Float[np.ndarray, "53 3"]

    @classmethod
    def from_quaternions(cls, root_in_world: Array, quaternions: Array) -> Pose:
        """The pose with joint rotations (53, 4), each relative to its parent, the pelvis relative to the world."""
        return cls(root_in_world, avatar_skeleton().to_hinges(quaternions))

    @cached_property
    def quaternions(self) -> Array:
        """(53, 4), rotation of each joint relative to its parent; the pelvis relative to the world."""
        return avatar_skeleton().from_hinges(self.hinges)


PALM_IN_RIGHT_WRIST = np.array([0.0, 0.5 * anthropometry.PALM_THICKNESS, -anthropometry.PALM_CENTRE])
"""(3,) m, centre of the right palm's surface in the frame of ``right_wrist``; normal +y, fingers to -z."""


def right_palm(skeleton: Skeleton, positions: Array, orientations: Array) -> tuple[Array, Array, Array]:
    """Centre (..., 3), normal (..., 3) and finger direction (..., 3) of the right palm in the world.

    Args:
        skeleton: the avatar's skeleton, scaled or not; the palm scales with its hand.
        positions: (..., J, 3) m, from :meth:`Skeleton.forward_kinematics`.
        orientations: (..., J, 4), likewise.
    """
    wrist, knuckle = skeleton.index("right_wrist"), skeleton.index("right_middle_1")
    scale = np.linalg.norm(skeleton.offsets[knuckle]) / np.linalg.norm(avatar_skeleton().offsets[knuckle])
    hand = orientations[..., wrist, :]
    centre = positions[..., wrist, :] + rotations.rotate(hand, scale * PALM_IN_RIGHT_WRIST)
    return centre, rotations.rotate(hand, [0.0, 1.0, 0.0]), rotations.rotate(hand, [0.0, 0.0, -1.0])


def between(one: Pose, other: Pose, share: float) -> Pose:
    """``share`` of the way from one pose to another, or beyond it as far as the joint limits go."""
    root = one.root_in_world + share * (other.root_in_world - one.root_in_world)
    return Pose(root, avatar_skeleton().hinges_between(one.hinges, other.hinges, share))

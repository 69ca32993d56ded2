"""The avatar's skeleton, made from the constants in ``scenes``, and its pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from model.rotations import Array
from model.skeleton import Skeleton, skeleton_from_table
from scenes import anthropometry


@cache
def avatar_skeleton() -> Skeleton:
    """The 53-joint avatar (23 body joints, then 30 finger joints) of standing height 1.75 m."""
    table = anthropometry.joint_table()
    hinges = {name: anthropometry.hinge_range(name) for name, _, _ in table}
    return skeleton_from_table(table, hinges, anthropometry.REST_DEGREES)


@dataclass(frozen=True)
class Pose:
    """A pose of the avatar.

    Attributes:
        root_in_world: (3,) m, centre of the pelvis.
        quaternions: (53, 4), rotation of each joint relative to its parent; the pelvis relative to the world.
    """

    root_in_world: Array
    quaternions: Array

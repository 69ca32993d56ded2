"""Forward kinematics of an arm: frames, plate, Jacobians."""

from __future__ import annotations

import math

import numpy as np

from highfive.hil.arm_model.arm import Arm
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array


@compiled
def link_frames(arm: Arm, joints: Array) -> tuple[Array, Array]:
    """Centre (J, 3) and axes (J, 3, 3), in columns, of every joint's frame after its own turn."""
    count = len(joints)
    centres, frames = np.empty((count, 3)), np.empty((count, 3, 3))
    for j in range(count):
        before = arm.base_axes if j == 0 else frames[j - 1]
        start = arm.base if j == 0 else centres[j - 1]
        for r in range(3):
            total = start[r]
            for c in range(3):
                total += before[r, c] * arm.offsets[j, c]
            centres[j, r] = total
        axis = int(arm.axes[j])
        one, two = (axis + 1) % 3, (axis + 2) % 3
        cosine, sine = math.cos(joints[j]), math.sin(joints[j])
        for r in range(3):
            frames[j, r, axis] = before[r, axis]
            frames[j, r, one] = cosine * before[r, one] + sine * before[r, two]
            frames[j, r, two] = cosine * before[r, two] - sine * before[r, one]
    return centres, frames


@compiled
def joint_axis(arm: Arm, frames: Array, joint: int) -> tuple[float, float, float]:
    """A joint's axis in the world."""
    axis = int(arm.axes[joint])
    return frames[joint, 0, axis], frames[joint, 1, axis], frames[joint, 2, axis]


@compiled
def point_jacobian(arm: Arm, centres: Array, frames: Array, link: int, point: Array, out: Array) -> None:
    """Writes the Jacobian (3, J) of a point (3,) of a link into ``out``."""
    for j in range(len(centres)):
        if j > link:
            out[0, j] = out[1, j] = out[2, j] = 0.0
            continue
        ax, ay, az = joint_axis(arm, frames, j)
        x, y, z = point[0] - centres[j, 0], point[1] - centres[j, 1], point[2] - centres[j, 2]
        out[0, j], out[1, j], out[2, j] = ay * z - az * y, az * x - ax * z, ax * y - ay * x


@compiled
def plate_of(arm: Arm, centres: Array, frames: Array) -> tuple[Array, Array]:
    """Centre and normal of the plate's surface, (3,) each."""
    point, normal = np.empty(3), np.empty(3)
    for r in range(3):
        normal[r] = frames[5, r, 0]
        point[r] = centres[5, r] + arm.plate * normal[r]
    return point, normal


@compiled
def plate_jacobian(arm: Arm, centres: Array, frames: Array, point: Array, normal: Array) -> tuple[Array, Array]:
    """Jacobians (3, J) of the plate's centre and normal."""
    of_point, of_normal = np.empty((3, 6)), np.empty((3, 6))
    point_jacobian(arm, centres, frames, 5, point, of_point)
    for j in range(6):
        ax, ay, az = joint_axis(arm, frames, j)
        x, y, z = normal[0], normal[1], normal[2]
        of_normal[0, j], of_normal[1, j], of_normal[2, j] = ay * z - az * y, az * x - ax * z, ax * y - ay * x
    return of_point, of_normal


@compiled_entry
def plate_pose(arm: Arm, joints: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Plate's centre (3,), m, normal (3,), direction of its fingers (3,), Jacobians (3, J) of centre and normal."""
    centres, frames = link_frames(arm, joints)
    point, normal = plate_of(arm, centres, frames)
    of_point, of_normal = plate_jacobian(arm, centres, frames, point, normal)
    return point, normal, frames[5, :, 2].copy(), of_point, of_normal


@compiled_entry
def joint_centres(arm: Arm, joints: Array) -> Array:
    """Centres of the joints, (J, 3) m."""
    return link_frames(arm, joints)[0]


@compiled_entry
def points_of_interest(arm: Arm, joints: Array) -> tuple[Array, Array]:
    """Plate, wrist, elbow and the outermost point of the tool's shaft: places (4, 3), m, and Jacobians (4, 3, J)."""
    centres, frames = link_frames(arm, joints)
    places, moves = np.empty((4, 3)), np.empty((4, 3, 6))
    places[0] = plate_of(arm, centres, frames)[0]
    places[1], places[2], places[3] = centres[4], centres[2], centres[5]
    point_jacobian(arm, centres, frames, 5, places[0], moves[0])
    point_jacobian(arm, centres, frames, 3, places[1], moves[1])
    point_jacobian(arm, centres, frames, 1, places[2], moves[2])
    point_jacobian(arm, centres, frames, 4, places[3], moves[3])
    return places, moves

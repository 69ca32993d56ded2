"""Forward kinematics of an arm: frames, plate, Jacobians."""

from __future__ import annotations

import math

import numpy as np

from highfive.hil.arm_model.arm import Arm
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array


@compiled
def link_frames(arm: Arm, joints: Array) -> tuple[Array, Array]:
    """Centre (J, 3) of every joint, and its frame after its own turn (J, 3, 4): three axes in columns, then what the
    joint turns about.
    """
    count = len(arm.joints)
    centres, frames = np.empty((count, 3)), np.empty((count, 3, 4))
    for j in range(count):
        before = arm.base_axes if j == 0 else frames[j - 1]
        start = arm.base if j == 0 else centres[j - 1]
        for r in range(3):
            total = start[r]
            for c in range(3):
                total += before[r, c] * arm.offsets[j, c]
            centres[j, r] = total
        x, y, z = arm.axes[j, 0], arm.axes[j, 1], arm.axes[j, 2]
        cosine, sine = math.cos(joints[j]), math.sin(joints[j])
        for r in range(3):  # Rodrigues' rotation of a row
            a, b, c = before[r, 0], before[r, 1], before[r, 2]
            along = a * x + b * y + c * z
            kept = (1.0 - cosine) * along
            frames[j, r, 0] = cosine * a + sine * (b * z - c * y) + kept * x
            frames[j, r, 1] = cosine * b + sine * (c * x - a * z) + kept * y
            frames[j, r, 2] = cosine * c + sine * (a * y - b * x) + kept * z
            frames[j, r, 3] = along
    return centres, frames


@compiled
def joint_axis(frames: Array, joint: int) -> tuple[float, float, float]:
    """A joint's axis in the world."""
    return frames[joint, 0, 3], frames[joint, 1, 3], frames[joint, 2, 3]


@compiled
def point_jacobian(arm: Arm, centres: Array, frames: Array, link: int, point: Array, out: Array) -> None:
    """Writes the Jacobian (3, J) of a point (3,) of a link into ``out``."""
    for j in range(len(arm.joints)):
        if j > link:
            out[0, j] = out[1, j] = out[2, j] = 0.0
            continue
        ax, ay, az = joint_axis(frames, j)
        x, y, z = point[0] - centres[j, 0], point[1] - centres[j, 1], point[2] - centres[j, 2]
        out[0, j], out[1, j], out[2, j] = ay * z - az * y, az * x - ax * z, ax * y - ay * x


@compiled
def plate_of(arm: Arm, centres: Array, frames: Array) -> tuple[Array, Array]:
    """Centre and normal of the plate's surface, (3,) each."""
    point, normal, last = np.empty(3), np.empty(3), len(arm.joints) - 1
    for r in range(3):
        normal[r], point[r] = 0.0, centres[last, r]
        for c in range(3):
            normal[r] += frames[last, r, c] * arm.normal[c]
            point[r] += frames[last, r, c] * arm.plate[c]
    return point, normal


@compiled
def plate_jacobian(arm: Arm, centres: Array, frames: Array, point: Array, normal: Array) -> tuple[Array, Array]:
    """Jacobians (3, J) of the plate's centre and normal."""
    count = len(arm.joints)
    of_point, of_normal = np.empty((3, count)), np.empty((3, count))
    point_jacobian(arm, centres, frames, count - 1, point, of_point)
    for j in range(count):
        ax, ay, az = joint_axis(frames, j)
        x, y, z = normal[0], normal[1], normal[2]
        of_normal[0, j], of_normal[1, j], of_normal[2, j] = ay * z - az * y, az * x - ax * z, ax * y - ay * x
    return of_point, of_normal


@compiled_entry
def plate_pose(arm: Arm, joints: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Plate's centre (3,), m, normal (3,), direction of its fingers (3,), Jacobians (3, J) of centre and normal."""
    centres, frames = link_frames(arm, joints)
    point, normal = plate_of(arm, centres, frames)
    of_point, of_normal = plate_jacobian(arm, centres, frames, point, normal)
    fingers = np.zeros(3)
    for r in range(3):
        for c in range(3):
            fingers[r] += frames[-1, r, c] * arm.fingers[c]
    return point, normal, fingers, of_point, of_normal


@compiled_entry
def joint_centres(arm: Arm, joints: Array) -> Array:
    """Centres of the joints, (J, 3) m."""
    return link_frames(arm, joints)[0]


@compiled_entry
def points_of_interest(arm: Arm, joints: Array) -> tuple[Array, Array]:
    """Plate, and centres of the joints that may meet a person: places (P + 1, 3), m, and Jacobians (P + 1, 3, J)."""
    centres, frames = link_frames(arm, joints)
    count, points = len(arm.joints), len(arm.met) + 1
    places, moves = np.empty((points, 3)), np.empty((points, 3, count))
    places[0] = plate_of(arm, centres, frames)[0]
    point_jacobian(arm, centres, frames, count - 1, places[0], moves[0])
    for p in range(1, points):
        joint = int(arm.met[p - 1])
        places[p] = centres[joint]
        point_jacobian(arm, centres, frames, joint - 1, places[p], moves[p])
    return places, moves

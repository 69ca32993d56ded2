"""What a plan costs, with first and second derivatives."""

from __future__ import annotations

import math

import numpy as np

from highfive.hil.arm.planner_settings import WEIGHTS
from highfive.hil.arm.planning_task import Aim
from highfive.hil.arm_model.arm import Arm
from highfive.hil.arm_model.distances import along, arm_gaps
from highfive.hil.arm_model.dynamics import available_torque, friction_torque, joint_torques, mass_matrix
from highfive.hil.arm_model.kinematics import plate_jacobian, plate_of
from highfive.model.compiled import compiled
from highfive.model.geometry.rotations import Array


@compiled
def _add_square(arm: Arm, weight: float, error: float, slope: Array, gradient: Array, matrix: Array) -> None:
    """Adds weight × error² / 2 of an error with derivative ``slope`` (J,)."""
    for i in range(len(arm.joints)):
        gradient[i] += weight * error * slope[i]
        for j in range(len(arm.joints)):
            matrix[i, j] += weight * slope[i] * slope[j]


@compiled
def state_cost(  # noqa: PLR0912, PLR0915 (a kernel)
    arm: Arm, aim: Aim, knot: int, centres: Array, frames: Array, joints: Array, speeds: Array, derivatives: bool,
    by_joints: Array, by_speeds: Array, joints_twice: Array, speeds_twice: Array,
) -> float:  # fmt: skip
    """Cost of being there at a knot; with ``derivatives`` also its gradients (J,) and Gauss–Newton matrices (J, J)."""
    cost, s, count = 0.0, aim.task.plan, len(arm.joints)
    point, normal = plate_of(arm, centres, frames)
    of_point, of_normal = plate_jacobian(arm, centres, frames, point, normal)
    weights = aim.point_weights[knot]
    for r in range(3):
        pulled = 0.0
        for c in range(3):
            pulled += weights[r, c] * (point[c] - aim.points[knot, c])
        cost += 0.5 * pulled * (point[r] - aim.points[knot, r])
        if derivatives:
            for j in range(count):
                by_joints[j] += of_point[r, j] * pulled
                weighed = (
                    weights[r, 0] * of_point[0, j] + weights[r, 1] * of_point[1, j] + weights[r, 2] * of_point[2, j]
                )
                for i in range(count):
                    joints_twice[i, j] += of_point[r, i] * weighed
    weight = aim.normal_weights[knot]
    if weight > 0.0:
        for r in range(3):
            error = normal[r] - aim.normals[knot, r]
            cost += 0.5 * weight * error**2
            if derivatives:
                _add_square(arm, weight, error, of_normal[r], by_joints, joints_twice)
    plate, line, apart, towards, fleeing = np.empty(3), np.empty(3), 0.0, 0.0, 0.0
    for r in range(3):
        speed = 0.0
        for j in range(count):
            speed += of_point[r, j] * speeds[j]
        plate[r], line[r] = speed, aim.hands[knot, r] - point[r]
        apart += line[r] ** 2
        weight = aim.velocity_weights[knot]
        if weight > 0.0:
            error = speed - aim.velocities[knot, r]
            cost += 0.5 * weight * error**2
            if derivatives:
                _add_square(arm, weight, error, of_point[r], by_speeds, speeds_twice)
    if aim.caps[knot] < math.inf:
        apart = math.sqrt(apart)
        for r in range(3):
            line[r] = line[r] / apart if apart > s.touching else aim.normals[knot, r]
            towards += line[r] * plate[r]
            fleeing += line[r] * aim.hand_velocities[knot, r]
        there = max(0.0, aim.caps[knot] + fleeing)  # a hand that is faster by itself is not run away from
        room = 4.0 * WEIGHTS.cap_braking * max(0.0, apart - s.cap_distance)
        over = towards - 0.5 * (there + fleeing + math.sqrt((there - fleeing) ** 2 + room))
        if over > 0.0:
            cost += 0.5 * WEIGHTS.cap_weight * over**2
            if derivatives:
                faster = np.empty(count)
                along(arm, line, of_point, faster)
                _add_square(arm, WEIGHTS.cap_weight, over, faster, by_speeds, speeds_twice)
    if aim.task.head[3] > 0.0:
        for r in range(3):
            line[r] = aim.task.head[r] - point[r]
        over, fast = _over_near_face(aim.task.face, s.face_border, line, plate)
        if over > 0.0:
            cost += 0.5 * WEIGHTS.cap_weight * over**2
            if derivatives:
                faster = np.empty(count)
                for r in range(3):
                    plate[r] /= fast
                along(arm, plate, of_point, faster)
                _add_square(arm, WEIGHTS.cap_weight, over, faster, by_speeds, speeds_twice)
    for j in range(count):
        away = aim.task.rest_weight * (joints[j] - aim.task.rest[j])
        cost += 0.5 * away * (joints[j] - aim.task.rest[j])
        beyond = max(0.0, joints[j] - arm.high[j] + s.stop_margin) - max(0.0, arm.low[j] + s.stop_margin - joints[j])
        top = s.speed_fraction * arm.speeds[j]
        fast = max(0.0, speeds[j] - top) - max(0.0, -top - speeds[j])
        cost += 0.5 * (
            WEIGHTS.stop_weight * beyond**2 + WEIGHTS.speed_weight * fast**2 + aim.task.calm * speeds[j] ** 2
        )
        if derivatives:
            by_joints[j] += away + WEIGHTS.stop_weight * beyond
            by_speeds[j] += WEIGHTS.speed_weight * fast + aim.task.calm * speeds[j]
            joints_twice[j, j] += aim.task.rest_weight + (WEIGHTS.stop_weight if beyond != 0.0 else 0.0)
            speeds_twice[j, j] += aim.task.calm + (WEIGHTS.speed_weight if fast != 0.0 else 0.0)
    gaps, wider = np.empty((len(arm.balls), 4)), np.empty((len(arm.balls) if derivatives else 0, 4, count))
    arm_gaps(arm, centres, frames, aim.task.head, s.gap_margin, gaps, wider, derivatives)
    for b in range(len(gaps)):
        for kind in range(4):
            if gaps[b, kind] < s.gap_margin:
                error = gaps[b, kind] - s.gap_margin
                cost += 0.5 * WEIGHTS.gap_weight * error**2
                if derivatives:
                    _add_square(arm, WEIGHTS.gap_weight, error, wider[b, kind], by_joints, joints_twice)
    return cost


@compiled
def _over_near_face(face: Array, border: float, line: Array, plate: Array) -> tuple[float, float]:
    """m/s by which a plate of velocity ``plate`` (3,) is too fast for a head ``line`` (3,) m away; and its speed.

    As :func:`highfive.hil.safety.people.face_zone_fraction` has it, for a head at rest.
    """
    away = fast = along = 0.0
    for r in range(3):
        away += line[r] ** 2
        fast += plate[r] ** 2
        along += line[r] * plate[r]
    away, fast = math.sqrt(away), math.sqrt(fast)
    way = max(0.0, away - face[1])
    straight = max(along / max(away * fast, 1e-9), 1.0 - way / border)
    if straight <= 1e-3 or fast <= face[0]:
        return 0.0, fast
    there = straight * face[0]
    return fast - 0.5 * (there + math.sqrt(there**2 + 4.0 * straight * face[2] * way)) / straight, fast


@compiled
def acceleration_cost(
    arm: Arm, effort: float, weight: float, centres: Array, frames: Array, speeds: Array, acceleration: Array,
    derivatives: bool, by_acceleration: Array, by_speeds: Array, acceleration_twice: Array, cross: Array,
    speeds_twice: Array,
) -> float:  # fmt: skip
    """Cost of an ``acceleration`` (J,), rad/s²: effort, and torque beyond the torque–speed line times ``weight``."""
    count = len(arm.joints)
    cost, torques, weighed = 0.0, np.empty(count), False
    joint_torques(arm, centres, frames, speeds, acceleration, torques)
    mass = np.empty((0, 0))
    for j in range(count):
        cost += 0.5 * effort * acceleration[j] ** 2
        torque = torques[j] + friction_torque(arm, j, speeds[j])
        sign = 1.0 if torque > 0.0 else -1.0
        over = sign * torque - available_torque(arm, j, speeds[j], sign)
        if over > 0.0:
            cost += 0.5 * weight * over**2
        if not derivatives:
            continue
        by_acceleration[j] += effort * acceleration[j]
        acceleration_twice[j, j] += effort
        if over > 0.0:
            if not weighed:
                mass, weighed = mass_matrix(arm, centres, frames), True
            slower = sign * arm.stall[j] / arm.no_load[j]  # strength lost by a faster joint
            by_speeds[j] += weight * over * slower
            speeds_twice[j, j] += weight * slower**2
            for i in range(count):
                by_acceleration[i] += weight * over * sign * mass[j, i]
                cross[i, j] += weight * sign * mass[j, i] * slower
                for k in range(count):
                    acceleration_twice[i, k] += weight * mass[j, i] * mass[j, k]
    return cost

"""Joint positions that bring the plate to a place, by damped least squares."""

from __future__ import annotations

import math

import numpy as np

from highfive.hil.arm_model.arm import Arm
from highfive.hil.arm_model.kinematics import link_frames, plate_jacobian, plate_of
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.linear_algebra import cholesky, cholesky_solve


@compiled
def pose_error(arm: Arm, joints: Array, position: Array, normal: Array, residual: Array, jacobian: Array) -> float:
    """Squared miss of the plate; writes residual (6,) and Jacobian (6, J)."""
    centres, frames = link_frames(arm, joints)
    point, out = plate_of(arm, centres, frames)
    of_point, of_normal = plate_jacobian(arm, centres, frames, point, out)
    total = 0.0
    for r in range(3):
        residual[r], residual[3 + r] = point[r] - position[r], arm.facing * (out[r] - normal[r])
        total += residual[r] ** 2 + residual[3 + r] ** 2
        for j in range(len(arm.joints)):
            jacobian[r, j], jacobian[3 + r, j] = of_point[r, j], arm.facing * of_normal[r, j]
    return total


@compiled_entry
def posture(arm: Arm, position: Array, normal: Array, start: Array, steps: int) -> tuple[Array, float]:
    """Joints (J,) near ``start`` that put the plate there, and what is left (m, with the normal's turn as metres).

    Levenberg's damped Gauss–Newton steps, cut at the limits.
    """
    return posture_from(arm, position, normal, start, steps)


@compiled
def posture_from(arm: Arm, position: Array, normal: Array, start: Array, steps: int) -> tuple[Array, float]:
    """As :func:`posture`, for compiled callers."""
    joints, tried, damping = start.copy(), start.copy(), 1e-4
    count = len(arm.joints)
    residual, jacobian, left, ahead = np.empty(6), np.empty((6, count)), np.empty(6), np.empty((6, count))
    matrix, lower, step = np.empty((count, count)), np.zeros((count, count)), np.empty(count)
    cost = pose_error(arm, joints, position, normal, residual, jacobian)
    for _ in range(steps):
        for i in range(count):
            step[i] = 0.0
            for r in range(6):
                step[i] -= jacobian[r, i] * residual[r]
            for j in range(count):
                matrix[i, j] = damping if i == j else 0.0
                for r in range(6):
                    matrix[i, j] += jacobian[r, i] * jacobian[r, j]
        if not cholesky(matrix, lower):
            break
        cholesky_solve(lower, step)
        longest = 0.0
        for j in range(count):
            longest = max(longest, abs(step[j]))
        share = min(1.0, 0.5 / max(longest, 1e-9))
        for j in range(count):
            tried[j] = min(max(joints[j] + share * step[j], arm.low[j]), arm.high[j])
        now = pose_error(arm, tried, position, normal, left, ahead)
        if now < cost:
            cost, damping = now, max(0.2 * damping, 1e-9)
            joints, tried, residual, left, jacobian, ahead = tried, joints, left, residual, ahead, jacobian
        else:
            damping *= 10.0
        if cost < 1e-12 or damping > 1e4:
            break
    return joints, math.sqrt(cost)

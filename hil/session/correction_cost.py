"""What the contact correction minimises, but for the own body, and the bounds of its steps: compiled for one pose.

Eighteen hinges take NumPy and MuJoCo's general Jacobian several times as long as the kinematics that they follow.
"""

from __future__ import annotations

import numpy as np

from highfive.hil.sim.scene import Indices
from highfive.model.compiled import compiled_entry
from highfive.model.geometry.rotations import Array


@compiled_entry
def palm_and_posture(
    palm: tuple[Array, Array], hinges: tuple[Array, Array, Indices], target: tuple[Array, Array, float, float],
    posture: tuple[Array, Array], gradient: Array, hessian: Array,
) -> float:  # fmt: skip
    """The cost; writes half its gradient (K,) and half its Gauss–Newton second derivatives (K, K).

    Args:
        palm: its place (3,), m, and its frame (9,), row by row, whose z axis is the palm's normal.
        hinges: anchors (J, 3), m, and axes (J, 3) of all hinges, and which K of them lead to the palm.
        target: place (3,), m, and normal (3,), and the weights of both, 1/m and 1/rad; 0 for no target.
        posture: (K,) rad, how far the hinges are from where the posture wants them, and their weights (K,), 1/rad².
        gradient, hessian: to write into.
    """
    place, frame = palm
    anchors, axes, joints = hinges
    position, normal, placed, turned = target
    moved, pull = posture
    count, cost = len(moved), 0.0
    for k in range(count):
        gradient[k] = pull[k] * moved[k]
        cost += gradient[k] * moved[k]
        for m in range(count):
            hessian[k, m] = pull[k] if m == k else 0.0
    if placed == 0.0 and turned == 0.0:
        return cost
    residual, jacobian = np.empty(6), np.empty((count, 6))
    for i in range(3):
        residual[i] = placed * (place[i] - position[i])
        residual[3 + i] = turned * (frame[3 * i + 2] - normal[i])
    for i in range(6):
        cost += residual[i] * residual[i]
    u, v, w = turned * frame[2], turned * frame[5], turned * frame[8]
    for k in range(count):
        # What turns about an axis moves with axis x lever, a direction with axis x direction.
        a, b, c = axes[joints[k]]
        x, y, z = placed * (place - anchors[joints[k]])
        jacobian[k, 0], jacobian[k, 1], jacobian[k, 2] = b * z - c * y, c * x - a * z, a * y - b * x
        jacobian[k, 3], jacobian[k, 4], jacobian[k, 5] = b * w - c * v, c * u - a * w, a * v - b * u
        for i in range(6):
            gradient[k] += jacobian[k, i] * residual[i]
        for m in range(k + 1):
            both = 0.0
            for i in range(6):
                both += jacobian[k, i] * jacobian[m, i]
            hessian[k, m] += both
            if m < k:
                hessian[m, k] += both
    return cost


@compiled_entry
def bounded(
    angles: Array, limits: tuple[Array, Array], longest: float, damping: float, damped: Array, box: tuple[Array, Array]
) -> None:
    """Adds ``damping`` to the diagonal of ``damped`` (K, K); writes the bounds of a step from ``angles`` (K,), rad,
    that keeps to the ``limits`` and is nowhere longer than ``longest``, into ``box``."""
    for k in range(len(angles)):
        damped[k, k] += damping
        box[0][k] = max(limits[0][k] - angles[k], -longest)
        box[1][k] = min(limits[1][k] - angles[k], longest)

"""In which order postures are visited: the shortest tour that was found, on ways that are free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from highfive.calibration.pose_file import TakenPose
from highfive.hil.arm.free_postures import POSTURES, way_is_free
from highfive.hil.arm.posture_drive import way_seconds
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.model.geometry.rotations import Array

BLOCKED = 1e6
"""s: no way."""


def route(arm: ServoArm, postures: Array, before: Sequence[TakenPose] = ()) -> list[Array]:
    """Through postures (N, J), rad, but for those that were taken ``before``: from where the arm waits, and back there.

    Takes seconds: it is worked out before the arm is switched on.
    """
    new = [q for q in postures if not any(np.allclose(q, pose.asked, atol=1e-6) for pose in before)]
    return tour(arm, arm.ready, np.array(new).reshape(-1, arm.joints), POSTURES.clearance, partial(way_seconds, arm))


def tour(
    arm: ServoArm, home: Array, postures: Array, clearance: float, seconds: Callable[[Array, Array], float]
) -> list[Array]:
    """Postures (J,), rad, from ``home`` through all that a free way leads back from, and home again.

    Where the straight way between two is not free it goes by way of ``home``. Nearest first, then pieces are turned
    round while that is shorter (2-opt).

    Args:
        arm: as drawn.
        home: (J,) rad, where it begins and ends.
        postures: (N, J) rad.
        clearance: m, that has to be kept on the way.
        seconds: that a way takes.
    """
    stops = [home, *(q for q in postures if way_is_free(arm, q, home, clearance))]
    direct = np.array([[seconds(a, b) if way_is_free(arm, a, b, clearance) else BLOCKED for b in stops] for a in stops])
    via = np.minimum(direct, direct[:, :1] + direct[:1, :])
    order, left = [0], set(range(1, len(stops)))
    while left:
        order.append(min(left, key=lambda n: via[order[-1], n]))
        left.remove(order[-1])
    order = _untangled([*order, 0], via)
    stages: list[Array] = []
    for before, after in pairwise(order):
        if direct[before, after] > via[before, after]:
            stages.append(home)
        stages.append(stops[after])
    return stages


def _untangled(order: list[int], times: Array) -> list[int]:
    better = True
    while better:
        better = False
        for i in range(1, len(order) - 2):
            for j in range(i + 1, len(order) - 1):
                a, b, c, d = order[i - 1], order[i], order[j], order[j + 1]
                if times[a, c] + times[b, d] < times[a, b] + times[c, d] - 1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    better = True
    return order

"""Which postures tell most of an arm: greedy D-optimal design.

The gain of a posture is log det(I + A H⁻¹ Aᵀ), with H what the priors and the postures chosen before already tell.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.arm_fit import ALL, ARM_FIT, ArmFitSettings, whitened_columns
from highfive.calibration.arm_kinematics import ArmShape
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array


def choose_poses(
    shape: ArmShape,
    candidates: Array,
    count: int,
    fitted: tuple[str, ...] = ALL,
    up: Array | None = None,
    settings: ArmFitSettings = ARM_FIT,
) -> NDArray[np.int64]:
    """Indices (count,) of the candidates that tell most together, the one that tells most first.

    Args:
        shape: the arm as drawn.
        candidates: (C, J) rad, postures that can be taken: free of collision, and seen by the cameras.
        count: number of them.
        fitted: groups of parameters.
        up: (3,) the vertical in the base's frame; None for its z axis.
        settings: priors and noise.

    Raises:
        HighFiveError: there are fewer candidates than that.
    """
    if len(candidates) < count:
        raise HighFiveError(f"{len(candidates)} postures can be taken, {count} are needed; give the arm more room")
    vertical = np.array([0.0, 0.0, 1.0]) if up is None else up
    columns, priors = whitened_columns(shape, candidates, vertical, fitted, settings)
    told = np.diag(priors**2)
    chosen: list[int] = []
    for _ in range(count):
        along = columns @ told
        inside = np.eye(columns.shape[1]) + along @ np.swapaxes(columns, 1, 2)
        gains = np.linalg.slogdet(inside)[1]
        gains[chosen] = -np.inf
        best = int(np.argmax(gains))
        chosen.append(best)
        told -= along[best].T @ np.linalg.solve(inside[best], along[best])
    return np.array(chosen)

"""What the back projection sees of the hand: its points now, and how they differ from its points a little earlier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.dataset import HAND_DIMS
from model.rotations import Array


@dataclass(frozen=True)
class FeatureMap:
    """Features of a hand history: ``matrix @ history + offset``, linear so that uncertainty passes through exactly.

    Attributes:
        matrix: (F, 6 (H + 1)).
        offset: (F,).
    """

    matrix: Array
    offset: Array

    def __call__(self, history: Array) -> Array:
        """Features (..., F) of hand histories (..., H + 1, 6), m."""
        return history.reshape(*history.shape[:-2], -1) @ self.matrix.T + self.offset


def fit_feature_map(history: Array) -> FeatureMap:
    """Scales the features of histories (N, H + 1, 6): positions by one factor, the differences of a time by one.

    One factor for x, y and z keeps the geometry; the kernel's lengthscales do the rest.
    """
    times = history.shape[1]
    matrix = np.zeros((times, HAND_DIMS, times, HAND_DIMS))
    identity = np.eye(HAND_DIMS)
    for time in range(times):
        matrix[time, :, 0] = identity
        if time > 0:
            matrix[time, :, time] = -identity
    matrix = matrix.reshape(times * HAND_DIMS, times * HAND_DIMS)
    raw = history.reshape(len(history), -1) @ matrix.T
    deviation = raw.std(axis=0).reshape(times, HAND_DIMS)
    factor = 1.0 / np.maximum(np.sqrt(np.mean(deviation**2, axis=1)), 1e-6)
    matrix = matrix * np.repeat(factor, HAND_DIMS)[:, None]
    return FeatureMap(matrix, -matrix @ history.reshape(len(history), -1).mean(axis=0))

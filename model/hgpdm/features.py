"""What the back projection sees of the hand: its points now, and how they differ from its points a little earlier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class FeatureMap:
    """Features of a hand history: ``matrix @ history + offset``, linear so that uncertainty passes through exactly.

    Attributes:
        matrix: (F, P (H + 1)).
        offset: (F,).
    """

    matrix: Array
    offset: Array

    def __call__(self, history: Array) -> Array:
        """Features (..., F) of hand histories (..., H + 1, P), m."""
        return history.reshape(*history.shape[:-2], -1) @ self.matrix.T + self.offset


def scales(raw: Array, vectors: int, still: float) -> tuple[Array, Array]:
    """Centre and factor (F,) of features (N, F): ``vectors`` of three components, then lengths.

    One factor each keeps the vectors' directions. What varies by less than ``still`` counts as if it varied so much.
    """
    variance = raw.var(axis=0)
    turning, lengths = variance[: 3 * vectors].reshape(-1, 3), variance[3 * vectors :]
    deviation = np.sqrt(np.concatenate([np.repeat(turning.mean(axis=1), 3), lengths]))
    return raw.mean(axis=0), 1.0 / np.maximum(deviation, still)


def fit_feature_map(history: Array) -> FeatureMap:
    """Scales the features of histories (N, H + 1, P): positions by one factor, the differences of a time by one.

    One factor for x, y and z keeps the geometry; the kernel's lengthscales do the rest.
    """
    _, times, dims = history.shape
    matrix = np.zeros((times, dims, times, dims))
    identity = np.eye(dims)
    for time in range(times):
        matrix[time, :, 0] = identity
        if time > 0:
            matrix[time, :, time] = -identity
    matrix = matrix.reshape(times * dims, times * dims)
    raw = history.reshape(len(history), -1) @ matrix.T
    deviation = raw.std(axis=0).reshape(times, dims)
    factor = 1.0 / np.maximum(np.sqrt(np.mean(deviation**2, axis=1)), 1e-6)
    matrix = matrix * np.repeat(factor, dims)[:, None]
    return FeatureMap(matrix, -matrix @ history.reshape(len(history), -1).mean(axis=0))

"""The rigid motion between two sets of points (Kabsch), its scale (Umeyama), and whether one of them is mirrored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

_ROUNDS = 3
"""Of reweighting."""


@dataclass(frozen=True)
class RigidFit:
    """From points to their targets: target = rotation @ point + translation.

    Attributes:
        rotation, translation: (3, 3) and (3,) m.
        scale: what the points would have to be stretched by.
        rms: m, of what is left.
        mirrored_rms: m, of what would be left with the points' mirror image.
    """

    rotation: Array
    translation: Array
    scale: float
    rms: float
    mirrored_rms: float

    @property
    def mirrored(self) -> bool:
        """The points' mirror image fits much better than they do."""
        return self.mirrored_rms < 0.5 * self.rms

    def apply(self, points: Array) -> Array:
        """Points (..., 3) where they come to lie."""
        return points @ self.rotation.T + self.translation


def rigid_fit(points: Array, targets: Array, sigma: float | None = None) -> RigidFit:
    """The motion that brings points (N, 3) nearest to targets (N, 3), m, in least squares.

    The rotation nearest to Σ w b aᵀ (Kabsch 1976; scale: Umeyama 1991), and the reflection nearest to it.

    Args:
        points, targets: three or more, not in a line.
        sigma: m; points that are further off than 2.5 of it count less (Huber), in three rounds.
    """
    weights, found = np.ones(len(points)), None
    for _ in range(1 if sigma is None else 1 + _ROUNDS):
        found = _fit(points, targets, weights)
        if sigma is not None:
            off = np.linalg.norm(targets - found.apply(points), axis=1)
            weights = np.minimum(1.0, 2.5 * sigma / np.maximum(off, 1e-12))
    assert found is not None
    return found


def _fit(points: Array, targets: Array, weights: Array) -> RigidFit:
    share = weights / weights.sum()
    here, there = share @ points, share @ targets
    a, b = points - here, targets - there
    both = (share[:, None] * b).T @ a
    rotation, reflection = rotations.nearest_rotation(both), -rotations.nearest_rotation(-both)
    trace, mirrored = float(np.sum(rotation * both)), float(np.sum(reflection * both))
    spread, other = float(share @ np.sum(a * a, axis=1)), float(share @ np.sum(b * b, axis=1))
    return RigidFit(
        rotation,
        there - rotation @ here,
        trace / max(spread, 1e-30),
        float(np.sqrt(max(spread + other - 2.0 * trace, 0.0))),
        float(np.sqrt(max(spread + other - 2.0 * mirrored, 0.0))),
    )

"""What follows a marker without a skeleton, to compare with: the last value held, and Kalman filters of one marker."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from highfive.model.geometry.rotations import Array

POWERS = {2: (1.0, 3.0, 10.0, 30.0, 100.0, 300.0), 3: (1e1, 1e2, 1e3, 1e4, 1e5)}
"""Powers of the white noise that are tried, by the order of the filter: m²/s³ and m²/s⁵."""

_SPREADS = (1e-3, 1.0, 10.0)  # m, m/s, m/s²: what is known of a marker in its first frame


def held(points: Array, seen: NDArray[np.bool_]) -> Array:
    """Points (T, M, 3), m, with the last value that was ``seen`` (T, M) in each gap."""
    result = points.copy()
    for k in range(1, len(result)):
        result[k] = np.where(seen[k][:, None], points[k], result[k - 1])
    return result


def kalman(points: Array, seen: NDArray[np.bool_], rate_hz: float, order: int, power: float, sigma: float) -> Array:
    """Points (T, M, 3), m, filtered marker by marker.

    Args:
        points: (T, M, 3) m.
        seen: (T, M); all of the first frame.
        rate_hz: frames per second.
        order: 2 for constant velocity, 3 for constant acceleration.
        power: of the white noise that drives the highest derivative but one.
        sigma: standard deviation of a measured coordinate, m.
    """
    dt = 1.0 / rate_hz
    step = np.array(
        [[dt ** (k - i) / math.factorial(k - i) if k >= i else 0.0 for k in range(order)] for i in range(order)]
    )
    # Singer 1970 in the limit of white noise: integral of the last column of the transition and its transpose.
    noise = np.empty((order, order))
    for i in range(order):
        for k in range(order):
            a, b = order - 1 - i, order - 1 - k
            noise[i, k] = power * dt ** (a + b + 1) / (math.factorial(a) * math.factorial(b) * (a + b + 1))
    markers = points.shape[1]
    mean = np.zeros((markers, order, 3))
    mean[:, 0] = points[0]
    covariance = np.tile(np.diag(np.square(_SPREADS[:order])), (markers, 1, 1))
    result = np.empty_like(points)
    for k in range(len(points)):
        if k:
            mean, covariance = step @ mean, step @ covariance @ step.T + noise
        gain = covariance[:, :, 0] / (covariance[:, :1, 0] + sigma**2) * seen[k][:, None]
        away = points[k] - mean[:, 0]
        mean = mean + gain[:, :, None] * away[:, None, :]
        covariance = covariance - gain[:, :, None] * covariance[:, :1, :]
        result[k] = mean[:, 0]
    return result

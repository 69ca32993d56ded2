"""A marker across a gap from its own track alone: a cubic spline, with how far off it may be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from highfive.mocap_bridge.tracking.filter_settings import FilterSettings
from highfive.model.geometry.rotations import Array

POWER = 15.0
"""m²/s³, of the white accelerations that drive a hand: as far off as a spline was across gaps of 0.1 and 0.3 s on a
part of a real recording (CMU 85, 12); on simulated high fives it is half as far off."""

BLIND = 1e12
"""m², sum of the variances of an estimate that says nothing."""


def bridged(points: Array, seen: NDArray[np.bool_], rate_hz: float) -> tuple[Array, Array]:
    """Markers (T, M, 3), m, by a spline through where they were seen, and the sum of their variances (T, M), m².

    Accelerations that are white noise make a cubic spline the mean of what may be between two places and velocities,
    with the variance power · (u (1 − u) T)³ / 3 of a coordinate at a share u of a gap of T s (Wahba 1978, "Improper
    priors, spline smoothing and the problem of guarding against model errors in regression"). Before a marker is first
    seen, and after it is last seen, :data:`BLIND`.

    Args:
        points: (T, M, 3) m.
        seen: (T, M) which of them are the markers.
        rate_hz: frames per second.
    """
    filled, variances = np.zeros(points.shape), np.full(seen.shape, BLIND)
    frames = np.arange(len(points))
    for m in range(points.shape[1]):
        known = np.flatnonzero(seen[:, m])
        if len(known) < 4:
            continue
        inside = slice(known[0], known[-1] + 1)
        at = frames[inside]
        filled[inside, m] = CubicSpline(known, points[known, m])(at)
        before = known[np.searchsorted(known, at, side="right") - 1]
        after = known[np.searchsorted(known, at, side="left")]
        sides = (at - before) * (after - at) / np.maximum(after - before, 1) / rate_hz  # u (1 − u) T, s
        variances[inside, m] = 3.0 * FilterSettings().marker_sigma ** 2 + POWER * sides**3
    return filled, variances

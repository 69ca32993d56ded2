"""Which points of a frame can be meant: a wrong byte, or an overflow, makes coordinates where no marker is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from highfive.model.geometry.rotations import Array

FARTHEST_M = 1000.0
"""No marker is further from the origin along an axis, m."""

LONGEST_LATENCY_NS = 250_000_000
"""Cameras to sending: a system that says more, ns, adds up what does not belong there, or counts on another clock."""


def plausible(points: Array, valid: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_], NDArray[np.int64]]:
    """Points (…, M, 3), m, and which of them are seen (…, M), less those that cannot be meant; these are zero.

    The third value (…) is how many seen ones were infinite or too far. One that is no number is just not seen: so most
    systems show a marker that is hidden.
    """
    if np.abs(points).max(initial=0.0) <= FARTHEST_M:
        return points, valid, np.zeros(valid.shape[:-1], dtype=np.int64)
    good = np.asarray((np.abs(points) <= FARTHEST_M).all(axis=-1))
    impossible = valid & ~good & ~np.isnan(points).any(axis=-1)
    return np.where(good[..., None], points, 0.0), valid & good, impossible.sum(axis=-1)


def plausible_only(points: Array) -> Array:
    """Those of points (U, 3), m, without a label that can be meant."""
    return points[(np.abs(points) <= FARTHEST_M).all(axis=1)]


SPAN = (0.01, 50.0)
"""Between these, m, lies the span of a person's markers, whatever the room; outside the unit is wrong."""


def spans(points: NDArray[np.float64], valid: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Largest extent along an axis, m, of each frame's (…, M, 3) valid markers; NaN where fewer than three are."""
    low = np.where(valid[..., None], points, np.inf).min(axis=-2)
    high = np.where(valid[..., None], points, -np.inf).max(axis=-2)
    return np.where(valid.sum(axis=-1) > 2, (high - low).max(axis=-1), np.nan)


def of_another_unit(span: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Spans, m, that no person's markers have: the numbers were of another unit."""
    return (span < SPAN[0]) | (span > SPAN[1])

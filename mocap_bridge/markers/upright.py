"""Which axis of a recording is up: people have their heads above the rest of them."""

from __future__ import annotations

import numpy as np

from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.model.errors import HighFiveError

UPRIGHT = 0.85
"""Cosine between an axis and the way from the other points to the head's, above which the axis is up."""


def up_axis(person: Recording) -> str | None:
    """``'+y'``, ``'-z'`` and so on; None where the labels say nothing of a head, or it is in no axis's direction.

    Args:
        person: one person's points, the prefix taken off, in any unit.
    """
    try:
        marker_set = find_marker_set(person.names)
    except HighFiveError:
        return None
    columns = marker_set.match(person.names)
    top = [column for column in columns[marker_set.indices(marker_set.on_head)] if column >= 0]
    rest = [column for column in columns if column >= 0 and column not in top]
    above = _mean(person, top) - _mean(person, rest)
    above = above[np.isfinite(above).all(axis=-1)]
    if not len(above):
        return None
    way = np.median(above, axis=0)
    way = way / max(float(np.linalg.norm(way)), 1e-12)
    axis = int(np.argmax(np.abs(way)))
    return f"{'+' if way[axis] > 0.0 else '-'}{'xyz'[axis]}" if abs(way[axis]) >= UPRIGHT else None


def _mean(person: Recording, columns: list[int]) -> np.ndarray:
    """(T, 3) of the points that are seen; NaN where none is."""
    seen = person.valid[:, columns, None]
    count = seen.sum(axis=1)
    mean = np.where(seen, person.points[:, columns], 0.0).sum(axis=1) / np.maximum(count, 1)
    return np.where(count > 0, mean, np.nan)

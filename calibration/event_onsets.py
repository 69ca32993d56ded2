"""When a stream shows an event: a clap or tap in motion, a step in a channel of numbers.

In motion it is where the acceleration is largest; in numbers where half of the height is reached. Both lie between
samples: at 60 Hz a sample alone would be 17 ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class OnsetSettings(Settings):
    """What an event is. Set by hand."""

    clear: float = setting(8.0, above=0.0)
    """It stands out by so many standard deviations of what is there besides, as the median tells that."""
    share: float = setting(0.4, above=0.0, below=1.0)
    """And by so much of the highest one: what is smaller is no event of the same kind."""
    apart: float = setting(0.5, "s", above=0.0)
    """Two that are nearer are one: a clap sounds on, a hand bounces."""


def impacts(times: Array, points: Array, settings: OnsetSettings | None = None) -> Array:
    """Times (E,), s, at which something that moves is stopped: peaks of its acceleration.

    Args:
        times: (T,) s, rising.
        points: (T, D) where it is, NaN where that is not known.
        settings: what an event is.

    Raises:
        HighFiveError: too little is known.
    """
    known = np.isfinite(points).all(axis=1)
    at, where = _rising(times[known], points[known])
    if len(at) < 5:
        raise HighFiveError(f"{len(at)} samples of motion, expected 5 or more")
    steps, middles = np.diff(at), 0.5 * (at[1:] + at[:-1])
    speeds = np.diff(where, axis=0) / steps[:, None]
    height = np.linalg.norm(np.diff(speeds, axis=0), axis=1) / np.diff(middles)
    usual = float(np.median(steps))
    height[np.maximum(steps[1:], steps[:-1]) > 3.0 * usual] = 0.0  # across a gap nothing is known
    return np.array([_summit(at[1:-1], height, k) for k in _peaks(at[1:-1], height, settings or OnsetSettings())])


def steps(times: Array, values: Array, settings: OnsetSettings | None = None) -> Array:
    """Times (E,), s, at which numbers leave where they rest: where half of the height of each event is reached.

    Args:
        times: (T,) s, rising.
        values: (T,) any unit, NaN where not known.
        settings: what an event is.

    Raises:
        HighFiveError: too little is known.
    """
    s, known = settings or OnsetSettings(), np.isfinite(values)
    at, level = _rising(times[known], values[known])
    if len(at) < 5:
        raise HighFiveError(f"{len(at)} samples, expected 5 or more")
    height = np.abs(level - np.median(level))
    found = list[float]()
    for k in _peaks(at, height, s):
        half, first = 0.5 * height[k], int(np.searchsorted(at, at[k] - s.apart))
        below = np.flatnonzero(height[first : k + 1] < half)
        if len(below):  # else it was there before the stream was
            i = first + int(below[-1])
            found.append(float(at[i] + (at[i + 1] - at[i]) * (half - height[i]) / (height[i + 1] - height[i])))
    return np.array(found)


def _rising(times: Array, values: Array) -> tuple[Array, Array]:
    """Without what is not later than all before it."""
    later = np.concatenate([[True], np.diff(np.maximum.accumulate(times)) > 0.0]) if len(times) else np.zeros(0, bool)
    return times[later], values[later]


def _peaks(times: Array, height: Array, s: OnsetSettings) -> list[int]:
    """Where the highest of each event is, in order: a first rise, and what is highest soon after."""
    rest = float(np.median(height))
    spread = 1.4826 * float(np.median(np.abs(height - rest)))
    threshold = max(rest + s.clear * spread, s.share * float(height.max()))
    found, over = list[int](), -np.inf
    for k in np.flatnonzero((height >= threshold) & (height > 0.0)).tolist():
        if times[k] - over > s.apart:
            soon = int(np.searchsorted(times, times[k] + 0.2 * s.apart, "right"))
            found.append(k + int(np.argmax(height[k:soon])))
        over = times[k]
    return found


def _summit(times: Array, height: Array, k: int) -> float:
    """Where a parabola through a peak and its neighbours is highest."""
    if not 0 < k < len(height) - 1:
        return float(times[k])
    (a, b, c), at = height[k - 1 : k + 2], times[k - 1 : k + 2]
    bend = a - 2.0 * b + c
    shift = 0.0 if bend >= 0.0 else float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5))
    return float(at[1] + shift * (at[2] - at[0]) / 2.0)

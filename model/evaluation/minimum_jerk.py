"""Where a reach will end, if it is the smoothest that there is: the reach predictor of the literature.

A hand that goes from x₀ to x₁ in T with the least jerk is at x₀ + (x₁ − x₀) s(t / T), s(u) = 10 u³ − 15 u⁴ + 6 u⁵
(Flash & Hogan 1985, eq. 2). Of the palm since its onset the end is fitted by least squares for each of some onsets and
durations; those that fit best are kept. Nothing is learned. The first half of a reach says little of how long it will
last: any begins alike.
"""

from __future__ import annotations

import numpy as np

from highfive.model.geometry.rotations import Array

DURATIONS = np.arange(0.25, 1.55, 0.05)
"""s, of a reach."""
ONSET = 0.1
"""m/s; a palm that is faster has set out."""
LEADS = np.arange(0.0, 0.31, 0.05)
"""s, by which it may have set out before that: a smooth reach begins slowly."""
SHORTEST = 3
"""Frames of a reach from which an end is fitted."""


def reach_end(palm: Array, rate_hz: float) -> tuple[Array, float]:
    """Where (3,), m, and in how many s, a palm (T, 3), m, will have reached, by its way until now; as it is, at rest.

    Args:
        palm: until now, newest last.
        rate_hz: of its frames.
    """
    speed = np.linalg.norm(np.diff(palm, axis=0), axis=1) * rate_hz
    slow = np.flatnonzero(speed < ONSET)
    fast = int(slow[-1]) + 1 if len(slow) else 0
    if len(palm) - fast < SHORTEST:
        return palm[-1], 0.0
    best = (np.inf, palm[-1], 0.0)
    for onset in dict.fromkeys(max(fast - round(lead * rate_hz), 0) for lead in LEADS):
        way = palm[onset:] - palm[onset]
        passed: Array = np.arange(len(palm) - onset) / rate_hz
        for duration in DURATIONS.tolist():
            if float(passed[-1]) >= duration:
                continue
            u = passed / duration
            share: Array = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
            end: Array = share @ way / (share @ share)
            miss = float(np.sum((way - share[:, None] * end) ** 2)) / len(way)
            if miss < best[0]:
                best = (miss, palm[onset] + end, float(duration - passed[-1]))
    return best[1], best[2]

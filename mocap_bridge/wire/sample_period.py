"""The period of an evenly sampled stream whose samples are stamped late at times, and of which some are missing.

A sender stamps a sample when it is pushed: on time or late, never early. Lateness passes, for a sender that was held up
catches up. So the time line of a stream is the lower envelope of its stamps (:func:`time_line`): each sample's own
stamp, or that of a later one counted back by the period, whichever is least.

Of all periods the right one makes the phase of that line, its fraction of a period, the same everywhere, for a loss
moves it by whole periods: the mean resultant length of the phase is a periodogram that losses leave alone. What
lateness a period leaves unexplained counts against it, or regular losses would pass for a longer period. An estimate is
good to some 2e-4: right to count by within a window.
"""

from __future__ import annotations

import math

import numpy as np

from highfive.model.geometry.rotations import Array

WINDOW = 512
"""Newest samples that a period is estimated from, at most."""

FEWEST = 32
"""Samples that it takes at least."""

_SEARCHED = (0.9, 1.03)  # times the mean step: losses make it longer than the period, the ends of a window shorter
_NEAR = 0.015  # a period that is known is looked for so close to itself, as a share
_FINE = 0.01  # periods by which a window's last sample may be off for the estimate's resolution
_CERTAIN = 0.4  # score from which on a period is known: events at random times reach 0.2, good senders 0.9
_LIKE = (
    0.1  # a period that fits less well by no more is taken, if it is as long as the mean step: its half fits as well
)
_SMOOTHING = 0.1  # share of a new score in the mean one
_OTHER = 1.5  # a rate so many times the nominal one, or the one found so far, is another stream's; or as much slower
_FASTEST_HZ = 5000.0
_ANEW = 8  # estimates after which, where they are uncertain, the period is looked for everywhere again
_KEPT = 1000  # estimates that are remembered


def time_line(stamps: Array, period_s: float, ahead: int) -> Array:
    """When each of N samples was due, s: the lower envelope of ``stamps``, which looks ``ahead`` so many samples.

    Stamps that stand alone, early or late, are passed over.
    """
    counted = period_s * np.arange(len(stamps))
    return _least_ahead(_median_of_three(stamps - counted), ahead) + counted


class SamplePeriod:
    """Follows the period of a stream.

    Attributes:
        newest_s: the period now, s; 0 where it is not known.
    """

    def __init__(self, rate_hz: float):
        """Args: ``rate_hz`` is the nominal rate, a first guess; 0 where there is none."""
        self._nominal = 1.0 / rate_hz if rate_hz > 0.0 else 0.0
        self.newest_s = self._nominal
        self._found: list[float] = []  # with certainty, newest last
        self._score = 0.0
        self._estimates = 0

    @property
    def overall_s(self) -> float:
        """The median of what was found, s; 0 where it was never certain."""
        return float(np.median(self._found)) if self._found else 0.0

    @property
    def even(self) -> bool:
        """Whether samples can be counted by it: the stream says that it is even, or is seen to be."""
        return self._nominal > 0.0 or self._score > _CERTAIN

    def update(self, stamps: Array, ahead: int) -> None:
        """Takes the newest stamps, s, into account; ``ahead`` as in :func:`time_line`."""
        stamps = stamps[-min(WINDOW, max(2 * FEWEST, 3 * ahead)) :]
        if len(stamps) < FEWEST:
            return
        known = self.newest_s
        period, score = _best(stamps, known * (1.0 - _NEAR), known * (1.0 + _NEAR), ahead)
        if not self._found or (score < _CERTAIN and self._estimates % _ANEW == 0):
            lag = len(stamps) // 4
            step = float(np.median(stamps[lag:] - stamps[:-lag])) / lag
            shortest = max((self.overall_s or self._nominal) / _OTHER, 1.0 / _FASTEST_HZ)
            longest = self.overall_s * _OTHER or math.inf
            wide = _best(stamps, max(_SEARCHED[0] * step, shortest), min(_SEARCHED[1] * step, longest), ahead)
            period, score = wide if wide[1] > score - _LIKE else (period, score)
        if period > 0.0:
            if score > _CERTAIN or not self.newest_s:
                self.newest_s = period
            self._score += (score - self._score) * (_SMOOTHING if self._estimates else 1.0)
            self._estimates += 1
            if score > _CERTAIN:
                self._found = [*self._found[1 - _KEPT :], period]


def _least_ahead(values: Array, width: int) -> Array:
    """The least of each value (…, N) and the ``width`` - 1 that follow it."""
    least, span = values, 1
    while span < min(width, values.shape[-1]):
        step = min(span, width - span)
        least = np.concatenate([np.minimum(least[..., :-step], least[..., step:]), least[..., -step:]], axis=-1)
        span += step
    return least


def _median_of_three(values: Array) -> Array:
    """Values (…, N) without those that stand alone; at the end without one that is too small."""
    if values.shape[-1] < 3:
        return values
    before, here, after = values[..., :-2], values[..., 1:-1], values[..., 2:]
    middle = np.maximum(np.minimum(before, here), np.minimum(np.maximum(before, here), after))
    return np.concatenate([values[..., :1], middle, np.maximum(values[..., -2:-1], values[..., -1:])], axis=-1)


def _best(stamps: Array, low: float, high: float, ahead: int) -> tuple[float, float]:
    """The period, s, between two at which stamps (N,) fit best, and how well: 1 where none is late; (0, 0): no such."""
    if not 0.0 < low < high < math.inf:
        return 0.0, 0.0
    count, since = np.arange(len(stamps)), stamps - stamps[0]
    step = 0.25 / len(stamps)  # share of a period: a quarter of one over the whole window
    while True:
        periods = np.linspace(low, high, max(5, math.ceil(math.log(high / low) / step)))
        lateness = _median_of_three(since / periods[:, None] - count)
        line = _least_ahead(lateness, ahead)
        alike = np.abs(np.exp(2j * np.pi * line).mean(axis=1))
        score = alike - np.minimum(lateness - line, 1.0).mean(axis=1)
        best = int(score.argmax())
        if step * len(stamps) <= _FINE:
            return float(periods[best]), float(score[best])
        width = float(periods[1] - periods[0])
        low, high, step = float(periods[best]) - width, float(periods[best]) + width, 0.2 * step

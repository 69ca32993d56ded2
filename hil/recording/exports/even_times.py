"""One rate for files that know no time stamps: what was recorded at uneven times is put between its neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

EVEN = 0.01
"""Of a frame, by which times may be off and still count as even."""
LOST = 1.5
"""Frames between two ticks from which on one between was lost."""


@dataclass(frozen=True)
class EvenTimes:
    """N evenly spaced times between T recorded ones.

    Attributes:
        rate_hz: frames a second, to a thousandth.
        left: (N,) the tick at or before each.
        share: (N,) of the way to the next tick, 0 to 1; all 0 where the ticks are even themselves.
        whole: (N,) no frame was lost between the two ticks.
    """

    rate_hz: float
    left: NDArray[np.int64]
    share: Array
    whole: NDArray[np.bool_]

    @property
    def as_recorded(self) -> bool:
        """Each frame is a tick."""
        return not self.share.any()

    def between(self, values: Array) -> Array:
        """(N, …) of values (T, …) at the ticks, along straight lines."""
        right, share = self._right(len(values)), self.share.reshape(-1, *[1] * (values.ndim - 1))
        return (1.0 - share) * values[self.left] + share * values[right]

    def turns_between(self, quaternions: Array) -> Array:
        """(N, …, 4) of rotations (T, …, 4), the shortest way."""
        if self.as_recorded:
            return quaternions[self.left]
        share = np.broadcast_to(
            self.share.reshape(-1, *[1] * (quaternions.ndim - 2)), (len(self.left), *quaternions.shape[1:-1])
        )
        return rotations.slerp(quaternions[self.left], quaternions[self._right(len(quaternions))], share)

    def seen_between(self, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(N, M) both ticks saw it (T, M), and none was lost between them."""
        exact = self.share[:, None] == 0.0
        return seen[self.left] & (exact | (seen[self._right(len(seen))] & self.whole[:, None]))

    def _right(self, count: int) -> NDArray[np.int64]:
        return np.minimum(self.left + 1, count - 1)


def even_times(times: Array, name: str) -> EvenTimes:
    """Even times from the first to the last of times (T,), s.

    Raises:
        HighFiveError: there are fewer than two, or they do not go on.
    """
    steps = np.diff(times)
    if not len(steps) or not (steps > 0.0).all():
        raise HighFiveError(f"{name}: {len(times)} ticks whose times do not go on; two or more are needed")
    period = float(np.median(steps))
    even = np.abs(steps - period).max() < EVEN * period
    rate = round((1.0 / float(steps.mean())) if even else 1.0 / period, 3)
    if even:
        count = len(times)
        return EvenTimes(rate, np.arange(count), np.zeros(count), np.ones(count, dtype=bool))
    return times_of_rate(times, rate, period)


def times_of_rate(times: Array, rate_hz: float, period: float) -> EvenTimes:
    """Even times of a rate, from the first to the last of times (T,), s, which are about ``period`` s apart."""
    at = times[0] + np.arange(int(np.floor((times[-1] - times[0]) * rate_hz + EVEN)) + 1) / rate_hz
    left = np.clip(np.searchsorted(times, at + EVEN * period, side="right") - 1, 0, len(times) - 1)
    right = np.minimum(left + 1, len(times) - 1)
    length = np.where(right > left, times[right] - times[left], 1.0)
    share = np.clip((at - times[left]) / length, 0.0, 1.0) * (right > left)
    share[share < EVEN * period / length] = 0.0
    return EvenTimes(rate_hz, left, share, length < LOST * period)

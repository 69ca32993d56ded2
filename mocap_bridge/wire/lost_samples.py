"""Which samples of an evenly sampled stream are missing, inferred from the times at which the others were stamped.

Lateness passes, a loss stays: it moves the time line of the stream (:mod:`highfive.mocap_bridge.wire.sample_period`),
which no late sample moves, by whole periods. The line needs later samples, so that a loss is known :data:`PATIENCE_S`
later. Where a sender was held up for longer and then catches up, what had been taken for lost is taken back.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.wire.sample_period import FEWEST, WINDOW, SamplePeriod, time_line
from highfive.model.geometry.rotations import Array

PATIENCE_S = 0.5
"""For so long, s, a sender may be held up before what it has not sent yet is taken for lost, for the time being."""

AHEAD_S = 5.0
"""A stamp that is further ahead of the clock that samples arrive by, s, is of another clock."""

_AHEAD = (16, WINDOW // 2)  # samples that the time line looks ahead, at least and at most
_FOLLOW = 0.05  # share of a deviation of less than half a period that the expected time takes over
_CONFIRMED = 3  # samples at a stream's end that open no gap
_TAKEN_BACK_S = 10.0  # for so long a loss can turn out to have been none
_PAUSE_S = 0.25  # where a clock was set, a shorter time between arrivals says nothing of samples in between


class LostSamples:
    """Given samples as they come, it says where others are missing; memory grows with the gaps only.

    Attributes:
        period: of the stream.
    """

    def __init__(self, rate_hz: float):
        """Args: ``rate_hz`` is the nominal rate; 0 where there is none: gaps then count where the stream is even."""
        self._gaps: dict[int, int] = {}
        self._missing = 0  # all of them
        self.period = SamplePeriod(rate_hz)
        self._stamps: list[float] = []  # of one clock: what the period is estimated from, and the undecided
        self._came = self._decided = 0
        self._estimate_at = 0  # samples that have come by the next estimate
        self._expected: float | None = None  # time of the next one to decide on
        self._began = 0.0, 0  # time and number of the clock's first sample
        self._spanned_s, self._spanned = 0.0, 0  # by all clocks before: s, and periods
        self._early = self._early_by = 0  # samples in a row that came before their time, and by how many periods
        self._first_arrival = self._arrival = 0.0  # of the first sample and the newest
        self._offset = 0.0  # of the clock from the one that samples arrive by, at its first sample

    @property
    def gaps(self) -> dict[int, int]:
        """Samples missing before the sample with this index (counted from 0, as they come), as far as is known."""
        return self._gaps if self.period.even else {}

    @property
    def total(self) -> int:
        """Samples missing in all, as far as is known."""
        return self._missing if self.period.even else 0

    @property
    def mean_period_s(self) -> float:
        """Mean period, s, after :meth:`finish`; 0 where it was never certain."""
        certain = self.period.even and self.period.overall_s > 0.0 and self._spanned > 0
        return max(0.0, self._spanned_s / self._spanned) if certain else 0.0

    def add(self, stamp: float, arrival: float) -> None:
        """A sample stamped ``stamp``, s, that arrived at ``arrival``, s on a clock that is never set."""
        if self._stamps:
            elapsed = arrival - self._arrival
            if stamp < self._stamps[-1] - PATIENCE_S or stamp - arrival > self._offset + AHEAD_S:
                self.finish()  # the clock was set, or another one goes on
                if elapsed > _PAUSE_S and self.period.newest_s > 0.0:
                    self._lose(round(elapsed / self.period.newest_s) - 1)
        if not self._came:
            self._first_arrival = arrival
        if not self._stamps:
            self._offset = stamp - arrival
        self._arrival = arrival
        self._stamps.append(stamp)
        self._came += 1
        ahead = self._ahead()
        if self._came - self._decided >= (ahead + ahead // 4 if self._decided else max(FEWEST, 2 * ahead)):
            self._decide(final=False)

    def finish(self) -> None:
        """No more samples of this clock come."""
        if self._stamps:
            self._decide(final=True)
            if self._early >= _CONFIRMED:
                self._take_back(self._early_by)
            if self._expected is not None:
                self._spanned_s += self._expected - self._began[0]
                self._spanned += self._decided + self._missing - self._began[1]
        self._stamps, self._decided, self._expected, self._early = [], self._came, None, 0

    def _ahead(self) -> int:
        """Samples that the time line looks ahead."""
        period_s = self.period.newest_s
        return min(max(_AHEAD[0], round(PATIENCE_S / period_s)), _AHEAD[1]) if period_s > 0.0 else _AHEAD[1]

    def _decide(self, final: bool) -> None:
        """Decides on the samples that enough others follow, or on all; keeps what is needed for those to come."""
        if self._came >= self._estimate_at:
            self.period.update(np.array(self._stamps), min(self._ahead(), len(self._stamps) // 4))
            self._estimate_at = self._came + max(FEWEST, self._ahead()) // 2
        ahead, period_s = self._ahead(), self.period.newest_s
        undecided = self._came - self._decided
        ready = undecided if final else max(0, undecided - ahead)
        first = max(0, len(self._stamps) - undecided - 1)  # one that is decided, for the median of three
        stamps = np.array(self._stamps[first:])
        start = len(stamps) - undecided
        if period_s > 0.0:
            line = time_line(stamps, period_s, ahead).tolist()
            closed = len(stamps) - (_unconfirmed(stamps, period_s) if final else 0)
            for k in range(start, start + ready):
                self._follow(line[k], period_s, k < closed)
        else:  # nothing to count by
            self._decided += ready
        old = len(self._stamps) - max(WINDOW, self._came - self._decided + 1)
        if old > 0:
            del self._stamps[:old]

    def _follow(self, time: float, period_s: float, may_open: bool) -> None:
        """The next sample's place on the time line, s."""
        late = 0.0 if self._expected is None else (time - self._expected) / period_s
        if self._expected is None:
            self._expected, self._began = time, (time, self._decided + self._missing)
        elif late > 0.5 and not may_open:
            late = 0.0
        elif late > 0.5:
            steady_s = self.period.overall_s or period_s  # a window with an outage in it says less of the period
            count = max(1, round((time - self._expected) / steady_s))
            self._lose(count)
            self._expected += count * steady_s
            late = (time - self._expected) / period_s
        # A stamp that is too early lasts in the time line for as long as that looks ahead; what lasts longer is so.
        self._early, self._early_by = (self._early + 1, round(-late)) if late < -0.5 else (0, 0)
        if self._early > self._ahead():
            self._take_back(self._early_by)
            self._expected, self._early, late = time, 0, 0.0
        self._expected += period_s * (1.0 + (_FOLLOW * late if late > -0.5 else 0.0))
        self._decided += 1

    def _lose(self, count: int) -> None:
        """So many are missing before the next sample, as far as the time that has passed has room for them."""
        passed = self._arrival - self._first_arrival + AHEAD_S
        count = min(count, int(passed / self.period.newest_s) - self._decided - self._missing)
        if count > 0:
            self._gaps[self._decided] = self._gaps.get(self._decided, 0) + count
            self._missing += count

    def _take_back(self, count: int) -> None:
        """Of those that seemed to be lost lately the newest have come after all, as many as ``count``."""
        since = self._decided - _TAKEN_BACK_S / self.period.newest_s
        for index in [index for index in reversed(self._gaps) if index > since]:
            back = min(count, self._gaps[index])
            count, self._missing = count - back, self._missing - back
            self._gaps[index] -= back
            if not self._gaps[index]:
                del self._gaps[index]


def lost_before(stamps: Iterable[float], arrivals: Iterable[float], rate_hz: float) -> tuple[NDArray[np.int64], float]:
    """How many samples are missing before each of N, and the stream's mean period, s (0: not certain).

    Args:
        stamps: (N,) s, when each sample was stamped, in the order in which they came.
        arrivals: (N,) s, when each arrived.
        rate_hz: nominal rate; 0 where there is none.
    """
    samples = LostSamples(rate_hz)
    came = 0
    for stamp, arrival in zip(stamps, arrivals, strict=True):
        samples.add(stamp, arrival)
        came += 1
    samples.finish()
    lost = np.zeros(came, dtype=np.int64)
    for index, missing in samples.gaps.items():
        lost[index] = missing
    return lost, samples.mean_period_s


def _unconfirmed(stamps: Array, period_s: float) -> int:
    """Samples at a stream's end that open no gap: too few follow, or its sender was still catching up."""
    on_time = np.flatnonzero(np.diff(stamps) > 0.5 * period_s)
    return max(_CONFIRMED, len(stamps) - (int(on_time[-1]) + 1 if len(on_time) else 0))

"""The newest samples of one stream, by their times: between which two of them does a time lie?"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Generic, TypeVar

Sample = TypeVar("Sample")

KEPT_NS = 500_000_000
"""How much of a stream is remembered."""

AHEAD_NS = 25_000_000
"""Beyond its newest sample a stream goes on as it was going for so long at the most, then stays."""

APART_NS = 4_000_000
"""How a stream was going is told by two samples that are so far apart at the least: stamps jitter."""


@dataclass(frozen=True)
class Between(Generic[Sample]):
    """Where a time lies among samples.

    Attributes:
        first, second: neighbours, in their order; the same where one sample says it all.
        share: of the way from the first to the second; more than 1 beyond the newest sample.
        apart_ns: from the first to the second.
        age_ns: from the nearest sample to the time requested; beyond the newest one how old that is.
    """

    first: Sample
    second: Sample
    share: float
    apart_ns: int
    age_ns: int


class Timeline(Generic[Sample]):
    """One thread adds; any may ask."""

    def __init__(self, kept_ns: int = KEPT_NS, ahead_ns: int = AHEAD_NS) -> None:
        """Starts empty."""
        self._kept_ns, self._ahead_ns = kept_ns, ahead_ns
        self._samples: tuple[tuple[int, ...], tuple[Sample, ...]] = (), ()  # replaced as a whole

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest sample; None where there is none."""
        times = self._samples[0]
        return times[-1] if times else None

    def clear(self) -> None:
        """Forgets everything."""
        self._samples = (), ()

    def forget_from(self, time_ns: int) -> None:
        """Forgets what is of that time or later."""
        times, values = self._samples
        count = bisect_right(times, time_ns - 1)
        self._samples = times[:count], values[:count]

    def add(self, time_ns: int, value: Sample) -> bool:
        """Keeps a sample; one that is not newer than the last is dropped, and False."""
        times, values = self._samples
        if times and time_ns <= times[-1]:
            return False
        begin = min(bisect_right(times, time_ns - self._kept_ns), max(len(times) - 1, 0))  # two at the least
        self._samples = (*times[begin:], time_ns), (*values[begin:], value)
        return True

    def around(self, time_ns: int) -> Between[Sample] | None:
        """Where a time lies; before the oldest sample that one; None where there is none."""
        times, values = self._samples
        if not times:
            return None
        index = bisect_right(times, time_ns) - 1
        if index < 0 or times[index] == time_ns or len(times) == 1:
            index = max(index, 0)
            return Between(values[index], values[index], 0.0, 0, abs(time_ns - times[index]))
        if index == len(times) - 1:
            age_ns = time_ns - times[-1]
            first = max(bisect_right(times, times[-1] - APART_NS) - 1, 0)
            reached, last = times[-1] + min(age_ns, self._ahead_ns), index
        else:
            age_ns = min(time_ns - times[index], times[index + 1] - time_ns)
            first, last, reached = index, index + 1, time_ns
        apart = times[last] - times[first]
        return Between(values[first], values[last], (reached - times[first]) / apart, apart, age_ns)

    def before(self, time_ns: int) -> tuple[int, Sample] | None:
        """The newest sample that is not later than a time, and its own time; None where there is none."""
        times, values = self._samples
        index = bisect_right(times, time_ns) - 1
        return (times[index], values[index]) if index >= 0 else None

"""Time that never goes back: an estimate of another clock, corrected slowly, except where a clock was set.

An estimate that gets better moves. What is interpolated must not move with it by leaps: speeds would jump, and a later
frame could be earlier than the one before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from highfive.model.settings import Settings, setting


class ClockEstimate(Protocol):
    """What maps the stamps of one stream to this computer's monotonic clock."""

    @property
    def resets(self) -> int:
        """How often a clock was set."""
        ...

    @property
    def drift(self) -> float:
        """By how much this computer's clock is faster than the stamps', as a fraction."""
        ...

    @property
    def settled(self) -> bool:
        """Whether it is known so well that it is to be corrected slowly."""
        ...

    def local(self, stamp_ns: int) -> int:
        """A stamp on this computer's clock, ns."""
        ...

    def bound_ns(self, stamp_ns: int) -> int:
        """How far that may be off, ns."""
        ...


@dataclass(frozen=True)
class SteadySettings(Settings):
    """How quickly an estimate is followed."""

    slew: float = setting(5e-4, "s/s", above=0.0, below=1.0)
    """Time runs quick or slow by so much at the most until the estimate is met: a hand at 5 m/s seems 2.5 mm/s
    quicker."""


class SteadyTime:
    """The stamps of one stream, in their order, on this computer's clock."""

    def __init__(self, clock: ClockEstimate, settings: SteadySettings | None = None) -> None:
        """Follows ``clock``, which is updated elsewhere."""
        self._clock, self._settings = clock, settings or SteadySettings()
        self._resets = clock.resets
        self._last: tuple[int, int] | None = None  # stamp, and its time

    def local(self, stamp_ns: int) -> int:
        """A stamp's time, ns: not before that of an earlier stamp, unless a clock was set in between.

        Until the estimate has settled it is followed at once, but never back.
        """
        wanted = self._clock.local(stamp_ns)
        if self._last is None or self._clock.resets != self._resets:
            self._resets = self._clock.resets
            self._last = stamp_ns, wanted
            return wanted
        before, shown = self._last
        elapsed = stamp_ns - before
        if elapsed <= 0:
            return shown
        if self._clock.settled:
            due = shown + elapsed + round(self._clock.drift * elapsed)
            room = int(self._settings.slew * elapsed)
            wanted = min(max(wanted, due - room), due + room)
        self._last = stamp_ns, max(wanted, shown)
        return self._last[1]

    def foreseen(self, stamp_ns: int) -> int:
        """What a stamp's time would be by what was shown last, ns."""
        stamp, shown = self._last or (stamp_ns, self._clock.local(stamp_ns))
        return shown + stamp_ns - stamp

    @property
    def behind_ns(self) -> int:
        """How far the time of the newest stamp still is from the estimate, ns."""
        return 0 if self._last is None else abs(self._clock.local(self._last[0]) - self._last[1])

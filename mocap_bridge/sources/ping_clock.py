"""The clock of a peer that answers: offset and drift from the times of questions and answers.

A peer's stamp was made after the question was sent and before the answer came: question and answer each give a bound
of the offset, and each bound is a one-way problem, the second one with time mirrored
(:mod:`highfive.mocap_bridge.sources.stamp_clock`). The least delay of either way makes the bounds narrow, whichever
probes it falls on; half of what is left between them is how far the middle can be off, if the ways are as unlike as
they can be. Halving the best of a round of probes instead (NTP, LSL) takes both ways of one probe, though seldom both
are quick.
"""

from __future__ import annotations

from dataclasses import replace

from highfive.mocap_bridge.sources.stamp_clock import UNKNOWN_NS, StampClock, StampClockSettings

PEER = replace(StampClockSettings(), drift=2e-4, back_ns=1_000_000_000)
"""A peer tells the time of a crystal, and no count of frames: it is not off by more. A question that is late is
answered after the next one."""


class PingClock:
    """Maps a peer's stamps to local time. One thread updates it; any may read.

    Attributes:
        resets: how often a clock was set, and the estimate began anew.
    """

    def __init__(self, settings: StampClockSettings | None = None) -> None:
        """Knows nothing yet."""
        self._settings = settings or PEER
        self.resets = 0
        self._begin()

    def _begin(self) -> None:
        self._answers, self._questions = StampClock(self._settings), StampClock(self._settings)
        self._probes = 0

    def update(self, sent_ns: int, stamp_ns: int, came_ns: int) -> None:
        """A peer that was asked at ``sent_ns`` said that it is ``stamp_ns`` by its clock; that came at ``came_ns``.

        A trip that ends before it begins is none and is left out.
        """
        if came_ns < sent_ns:
            return
        for _ in range(2):
            self._answers.update(stamp_ns, came_ns)
            self._questions.update(stamp_ns, 2 * stamp_ns - sent_ns)
            self._probes += 1
            if not (self._answers.resets or self._questions.resets):
                return
            self.resets += 1  # both ways are of one clock: where one begins anew, so does the other
            self._begin()

    @property
    def drift(self) -> float:
        """By how much the local clock is faster than the peer's, as a fraction."""
        return 0.5 * (self._answers.drift - self._questions.drift)

    @property
    def settled(self) -> bool:
        """Whether drift and offset are known well enough to be corrected slowly from now on."""
        return self._answers.settled and self._questions.settled

    def local(self, stamp_ns: int) -> int:
        """When the peer's clock showed that, ns of the local clock."""
        return stamp_ns + (self._answers.local(stamp_ns) - self._questions.local(stamp_ns)) // 2

    def bound_ns(self, stamp_ns: int) -> int:
        """How far :meth:`local` may be off, ns: half of the least round trip, and what the drift leaves open since.

        As long as both clocks run evenly the first part is a guarantee (neither a question nor an answer takes less
        than nothing); the second is an estimate.
        """
        if not self._probes:
            return UNKNOWN_NS
        newest = max(self._answers.newest_ns, self._questions.newest_ns)
        wider = max(self._trip(stamp_ns), self._trip(newest), 0.0)
        apart = abs(self._answers.drift + self._questions.drift)  # what the ways say of the drift
        aged = max(self._answers.aged_ns(stamp_ns), self._questions.aged_ns(stamp_ns))
        return round(0.5 * wider + apart * max(stamp_ns - newest, 0)) + aged

    def _trip(self, stamp_ns: int) -> int:
        """The least round trip, ns, as both ways tell it for a time."""
        return self._answers.local(stamp_ns) + self._questions.local(stamp_ns) - 2 * stamp_ns

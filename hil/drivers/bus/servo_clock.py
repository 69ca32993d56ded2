"""A servo's own clock against the host's: tells the answer to a question from a late one to an earlier question."""

from __future__ import annotations

_TICK_NS = 1_000_000
_TICKS = 32_768  # then a servo's clock begins at 0 again
_TOLERANCE_NS = 2_000_000  # of a servo's clock, which counts in ms, and of when it measures
_DRIFT = 0.01  # the most that a servo's clock runs slower than the host's


class ServoClock:
    """A servo's own clock against the host's: tells the answer to a question from a late one to an earlier question."""

    def __init__(self) -> None:
        """Nothing is known of it."""
        self._ahead_ns: float | None = None  # the least that the host's clock was ahead when an answer had come
        self._heard_ns = 0

    def fresh(self, tick: int, queried_ns: int, heard_ns: int) -> bool:
        """Whether what a servo said at its ``tick`` was measured after it was asked for. Host's times in ns."""
        ahead = heard_ns - tick * _TICK_NS
        if self._ahead_ns is None:
            self._ahead_ns = ahead
        turn = _TICKS * _TICK_NS
        more = (ahead - self._ahead_ns + turn / 2) % turn - turn / 2
        drift = _DRIFT * (heard_ns - self._heard_ns) if self._heard_ns else 0.0
        if more - (heard_ns - queried_ns) > _TOLERANCE_NS + drift:
            return False
        self._ahead_ns += min(more, drift)
        self._heard_ns = heard_ns
        return True

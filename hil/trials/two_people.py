"""Two people of one live system, recorded together: each by a connection of its own, put together by their stamps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from highfive.hil.runtime.clock import Clock
from highfive.mocap_bridge.files.recording import Recording, make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.source import Connection
from highfive.model.errors import HighFiveError

LOOK_NS = 20_000_000
"""So often it is looked at whether a recording is to end, and whether somebody is still sent, ns."""
GONE_S = 1.0
"""Without a frame of somebody for so long nobody is recorded any more, s."""
S = 1_000_000_000


class TwoPeople:
    """Who is sent by a live system under two names."""

    def __init__(self, sources: tuple[LiveSource, LiveSource], names: tuple[str, str], clock: Clock) -> None:
        """Waits for the first frame of each.

        Args:
            sources: of each.
            names: prefixes that their markers get in a recording.
            clock: this process's.

        Raises:
            HighFiveError: nothing comes.
        """
        self._sources, self._names, self._clock = sources, names, clock
        self._first = tuple(source.first() for source in sources)
        self._frames: tuple[list[MarkerFrame], list[MarkerFrame]] = [], []
        self._takes = False
        for source, frames in zip(sources, self._frames, strict=True):
            source.hear(self._taken(frames))

    @property
    def markers(self) -> tuple[int, int]:
        """How many each has."""
        return len(self._first[0].names), len(self._first[1].names)

    def record(self, seconds: float, watch: Callable[[], bool]) -> Recording:
        """What is sent from now on, for so long, or until ``watch`` says that it is enough.

        Raises:
            HighFiveError: nothing comes of somebody any more, or other markers than at first.
        """
        for frames in self._frames:
            frames.clear()
        self._takes, end = True, self._clock.now() + round(S * seconds)
        try:
            while (now := self._clock.now()) < end and not watch():
                self._check(now)
                self._clock.wait_until(min(end, now + LOOK_NS))
        finally:
            self._takes = False
        return self._together()

    def _taken(self, frames: list[MarkerFrame]) -> Callable[[MarkerFrame], None]:
        def take(frame: MarkerFrame) -> None:
            if self._takes:
                frames.append(frame)

        return take

    def _check(self, now_ns: int) -> None:
        for source, name in zip(self._sources, self._names, strict=True):
            health = source.health(now_ns)
            if health.age_ns < 0 or health.age_ns > GONE_S * S or health.connection is Connection.ENDED:
                raise HighFiveError(
                    f"nothing has come of {name} for {GONE_S:g} s ({health.trouble or 'the source is silent'}); once "
                    "it does, the same command goes on"
                )

    def _together(self) -> Recording:
        """On the frames of the system: what was lost of one of them is a gap."""
        period_ns = S / self._sources[0].rate_hz
        kept = tuple(list(frames) for frames in self._frames)
        if not all(kept):
            raise HighFiveError("not a frame came of both people")
        start = min(frames[0].source_time_ns for frames in kept)
        rows = [[round((frame.source_time_ns - start) / period_ns) for frame in frames] for frames in kept]
        count = 1 + max(max(each) for each in rows)
        columns = [f"{who}:{name}" for who, first in zip(self._names, self._first, strict=True) for name in first.names]
        points, valid = np.zeros((count, len(columns), 3)), np.zeros((count, len(columns)), dtype=bool)
        place = 0
        for first, frames, at in zip(self._first, kept, rows, strict=True):
            own = slice(place, place + len(first.names))
            place = own.stop
            for row, frame in zip(at, frames, strict=True):
                if frame.names != first.names:
                    raise HighFiveError(f"{len(frame.names)} markers come of somebody, {len(first.names)} did at first")
                if row >= 0:
                    points[row, own], valid[row, own] = frame.positions, frame.valid
        return make_recording(self._sources[0].rate_hz, columns, points, valid)

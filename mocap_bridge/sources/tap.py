"""A look at every frame of a connection as it comes, beside whoever takes the newest only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import Link
from highfive.mocap_bridge.sources.scheduler import THREADS, Now

Tap = Callable[[Sequence[MarkerFrame], float], None]
"""Gets frames, of all persons and stamped with their arrival, and of the rate, Hz (0: the system does not say).

It is called in the thread that receives, and must neither wait nor raise.
"""


class _TappedLink:
    def __init__(self, link: Link, tap: Tap, clock: Now):
        self._link, self._tap, self._clock = link, tap, clock

    @property
    def rate_hz(self) -> float:
        return self._link.rate_hz

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        frames = self._link.receive(timeout_s)
        if frames:
            now = self._clock()
            self._tap([replace(frame, arrival_time_ns=now) for frame in frames], self._link.rate_hz)
        return frames

    def close(self) -> None:
        self._link.close()


def tapped(connect: Callable[[], Link], tap: Tap, clock: Now = THREADS.now) -> Callable[[], Link]:
    """Connects as ``connect`` does, and tells ``tap`` of every frame; ``clock`` is this process's monotonic one, ns."""
    return lambda: _TappedLink(connect(), tap, clock)

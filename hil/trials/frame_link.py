"""A connection to a simulated motion capture system, in virtual time: hands over each frame when it arrives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from highfive.hil.runtime.clock import Clock
from highfive.mocap_bridge.frames import MarkerFrame


class Camera(Protocol):
    """What sends frames."""

    @property
    def next_ns(self) -> int | None:
        """When it has to be asked again, ns; None once it sends no more."""
        ...

    def arrived(self, now_ns: int) -> Sequence[MarkerFrame]:
        """The frames that have arrived since it was asked last, in their order."""
        ...


class SentFrames:
    """A :class:`Camera` whose frames are known beforehand."""

    def __init__(self, frames: Sequence[MarkerFrame]) -> None:
        """All ``frames``, in the order of their arrivals."""
        self._frames, self._next = frames, 0

    @property
    def next_ns(self) -> int | None:
        """Arrival of the next one."""
        return self._frames[self._next].arrival_time_ns if self._next < len(self._frames) else None

    def arrived(self, now_ns: int) -> Sequence[MarkerFrame]:
        """Those whose arrival is over."""
        begin = self._next
        while self._next < len(self._frames) and self._frames[self._next].arrival_time_ns <= now_ns:
            self._next += 1
        return self._frames[begin : self._next]


class FrameLink:
    """One connection; a :class:`highfive.mocap_bridge.sources.live.Link`."""

    def __init__(self, clock: Clock, rate_hz: float, camera: Camera) -> None:
        """To a camera of so many frames a second."""
        self._clock, self.rate_hz, self._camera = clock, rate_hz, camera

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """Those that have arrived, once there are any; none after so many s."""
        until = self._clock.now() + round(1e9 * timeout_s)
        while not (found := self._camera.arrived(self._clock.now())) and self._clock.now() < until:
            due = self._camera.next_ns
            self._clock.wait_until(until if due is None else min(due, until))
        return found

    def close(self) -> None:
        """Nothing to let go of."""

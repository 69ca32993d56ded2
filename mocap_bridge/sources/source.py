"""Where marker frames come from: the one interface of all sources, and the replay of a recording.

A source gives its newest frame at a time. It never waits and never queues: whoever asks late gets the
newest frame, not the oldest one unread (a queue of even one frame cost users of such bridges 200 to 500 ms).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from highfive.mocap_bridge.files.recording import Recording, resample
from highfive.mocap_bridge.frames import MarkerFrame

RATE_HZ = 120.0
"""Frame rate of the project, Hz."""


class Connection(Enum):
    """State of a source's connection."""

    CONNECTING = "connecting"
    LIVE = "live"
    STALLED = "stalled"
    ENDED = "ended"


@dataclass(frozen=True)
class SourceHealth:
    """How a source is doing.

    Attributes:
        connection: state of the connection.
        age_ns: time since the newest frame arrived, ns; -1 before the first.
        received: frames that arrived so far.
        lost: frames that never arrived, from gaps in the source's frame numbers.
        trouble: why there is no newer frame, in one line; '' where there is nothing to say.
        refused: frames that arrived and could not be used: of another unit, or without the person.
        arrived_ns: when the newest of the frames that were ``received`` arrived, whether it could be used or not, ns.
        impossible: markers of all frames that were left out for coordinates that cannot be meant.
        hopeless: ``trouble`` is not mended by waiting.
        unlikely_latency_ns: what the system last said of its latency that it cannot mean, ns; 0 if it never did.
    """

    connection: Connection
    age_ns: int
    received: int
    lost: int
    trouble: str = ""
    refused: int = 0
    arrived_ns: int = 0
    impossible: int = 0
    hopeless: bool = False
    unlikely_latency_ns: int = 0


class Source(Protocol):
    """Anything that gives marker frames."""

    @property
    def rate_hz(self) -> float:
        """Nominal frames per second."""
        ...

    def newest(self, now_ns: int) -> MarkerFrame | None:
        """The newest frame at time ``now_ns`` of this process's monotonic clock; None before the first. Never waits."""
        ...

    def health(self, now_ns: int) -> SourceHealth:
        """State of the connection at time ``now_ns``."""
        ...

    def close(self) -> None:
        """Lets go of sockets and threads; a second call does nothing."""
        ...


class C3DSource:
    """Replays one person of a recording at ``rate_hz``.

    The clock is the caller's: pass one that counts ticks to step through the frames as fast as they are needed, with
    the same result every time, or the monotonic clock to replay in real time. Iteration gives every frame in order.
    """

    def __init__(self, recording: Recording, rate_hz: float = RATE_HZ, start_ns: int = 0):
        """Args: ``recording`` of one person (no prefixes); ``start_ns`` is the time at which frame 0 arrives."""
        self._recording = resample(recording, rate_hz)
        self._rate_hz = rate_hz
        self._start_ns = start_ns

    @property
    def rate_hz(self) -> float:
        """Frames per second, after resampling."""
        return self._rate_hz

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._recording)

    def __iter__(self) -> Iterator[MarkerFrame]:
        """Every frame in order."""
        return (self.frame(number) for number in range(len(self)))

    def frame(self, number: int) -> MarkerFrame:
        """Frame ``number``, counted from 0."""
        return self._recording.frame(number, number, self._rate_hz, self._start_ns)

    def newest(self, now_ns: int) -> MarkerFrame | None:
        """The frame that a live system would have sent last; after the end the last one."""
        number = self._number(now_ns)
        return None if number < 0 else self.frame(min(number, len(self) - 1))

    def health(self, now_ns: int) -> SourceHealth:
        """Live until the last frame's period is over."""
        number = self._number(now_ns)
        if number < 0:
            return SourceHealth(Connection.CONNECTING, -1, 0, 0)
        last = min(number, len(self) - 1)
        age_ns = now_ns - self._start_ns - round(last * 1e9 / self._rate_hz)
        state = Connection.LIVE if number < len(self) else Connection.ENDED
        return SourceHealth(state, age_ns, last + 1, 0, arrived_ns=now_ns - age_ns)

    def close(self) -> None:
        """Nothing to let go of."""

    def _number(self, now_ns: int) -> int:
        # Half a nanosecond of tolerance, so that the rounded time stamp of a frame already counts as its time.
        return int(((now_ns - self._start_ns + 0.5) * self._rate_hz) // 1e9)

"""A recording sent out at its rate, as a live system would: for tests, and for whoever has no such system."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Protocol

from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.servers.faults import Faults
from highfive.mocap_bridge.sources.scheduler import THREADS, Now

LOOPBACK = "127.0.0.1"


class Stop(Protocol):
    """What ends the sending: a ``threading.Event``, or anything that waits like one."""

    def is_set(self) -> bool:
        """Whether to end."""
        ...

    def wait(self, timeout: float | None = None) -> bool:
        """Waits until it is time to end, for so many s at most; whether it is."""
        ...


class Server(Protocol):
    """What plays a live system in one protocol. It listens from the moment it is made."""

    @property
    def port(self) -> int:
        """The port that it listens at."""
        ...

    @property
    def sent_ns(self) -> int:
        """When the last frame went to the operating system, ns on the monotonic clock; 0 before the first."""
        ...

    def send(self, frame: MarkerFrame) -> None:
        """Sends a frame to every client that requested frames; never waits for one that is slow.

        Points that are not valid are sent as the protocol shows a hidden marker; coordinates that are no numbers are
        sent as they are. Names hold the person before a colon.
        """
        ...

    def hang_up(self) -> None:
        """Breaks every connection and takes no new one, as a system that is switched off, until :meth:`answer`."""
        ...

    def answer(self) -> None:
        """Takes connections again."""
        ...

    def close(self) -> None:
        """Ends everything; a second call does nothing."""
        ...


def frames_of(recording: Recording, loop: bool = False) -> Iterator[MarkerFrame]:
    """The recording's frames, again from the start for ever if ``loop``; numbers and times go on."""
    number = 0
    while True:
        for k in range(len(recording)):
            time_ns = round(number * 1e9 / recording.rate_hz)
            loose = recording.unlabelled[k, recording.unlabelled_valid[k]]
            yield MarkerFrame(recording.names, recording.points[k], recording.valid[k], number, time_ns, time_ns, loose)
            number += 1
        if not loop or not len(recording):
            return


def serve(
    recording: Recording,
    server: Server,
    faults: Faults | None = None,
    loop: bool = False,
    stop: Stop | None = None,
    sent: Callable[[MarkerFrame], None] = lambda frame: None,
    clock: Now = THREADS.now,
) -> None:
    """Sends the frames of ``recording`` at their times until its end, or until ``stop``.

    Args:
        recording: of one person or several.
        server: where to.
        faults: what goes wrong on the way, and when.
        loop: begin again at the end.
        stop: ends it from another thread.
        sent: called after each frame that was sent.
        clock: monotonic, ns; the one that ``stop`` waits by.
    """
    stop, faults = stop or threading.Event(), faults or Faults(())
    start, up = clock(), True
    for frame in frames_of(recording, loop):
        wait_s = (start + frame.source_time_ns - clock()) * 1e-9
        if (wait_s > 0.0 and stop.wait(wait_s)) or stop.is_set():
            return
        if faults.connected(frame.source_time_ns) != up:
            up = not up
            server.answer() if up else server.hang_up()
        for changed in faults.of(frame):
            server.send(changed)
            sent(changed)

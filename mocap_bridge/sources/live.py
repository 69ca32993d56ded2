"""A live system kept in touch with: a thread receives, connects again, and keeps the newest frame only.

What is the same for every protocol is here; what differs, one connection and what comes through it, is a :class:`Link`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from highfive.mocap_bridge.files.recording import SeveralPersons, columns_of_person, labels_without_prefix
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.frame_check import check_frame, checked_rate
from highfive.mocap_bridge.sources.scheduler import THREADS, Scheduler
from highfive.mocap_bridge.sources.source import Connection, SourceHealth
from highfive.mocap_bridge.sources.stamp_clock import StampClock
from highfive.mocap_bridge.sources.steady_time import ClockEstimate, SteadyTime
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.plausible import FARTHEST_M, LONGEST_LATENCY_NS, of_another_unit, spans
from highfive.model.errors import HighFiveError
from highfive.model.plugins import fault

STALLED_S, STALLED_FRAMES = 0.25, 4.0
"""Without a frame for so long, s, and for so many of its frames, a source counts as stalled."""

SILENT_S = 1.0
"""Without a frame for so long a connection is taken for dead, and made anew, s."""

HANGS_S = 2.0
"""A connection that has not answered for so long hangs, s: it was to wait for a tenth of a second."""

BACK_OFF_S = (0.1, 2.0)
"""First and longest pause before the next attempt to connect, s; it doubles in between."""

PACE_SHARE = 0.05
"""Share of a frame in the averaged period."""

LONGEST_GAP = 100_000
"""A frame number that is further ahead says that the system started to count anew, not that so many were lost."""

REORDERED = 10
"""A frame number that is so little behind the newest says that the network changed the order."""


class Link(Protocol):
    """One connection to a system."""

    @property
    def rate_hz(self) -> float:
        """Frames per second as the system says; 0 where it does not say."""
        ...

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """Whole frames that have come, oldest first; waits up to ``timeout_s`` for something to come.

        Names keep the system's prefix of the person (``'Subject:RFIN'``). Positions are in metres, z up; a marker that
        is not seen is not valid, nor one whose coordinates cannot be meant
        (:mod:`highfive.mocap_bridge.wire.plausible`).

        Raises:
            LinkError: the connection is lost, or what came is not of the protocol.
        """
        ...

    def close(self) -> None:
        """Lets go of the connection."""
        ...


class LiveSource:
    """A source (see :class:`highfive.mocap_bridge.sources.source.Source`) that follows a live system until it is
    closed.
    """

    def __init__(
        self,
        title: str,
        connect: Callable[[], Link],
        person: str | None = None,
        rate_hz: float = 120.0,
        scheduler: Scheduler = THREADS,
        beside: Collection[str] = (),
    ):
        """Starts to connect, in a thread of its own.

        Args:
            title: the system's address, for messages.
            connect: makes a connection, or raises :class:`LinkError`, within a second or two.
            person: prefix of the person's markers; None takes the only one there is, and
                :data:`~highfive.mocap_bridge.files.recording.EVERYBODY` all of them.
            rate_hz: frames per second where the system does not say.
            scheduler: this process's monotonic clock, and what starts the thread.
            beside: labels of what is no person, such as an arm's plate.
        """
        self._title, self._connect, self._person, self._now = title, connect, person, scheduler.now
        self._beside = frozenset(beside)
        self._rate_hz = rate_hz
        self._changed = scheduler.condition()
        self._newest: MarkerFrame | None = None
        self._number: int | None = None  # of the newest frame that came, whether it could be used or not
        self._received = self._lost = self._refused = self._impossible = self._unlikely_latency_ns = 0
        self._stamps = StampClock()
        self._steady = SteadyTime(self._stamps)
        self._stamped: int | None = None
        self._period_ns = 1e9 / rate_hz  # of the frames, by their stamps
        self._came = 0, 0  # frames, and when the newest of them arrived, ns: read together
        self._hopeless = False
        self._linked = False
        self._asked_ns: int | None = None  # when the connection was asked for frames, as long as it has not answered
        self._trouble = "connecting"
        self._closing = False
        self._names: tuple[str, ...] | None = None  # as they come, with their prefixes
        self._own_names: tuple[str, ...] = ()
        self._columns = np.zeros(0, dtype=np.intp)
        self._heard: tuple[Callable[[MarkerFrame], None], ...] = ()  # replaced as a whole
        self._task = scheduler.start(f"source {title}", self._run)

    def hear(self, take: Callable[[MarkerFrame], None]) -> None:
        """From now on ``take`` is given each frame that is kept, in the thread that receives: it must neither wait nor
        raise."""
        self._heard = (*self._heard, take)

    @property
    def parts(self) -> Sequence[LiveSource]:
        """The systems that it is of, each with a clock of its own: itself, where it is one."""
        return (self,)

    @property
    def rate_hz(self) -> float:
        """Frames per second, as the system says once it is connected."""
        return self._rate_hz

    def newest(self, now_ns: int) -> MarkerFrame | None:
        """The newest frame; None before the first. Never waits."""
        return self._newest

    @property
    def period_ns(self) -> float:
        """From frame to frame by the system's stamps, averaged over some tens of them, ns."""
        return self._period_ns

    @property
    def title(self) -> str:
        """The system's address, for messages."""
        return self._title

    @property
    def stamps(self) -> ClockEstimate:
        """The system's clock by the arrivals of its frames; the source keeps it up to date."""
        return self._stamps

    def captured(self, frame: MarkerFrame) -> int:
        """When the cameras saw a frame, ns of this process's monotonic clock; it does not go back from frame to frame,
        unless a clock was set (:attr:`stamps`).

        What the least delay of network and system is beyond what the system reports of it, nobody here can know.
        """
        stamp = frame.source_time_ns if frame.own_clock else self._steady.foreseen(frame.source_time_ns)
        return stamp - frame.latency_ns

    def wait(self, seen: MarkerFrame | None, timeout_s: float) -> MarkerFrame | None:
        """The newest frame as soon as it is another than ``seen``; None if that takes longer than ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not seen or self._closing, timeout_s)
            return self._newest if self._newest is not seen else None

    def first(self, timeout_s: float = 5.0) -> MarkerFrame:
        """The newest frame, waiting for the first one if there is none yet.

        Raises:
            SeveralPersons: there is nothing to wait for.
            HighFiveError: none came in time; the message says what stood in the way.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._hopeless or self._closing, timeout_s)
            frame = self._newest
        if frame is None and self._hopeless:
            raise SeveralPersons(self._trouble)
        if frame is None:
            raise HighFiveError(
                f"{self._title}: no frame came within {timeout_s:g} s ({self._trouble or 'nothing was sent'})"
            )
        return frame

    def health(self, now_ns: int) -> SourceHealth:
        """State of the connection."""
        newest = self._newest
        age_ns = -1 if newest is None else max(0, now_ns - newest.arrival_time_ns)
        if self._closing:
            state = Connection.ENDED
        elif newest is None or not self._linked:
            state = Connection.CONNECTING
        else:
            patience_ns = max(STALLED_S * 1e9, STALLED_FRAMES * self._period_ns)
            state = Connection.LIVE if age_ns <= patience_ns else Connection.STALLED
        received, arrived_ns = self._came
        asked_ns = self._asked_ns
        hangs = asked_ns is not None and now_ns - asked_ns > HANGS_S * 1e9
        return SourceHealth(
            state,
            age_ns,
            received,
            self._lost,
            f"{self._title}: receive() has not returned; it may wait for 0.1 s" if hangs else self._trouble,
            self._refused,
            arrived_ns,
            self._impossible,
            self._hopeless and newest is None,
            self._unlikely_latency_ns,
        )

    def close(self) -> None:
        """Ends the thread and the connection."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._task is not threading.current_thread():
            self._task.join(timeout=5.0)

    def _run(self) -> None:
        pause = BACK_OFF_S[0]
        while not self._closing:
            before = self._received
            try:
                self._follow()
            except (Exception, SystemExit) as error:  # a source whose thread has died would be silent for ever
                reason = str(error) if isinstance(error, HighFiveError) else f"{self._title}: {fault(error)}"
                self._trouble, self._hopeless = reason, False
            self._linked = False
            pause = BACK_OFF_S[0] if self._received > before else min(2.0 * pause, BACK_OFF_S[1])
            with self._changed:
                self._changed.wait_for(lambda: self._closing, pause)

    def _follow(self) -> None:
        """Takes frames from one connection until it is lost."""
        link = self._connect()
        try:
            self._linked, last = True, self._now()
            while not self._closing:
                self._asked_ns = self._now()
                frames = link.receive(0.1)
                self._asked_ns, now = None, self._now()
                if frames:
                    last = now
                    self._rate_hz = checked_rate(link.rate_hz, self._title) or self._rate_hz
                    self._take(frames, now)
                elif now - last > SILENT_S * 1e9:
                    raise LinkError(f"connected, but nothing has come for {SILENT_S:g} s")
        finally:
            self._asked_ns = None
            link.close()

    def _take(self, frames: Sequence[MarkerFrame], now: int) -> None:
        """Counts what came and keeps the newest."""
        newest, received = None, self._received
        for frame in frames:
            check_frame(frame, self._title)
            step = 1 if self._number is None else frame.number - self._number
            if -REORDERED <= step <= 0:  # late: it was counted as lost; or the same once more
                self._lost -= 1 if step and self._lost else 0
                continue
            self._received += 1
            self._lost += step - 1 if 1 < step <= LONGEST_GAP else 0
            self._impossible += frame.impossible
            if self._stamped is not None:
                self._pace(frame, step)
            self._stamped = frame.source_time_ns
            self._number, newest = frame.number, frame
        if newest is None:
            return
        if not 0 <= newest.latency_ns <= LONGEST_LATENCY_NS:
            self._unlikely_latency_ns, newest = newest.latency_ns, replace(newest, latency_ns=0)
        self._came = self._received, now
        self._stamps.update(newest.source_time_ns, now)
        self._steady.local(newest.source_time_ns)
        try:
            newest = replace(self._of_person(newest), arrival_time_ns=now)
        except HighFiveError as error:
            with self._changed:
                self._trouble, self._refused = str(error), self._refused + self._received - received
                self._hopeless = isinstance(error, SeveralPersons)
                self._changed.notify_all()
            return
        with self._changed:
            self._newest, self._trouble, self._hopeless = newest, "", False
            self._changed.notify_all()
        for take in self._heard:
            take(newest)

    def _pace(self, frame: MarkerFrame, step: int) -> None:
        """Averages the period of the frames; a gap in their numbers does not count."""
        elapsed = frame.source_time_ns - (self._stamped or 0)
        if step == 1 and 0 < elapsed < max(STALLED_S * 1e9, STALLED_FRAMES * self._period_ns):
            self._period_ns += PACE_SHARE * (elapsed - self._period_ns)

    def _of_person(self, frame: MarkerFrame) -> MarkerFrame:
        """The person's part of a frame, if it is of the right unit."""
        if frame.names is not self._names and frame.names != self._names:
            columns = columns_of_person(frame.names, self._person, self._title, self._beside)
            self._own_names = labels_without_prefix([frame.names[m] for m in columns])
            self._columns = np.array(columns, dtype=np.intp)
        self._names = frame.names
        points, valid = frame.positions[self._columns], frame.valid[self._columns]
        valid = valid & np.isfinite(points).all(axis=1)  # a plug-in may forget that missing is a mask
        if frame.impossible > frame.valid.sum():
            raise HighFiveError(
                f"most markers are further than {FARTHEST_M:g} m away: "
                f"{self._title} sends another unit than its protocol says; set it right there"
            )
        if of_another_unit(span := spans(points, valid)):
            raise HighFiveError(
                f"the markers span {span:.3g} m, a person spans about 2 m: "
                f"{self._title} sends another unit than its protocol says; set it right there"
            )
        covariance = None if frame.covariance is None else frame.covariance[self._columns]
        return replace(frame, names=self._own_names, positions=points, valid=valid, covariance=covariance)

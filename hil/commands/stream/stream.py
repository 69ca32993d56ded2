"""``highfive stream``: listens to a live system and shows how well it comes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.live import Live

from highfive.hil.commands.stream.arm import ArmThread, arm_follower, choose_marker_set, prepare_tracker
from highfive.hil.commands.stream.record import Recorder, recover
from highfive.hil.commands.stream.screen import StreamView, arm_text, plain_line, screen
from highfive.hil.commands.stream.statistics import StreamStatistics
from highfive.hil.runtime.console import STDERR
from highfive.hil.runtime.shutdown import EndRequest, until_ended
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.trials.live_wiring import MACHINE_WIRING, LiveWiring
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.address import open_source, parse_address
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.scheme import FILE, Address
from highfive.mocap_bridge.sources.source import Connection, Source, SourceHealth
from highfive.model.errors import HighFiveError

FIRST_FRAME_S = 5.0
"""With ``--seconds``, how long the first frame that can be used may take at least, s: a person may be tracked later."""

_SCREENS_A_SECOND = 8.0
_POLL_S = 1e-3
_CURRENT = (Connection.LIVE, Connection.ENDED)  # an arm of another time is not shown


@dataclass(frozen=True)
class StreamOptions:
    """What to listen to.

    Attributes:
        address: as :func:`highfive.mocap_bridge.sources.address.parse_address` reads it.
        person: prefix of the person's markers; None takes the only one there is.
        seconds: end so long after the first frame; None until ended.
        record: C3D file for everything that comes.
        marker_set: name or path; None finds one.
        quiet: show nothing where there is no terminal.
        overwrite: replace the file that is recorded to.
    """

    address: str
    person: str | None = None
    seconds: float | None = None
    record: Path | None = None
    marker_set: str | None = None
    quiet: bool = False
    overwrite: bool = False


def stream(options: StreamOptions, say: Callable[[str], None], wiring: LiveWiring = MACHINE_WIRING) -> dict[str, Any]:
    """Listens until the time is over, the file has ended, or it is ended; ``say`` gets lines about it.

    Args:
        options: what to listen to.
        say: shows a line.
        wiring: clock, threads and network.

    Returns:
        The summary. Its ``frames`` is 0 if none came; ``trouble`` then says why.

    Raises:
        HighFiveError: a bad address, person, marker set or file to record to.
    """
    address = parse_address(options.address)
    recorder = None
    if options.record is not None and address.scheme == FILE:
        raise HighFiveError(f"{address} is a recording already; --record goes with a live system")
    if options.record is not None:
        if options.record.suffix.lower() == ".c3d" and (line := recover(options.record)):
            say(line)
        recorder = Recorder(options.record, options.overwrite)
    with STDERR.status("starting …") if STDERR.is_terminal else nullcontext():
        prepare_tracker(say)  # the seconds count from the first frame
    try:
        with quick_switching(), until_ended() as end:
            source = open_source(address, options.person, None, recorder, wiring.scheduler, wiring.connects)
            listener = _Listener(options, source, wiring)
            try:
                listener.run(end, recorder)
            finally:
                summary = listener.summary(address)
                listener.close()
    finally:
        unsaved = "" if recorder is None else _finished(recorder, say)
    if recorder is not None:
        summary["recording"] = str(options.record) if recorder.frames and not unsaved else None
        summary["recording_trouble"] = unsaved or recorder.trouble
    return summary


def _finished(recorder: Recorder, say: Callable[[str], None]) -> str:
    """Finishes a recording and tells how; what kept it from being saved, '' where nothing did."""
    try:
        saved, unsaved = recorder.finish(), ""
    except HighFiveError as error:
        saved, unsaved = "", str(error)
    for line in (recorder.trouble, saved, unsaved):
        if line:
            say(line)
    return unsaved


class _Listener:
    """Takes frames in one thread, follows the arm in another, shows both in the main one."""

    def __init__(self, options: StreamOptions, source: Source, wiring: LiveWiring):
        self._options, self._source = options, source
        self._clock, self._scheduler = wiring.clock, wiring.scheduler
        self._statistics = StreamStatistics()
        self._arm: ArmThread | None = None
        self._marker_set: str | None = None  # not looked for yet; '' where none fits
        self._first: tuple[MarkerFrame, SourceHealth] | None = None  # and how the source was then
        self._reported: str | None = None  # why nothing comes
        self._changed, self._closing = wiring.scheduler.condition(), False
        self._task = wiring.scheduler.start("statistics", self._take)

    def run(self, end: EndRequest, recorder: Recorder | None) -> None:
        """Shows what comes until it is over."""
        on_screen = STDERR.is_terminal
        pause = 1.0 / _SCREENS_A_SECOND
        start = self._clock.now()
        next_line = start + 10**9
        live = Live(console=STDERR, auto_refresh=False, transient=False) if on_screen else None
        if live is not None:
            live.start()
        try:
            while not self._clock.wait_for(end, self._clock.now() + round(1e9 * min(pause, self._left()))):
                self._follow_arm()
                if self._over(start):
                    break
                if live is not None:
                    live.update(screen(self._view(recorder), STDERR.width, STDERR.height), refresh=True)
                elif not self._options.quiet and self._clock.now() >= next_line:
                    next_line += 10**9
                    self._tell(self._view(recorder), 1e-9 * (self._clock.now() - start))
        finally:
            if live is not None:
                live.update(screen(self._view(recorder), STDERR.width, STDERR.height), refresh=True)
                live.stop()

    def _tell(self, view: StreamView, waited_s: float) -> None:
        """A line about what comes; where nothing has come yet, about why, if that is not soon over and is news."""
        if self._first is None:
            if waited_s < FIRST_FRAME_S or view.health.trouble == self._reported:
                return
            self._reported = view.health.trouble
        STDERR.print(plain_line(view), markup=False, soft_wrap=True)

    def close(self) -> None:
        """Ends the threads and the source."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._arm is not None:
            self._arm.close()
        self._source.close()
        self._task.join(timeout=5.0)

    def summary(self, address: Address) -> dict[str, Any]:
        """The figures for machines."""
        now = self._clock.now()
        health, seen = self._source.health(now), self._statistics.snapshot(now)
        arm = self._arm.newest if self._arm is not None else None
        return {
            "source": str(address),
            "connection": health.connection.value,
            "trouble": health.trouble,
            "frames": health.received - health.refused,
            "lost_frames": health.lost,
            "refused_frames": health.refused,
            "impossible_markers": health.impossible,
            "rate_hz": round(self._rate(health), 3),
            "nominal_rate_hz": None if self._first is None else self._source.rate_hz,
            "age_ms": _rounded(zip(("p50", "p99", "max"), seen.age_ms, strict=True)),
            "jitter_ms": _rounded(zip(("std", "p99"), seen.jitter_ms, strict=True)),
            "markers": _rounded(zip(seen.names, seen.share, strict=True)),
            "marker_set": self._marker_set or None,
            "without_label": {"mean": round(seen.unlabelled_mean, 3), "max": seen.unlabelled_max},
            "labels_not_believed": {} if self._arm is None else dict(self._arm.rejected),
            "arm": None
            if arm is None or not arm.valid
            else {
                "elbow_flexion_deg": round(float(np.degrees(arm.elbow_flexion)), 2),
                "shoulder_elevation_deg": round(float(np.degrees(arm.shoulder_elevation)), 2),
                "hand_m": [round(float(x), 4) for x in arm.hand],
                "text": arm_text(arm),
            },
        }

    def _take(self) -> None:
        seen = None
        while not self._closing:
            frame = self._wait(seen)
            now = self._clock.now()
            if frame is None:
                continue
            seen = frame
            self._statistics.add(frame, now)
            if self._first is None:
                self._first = frame, self._source.health(now)
            if self._arm is not None:
                self._arm.offer(frame)

    def _wait(self, seen: MarkerFrame | None) -> MarkerFrame | None:
        """The frame after ``seen``, or None if none comes within a tenth of a second."""
        if isinstance(self._source, LiveSource):
            return self._source.wait(seen, 0.1)
        for _ in range(round(0.1 / _POLL_S)):
            frame = self._source.newest(self._clock.now())
            if frame is not None and (seen is None or frame.number != seen.number):
                return frame
            with self._changed:
                if self._changed.wait_for(lambda: self._closing, _POLL_S):
                    return None
        return None

    def _follow_arm(self) -> None:
        """Starts to follow the arm as soon as the labels are known."""
        if self._first is None or self._marker_set is not None:
            return
        marker_set = choose_marker_set(self._first[0].names, self._options.marker_set)
        self._marker_set = "" if marker_set is None else marker_set.name
        if marker_set is not None:
            self._arm = ArmThread(arm_follower(marker_set, self._source.rate_hz), self._scheduler)

    def _left(self) -> float:
        """Seconds until the end, where that is known; never none."""
        if self._options.seconds is None or self._first is None:
            return 1.0
        return max(1e-3, self._options.seconds - (self._clock.now() - self._first[0].arrival_time_ns) * 1e-9)

    def _over(self, start: int) -> bool:
        """Whether there is nothing more to wait for.

        Raises:
            HighFiveError: frames come, but cannot be used.
        """
        now = self._clock.now()
        health = self._source.health(now)
        if health.connection is Connection.ENDED:
            return True
        if health.hopeless:
            raise HighFiveError(health.trouble)
        if self._options.seconds is None:
            return False
        if self._first is not None:
            return (now - self._first[0].arrival_time_ns) * 1e-9 >= self._options.seconds
        if 1e-9 * (self._clock.now() - start) < max(self._options.seconds, FIRST_FRAME_S):
            return False
        if health.received and health.trouble:
            raise HighFiveError(health.trouble)
        return True

    def _rate(self, health: SourceHealth) -> float:
        """Frames received per second, used or refused, from the first that was looked at to the newest, Hz."""
        if self._first is None:
            return 0.0
        elapsed = (health.arrived_ns - self._first[1].arrived_ns) * 1e-9
        return (health.received - self._first[1].received) / elapsed if elapsed > 0.0 else 0.0

    def _view(self, recorder: Recorder | None) -> StreamView:
        health = self._source.health(self._clock.now())
        notes = []
        if recorder is not None:
            notes.append(recorder.trouble or f"recording to {self._options.record}: {recorder.frames} frames")
        if self._arm is not None and self._arm.trouble:
            notes.append(f"right arm: {self._arm.trouble}")
        return StreamView(
            title=self._options.address,
            health=health,
            nominal_hz=self._source.rate_hz,
            seen=self._statistics.snapshot(self._clock.now()),
            marker_set=self._marker_set or "",
            arm=self._arm.newest if self._arm is not None and health.connection in _CURRENT else None,
            notes=tuple(notes),
        )


def _rounded(values: Any) -> dict[str, float]:
    return {name: round(float(value), 4) for name, value in values}

"""A live person: who is there, where the avatar is to stand, and the frames of one trial at 120 Hz."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.placement import Placement, place_person
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.session.reach import Phase
from highfive.hil.session.session import RATE_HZ, Tick
from highfive.hil.trials.live_wiring import MACHINE_WIRING, LiveWiring
from highfive.hil.trials.partners import Partner
from highfive.mocap_bridge.files.recording import Recording, make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.address import open_source
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.source import Connection
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

PRACTICE_S = 5.0
"""For so long the person is looked at before the first trial, s: with the hand raised once, that is where it is met."""

STALE_S = 0.1
"""An older frame says nothing any more of where a marker is, s."""

RESTING_S, RESTING_SPEED = 0.3, 0.3
"""A hand that was slower than this, m/s, for so long, s, rests: only then does a trial begin."""

LONGEST_S = 15.0
"""A trial in which no hand is raised ends after so long, s."""

AFTERWARDS_S = 0.5
"""A trial goes on for so long after the avatar has let go, s."""

SILENT_S = 2.0
"""A source that says nothing for so long while the person is looked at is given up, s."""

GONE_S = 5.0
"""A source from which nothing has come for so long is given up, s."""

TICK_NS = round(1e9 / RATE_HZ)
LONGEST_STEP_NS = 500_000_000
"""A system's clock that goes on by more from frame to frame was set, ns."""


def live_source(address: str, person: str | None, wiring: LiveWiring = MACHINE_WIRING) -> LiveSource:
    """The source at an address of a live system."""
    source = open_source(address, person, scheduler=wiring.scheduler, connects=wiring.connects)
    if not isinstance(source, LiveSource):
        raise HighFiveError(f"{address} is no live system")
    return source


class LivePerson:
    """Follows a live source; makes of it partners, and frames in the avatar's world."""

    def __init__(
        self,
        source: LiveSource,
        address: str,
        marker_set: MarkerSet | None = None,
        registered: Placement | None = None,
        clock: Clock = MACHINE,
    ):
        """Waits for the first frame, finds the marker set, and watches the person for :data:`PRACTICE_S`.

        Where the room is ``registered`` the world lies where that says: nobody is watched, and the person comes to it.

        Raises:
            HighFiveError: nothing comes, no marker set fits, or the person is not seen well enough to be placed.
        """
        self._source, self._address, self._clock = source, address, clock
        first = source.first()
        self._set = marker_set or find_marker_set(first.names)
        self._set.arrange(first.names, first.positions, first.valid, self._set.arm.markers)  # all there?
        say_aside(f"{address}: {len(first.names)} markers, set {self._set.name}")
        if registered is not None:
            say_aside(registered.notes[0])
            self._placement = registered
            return
        say_aside(
            f"for {PRACTICE_S:g} s now: raise the right hand once, as for a high five; there the avatar will meet it"
        )
        watched = self._watched(first)
        self._placement = place_person(watched, self._set)
        say_aside(f"hand seen{self._height(watched.names, self._placement.apply(watched.points), watched.valid)}")

    def partner(self, emotion: str) -> Partner:
        """The person, to be answered in an emotion."""
        count = len(self._set)
        none = make_recording(RATE_HZ, self._set.names, np.zeros((0, count, 3)), np.zeros((0, count), dtype=bool))
        notes = (f"live from {self._address}", *self._placement.notes)
        return Partner(self._address, emotion, "", False, none, self._set, -1, None, None, notes)

    def trial(self) -> LiveTrial:
        """The frames of the next trial, once the hand rests; it is not waited for longer than :data:`LONGEST_S`."""
        hand = self._set.indices((*self._set.arm.wrist, *self._set.arm.hand))
        since = self._clock.now()
        end, before = since + 1e9 * LONGEST_S, None
        while self._clock.now() < end and self._clock.now() - since < 1e9 * RESTING_S:
            frame = self._source.wait(before, 0.2)
            if frame is None:
                break
            points, seen = self._set.arrange(frame.names, frame.positions, frame.valid)
            if before is not None and seen[hand].any():
                earlier, there = self._set.arrange(before.names, before.positions, before.valid)
                both = hand[seen[hand] & there[hand]]
                seconds = 1e-9 * (frame.source_time_ns - before.source_time_ns)
                steps = np.linalg.norm(points[both] - earlier[both], axis=1)
                if seconds <= 0.0 or (len(both) and float(np.median(steps)) > RESTING_SPEED * seconds):
                    since = self._clock.now()
            before = frame
        return LiveTrial(self._source, self._placement, self._clock)

    def _height(self, names: tuple[str, ...], points: Array, valid: NDArray[np.bool_]) -> str:
        """How high the right hand comes, in words, in points (T, M, 3), m, where they are ``valid``; '' for never."""
        points, seen = self._set.arrange(names, points, valid)
        hand = self._set.indices(self._set.arm.hand or self._set.arm.wrist)
        whole = seen[:, hand].all(axis=1)
        return f" at {points[whole][:, hand, 2].mean(axis=1).max():.2f} m" if whole.any() else ""

    def _watched(self, first: MarkerFrame) -> Recording:
        """What the person did for some seconds, in the system's own frame."""
        frames, newest, end = [first], first, self._clock.now() + round(1e9 * PRACTICE_S)
        said = math.ceil(PRACTICE_S)
        while (left := 1e-9 * (end - self._clock.now())) > 0.0:
            if math.ceil(left) < said:
                said = math.ceil(left)
                height = self._height(newest.names, newest.positions[None], newest.valid[None])
                say_aside(f"{said} s{height and f', hand{height}'}")
            frame = self._source.wait(newest, min(left, 0.1))
            if frame is not None and frame.names == first.names:
                frames.append(newest := frame)
            elif frame is None and (health := self._source.health(self._clock.now())).age_ns > SILENT_S * 1e9:
                raise HighFiveError(f"{self._address}: nothing comes any more ({health.trouble or 'it is silent'})")
        points, valid = np.array([f.positions for f in frames]), np.array([f.valid for f in frames])
        return replace(make_recording(RATE_HZ, first.names, points, valid), source=self._address)


class LiveTrial:
    """The frames of one trial, at their time; ends once a high five is over.

    Attributes:
        late: ticks that began more than a millisecond after their time.
        stale: ticks without a new frame.
        count: ticks so far.
        trouble: why the trial ended early, '' if it did not: nothing has come for :data:`GONE_S`.
    """

    def __init__(self, source: LiveSource, placement: Placement, clock: Clock = MACHINE):
        """Begins with the first frame that is requested."""
        self._source, self._placement, self._clock = source, placement, clock
        self.late, self.stale, self.trouble = 0, 0, ""
        self._reached, self._idle, self.count = False, 0, 0

    def begins(self) -> bool:
        """Whether there is a source to play with; if not, ``trouble`` says why."""
        return not self._is_gone(self._clock.now())

    def _is_gone(self, now: int) -> bool:
        health = self._source.health(now)
        gone = health.age_ns < 0 or health.age_ns > GONE_S * 1e9 or health.connection is Connection.ENDED
        if gone:
            self.trouble = f"nothing has come for {GONE_S:g} s ({health.trouble or 'the source is silent'})"
        return gone

    def __iter__(self) -> Iterator[MarkerFrame]:
        """A frame each tick, in the avatar's world; one without markers where there is nothing new."""
        start, last, first, stamp = self._clock.now(), None, 0, -TICK_NS
        while not self._is_over():
            due = start + self.count * TICK_NS
            self.late += due - self._clock.now() < -1_000_000
            self._clock.wait_until(due)
            now = self._clock.now()
            newest = self._source.newest(now)
            health = self._source.health(now)
            if newest is None or self._is_gone(now):
                return
            fresh = newest is not last and health.age_ns < STALE_S * 1e9
            self.stale += not fresh
            if last is None:
                first = newest.source_time_ns
            last = newest
            # The system's own clock, which does not jitter; where there is nothing new, time goes on by a tick.
            own = newest.source_time_ns - first if fresh else stamp + TICK_NS
            stamp = own if stamp < own < stamp + LONGEST_STEP_NS else stamp + TICK_NS
            yield self._placed(newest, fresh, stamp)
            self.count += 1

    def watch(self, tick: Tick) -> None:
        """Sees each tick, to know when the high five is over."""
        idle = tick.target.phase is Phase.IDLE
        self._reached = self._reached or not idle
        self._idle = self._idle + 1 if idle and self._reached else 0

    def _is_over(self) -> bool:
        return self._idle > AFTERWARDS_S * RATE_HZ or self.count > LONGEST_S * RATE_HZ

    def _placed(self, frame: MarkerFrame, fresh: bool, time_ns: int) -> MarkerFrame:
        valid = frame.valid if fresh else np.zeros_like(frame.valid)
        loose = self._placement.apply(frame.unlabelled) if fresh else np.zeros((0, 3))
        return replace(
            frame,
            positions=np.where(valid[:, None], self._placement.apply(frame.positions), 0.0),
            valid=valid,
            unlabelled=loose,
            source_time_ns=time_ns,
        )

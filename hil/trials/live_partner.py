"""A live person: who is there, where the avatar is to stand, and the frames of one trial as they come."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.placement import Placement, place_person
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.session.reach import Phase
from highfive.hil.session.session import RATE_HZ, Tick, TickInput
from highfive.hil.trials.live_settings import LIVE, LiveSettings
from highfive.hil.trials.live_wiring import MACHINE_WIRING, LiveWiring
from highfive.hil.trials.partners import Partner
from highfive.mocap_bridge.files.recording import Recording, make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.address import open_source
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.source import Connection
from highfive.mocap_bridge.tracking.filter_settings import FilterSettings
from highfive.mocap_bridge.wire.plausible import LONGEST_LATENCY_NS
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

TICK_NS = round(1e9 / RATE_HZ)


def live_source(
    address: str, person: str | None, wiring: LiveWiring = MACHINE_WIRING, beside: Collection[str] = ()
) -> LiveSource:
    """The source at an address of a live system; labels in ``beside`` make no person."""
    source = open_source(address, person, scheduler=wiring.scheduler, connects=wiring.connects, beside=beside)
    if not isinstance(source, LiveSource):
        raise HighFiveError(f"{address} is no live system")
    return source


class LivePerson:
    """Follows a live source; makes of it partners, and frames in the avatar's world.

    Attributes:
        placement: where the person stands.
        say: tells the person what to do.
        hand: that she is asked to raise.
        tracking: of the session's tracker; None for a motion capture system's.
        camera: (3,) m, of the one camera that sees her, in the world; None of a motion capture system.
    """

    camera: Array | None = None

    def __init__(
        self,
        source: LiveSource,
        address: str,
        marker_set: MarkerSet | None = None,
        registered: Placement | None = None,
        clock: Clock = MACHINE,
        latency_ns: int = 0,
        late_ns: int = 0,
        confirm: Callable[[str], bool | None] = lambda question: None,
        say: Callable[[str], None] = say_aside,
        tracking: FilterSettings | None = None,
        place: Callable[[Recording, MarkerSet], Placement] = place_person,
        settings: LiveSettings = LIVE,
        hand: str = "right",
    ):
        """Waits for the first frame, finds the marker set, and watches the person for ``settings.practice`` s.

        Where the room is ``registered`` the world lies where that says: nobody is watched, and the person comes to it.

        Args:
            source: of the frames.
            address: of the system, for messages.
            marker_set: the person's; None finds it.
            registered: where the world lies; None has the person watched.
            clock: this process's.
            latency_ns: what cameras, network and screen take beyond what the source says of itself.
            late_ns: by how much later than she is seen the source has her, as an event showed that another stream saw.
            confirm: asks whether a guess is right; None where nobody is there to be asked.
            say: tells the person what to do.
            tracking: of the session's tracker, where the source is no motion capture system.
            place: finds where the person stands from what was watched.
            settings: how long is waited.
            hand: that she is asked to raise; a left one comes mirrored.

        Raises:
            HighFiveError: nothing comes, no marker set fits, or the person is not seen well enough to be placed.
        """
        self._source, self._address, self._clock = source, address, clock
        self._latency_ns, self._late_ns = latency_ns, late_ns
        self.say, self.tracking, self._place = say, tracking, place
        self._settings, self.hand = settings, hand
        first = source.first()
        self._set = marker_set or find_marker_set(first.names)
        self._set.arrange(first.names, first.positions, first.valid, self._set.arm.markers)  # all there?
        say_aside(f"{address}: {len(first.names)} markers, set {self._set.name}")
        self._tell_latency(first.latency_ns)
        self.guessed = False
        """Nobody has confirmed what of the placement was guessed."""
        if registered is not None:
            say_aside(registered.notes[0])
            self.placement = registered
            return
        self.placement = self._placed(first)
        while self.placement.guesses and not self._accepted(confirm):
            self.placement = self._placed(source.first())

    def _tell_latency(self, latency_ns: int) -> None:
        """What the system says of itself, and whether it is believed."""
        unlikely_ns = self._source.health(self._clock.now()).unlikely_latency_ns
        if unlikely_ns:
            say_aside(
                f"{self._address} says that its frames are {1e-6 * unlikely_ns:.0f} ms old as it sends them; expected "
                f"0 to {1e-6 * LONGEST_LATENCY_NS:.0f} ms, so that is not made up for: measure it, and give --latency",
                logging.WARNING,
            )
        elif latency_ns >= 1_000_000:
            say_aside(f"its frames are {1e-6 * latency_ns:.0f} ms old as it sends them, as it says: made up for")

    def _placed(self, first: MarkerFrame) -> Placement:
        """Where the person stands, once watched."""
        self.say(
            f"for {self._settings.practice:g} s now: raise the {self.hand} hand once, as for a high five; "
            "there the avatar will meet it"
        )
        watched = self._watched(first)
        placement = self._place(watched, self._set)
        say_aside(f"hand seen{self._height(watched.names, placement.apply(watched.points), watched.valid)}")
        for note in placement.notes:
            say_aside(note)
        return placement

    def _accepted(self, confirm: Callable[[str], bool | None]) -> bool:
        guessed = "; ".join(self.placement.guesses)
        answer = confirm(f"guessed: {guessed}. Is that so? (no: you are watched again)")
        if answer is None:
            self.guessed = True
            say_aside(
                f"guessed: {guessed}. If that is wrong the hand is met beside where it is: raise it as for a high five "
                "while you are watched, or keep a placement that is right (--place FILE)",
                logging.WARNING,
            )
        return answer is not False

    @property
    def source(self) -> LiveSource:
        """Of the frames, in the system's own frame."""
        return self._source

    @property
    def marker_set(self) -> MarkerSet:
        """The person's."""
        return self._set

    @property
    def rate_hz(self) -> float:
        """Of her system's frames, by their stamps."""
        return 1e9 / self._source.period_ns

    @property
    def latency_ns(self) -> int:
        """From when the cameras see her until her system sends it, ns, as it says, and as was measured beyond that."""
        newest = self._source.newest(self._clock.now())
        return self._late_ns + (0 if newest is None else newest.latency_ns)

    def partner(self, emotion: str) -> Partner:
        """The person, to be answered in an emotion."""
        count = len(self._set)
        none = make_recording(RATE_HZ, self._set.names, np.zeros((0, count, 3)), np.zeros((0, count), dtype=bool))
        notes = (f"live from {self._address}", *self.placement.notes)
        return Partner(self._address, emotion, "", False, none, self._set, -1, None, None, notes)

    def trial(self) -> LiveTrial:
        """The frames of the next trial, once the hand rests, for which it waits at most ``settings.longest`` s."""
        hand = self._set.indices((*self._set.arm.wrist, *self._set.arm.hand))
        since = self._clock.now()
        end, before = since + 1e9 * self._settings.longest, None
        while self._clock.now() < end and self._clock.now() - since < 1e9 * self._settings.resting:
            frame = self._source.wait(before, 0.2)
            if frame is None:
                break
            points, seen = self._set.arrange(frame.names, frame.positions, frame.valid)
            if before is not None and seen[hand].any():
                earlier, there = self._set.arrange(before.names, before.positions, before.valid)
                both = hand[seen[hand] & there[hand]]
                seconds = 1e-9 * (frame.source_time_ns - before.source_time_ns)
                steps = np.linalg.norm(points[both] - earlier[both], axis=1)
                if seconds <= 0.0 or (len(both) and float(np.median(steps)) > self._settings.resting_speed * seconds):
                    since = self._clock.now()
            before = frame
        return LiveTrial(self._source, self.placement, self._clock, self._latency_ns, self._settings, self._late_ns)

    def _height(self, names: tuple[str, ...], points: Array, valid: NDArray[np.bool_]) -> str:
        """How high the right hand comes, in words, in points (T, M, 3), m, where they are ``valid``; '' for never."""
        points, seen = self._set.arrange(names, points, valid)
        hand = self._set.indices(self._set.arm.hand or self._set.arm.wrist)
        whole = seen[:, hand].all(axis=1)
        return f" at {points[whole][:, hand, 2].mean(axis=1).max():.2f} m" if whole.any() else ""

    def _watched(self, first: MarkerFrame) -> Recording:
        """What the person did for some seconds, in the system's own frame."""
        frames, newest, end = [first], first, self._clock.now() + round(1e9 * self._settings.practice)
        said = math.ceil(self._settings.practice)
        while (left := 1e-9 * (end - self._clock.now())) > 0.0:
            if math.ceil(left) < said:
                said = math.ceil(left)
                height = self._height(newest.names, newest.positions[None], newest.valid[None])
                say_aside(f"{said} s{height and f', hand{height}'}")
            frame = self._source.wait(newest, min(left, 0.1))
            if frame is not None and frame.names == first.names:
                frames.append(newest := frame)
            elif frame is None:
                health = self._source.health(self._clock.now())
                if health.age_ns > self._settings.silent * 1e9:
                    raise HighFiveError(f"{self._address}: nothing comes any more ({health.trouble or 'it is silent'})")
        points, valid = np.array([f.positions for f in frames]), np.array([f.valid for f in frames])
        return replace(make_recording(RATE_HZ, first.names, points, valid), source=self._address)


class LiveTrial:
    """What the ticks of one trial begin with, as frames come; ends once a high five is over.

    A tick begins when a frame is there. Where frames are slower than the avatar is shown, or one is overdue, a tick
    begins without: the person is predicted. Each is for the time at which its pose is shown: from when the cameras saw
    the frame until now, and :attr:`latency_ns` later. After a pause there is one tick for now, and none is made up for.

    Attributes:
        late: ticks that began more than a millisecond after they could.
        predicted: ticks without a new frame.
        stale: those of them in which the newest frame was stale by the settings.
        count: ticks so far.
        ahead_ms: by how much each was ahead of its frame, ms.
        trouble: why the trial ended early, '' if it did not: nothing has come for ``settings.gone`` s.
        newest: the frame that the last tick began with, as its system sent it.
    """

    def __init__(
        self,
        source: LiveSource,
        placement: Placement,
        clock: Clock = MACHINE,
        latency_ns: int = 0,
        settings: LiveSettings = LIVE,
        late_ns: int = 0,
    ):
        """Begins with the first frame that is requested.

        Args:
            source: of the frames.
            placement: of the person in the avatar's world.
            clock: this process's.
            latency_ns: what cameras, network and screen take beyond what the source says of itself.
            settings: how long is waited.
            late_ns: by how much earlier each frame is of than the source says.
        """
        self._settings = settings
        self._source, self._placement, self._clock = source, placement, clock
        self._latency_ns, self._late_ns = latency_ns, late_ns
        self.late = self.predicted = self.stale = self.count = 0
        self.ahead_ms: list[float] = []
        self.trouble, self._reached = "", False
        self.newest: MarkerFrame | None = None
        self._time_ns = self._idle_since_ns = 0
        self._resets = self._clocks_set()

    def begins(self) -> bool:
        """Whether there is a source to play with; if not, ``trouble`` says why.

        Where this computer or the source stood still, what is there is old: then the next frame is waited for.
        """
        newest, now = self._source.newest(self._clock.now()), self._clock.now()
        age_ns = 0 if newest is None else now - newest.arrival_time_ns
        if age_ns > self._patience_ns:
            self._source.wait(newest, max(0.0, self._settings.gone - 1e-9 * age_ns) + 0.01)
        return not self._is_gone(self._clock.now())

    def _is_gone(self, now: int) -> bool:
        health = self._source.health(now)
        gone = health.age_ns < 0 or health.age_ns > self._settings.gone * 1e9 or health.connection is Connection.ENDED
        if gone:
            why = health.trouble or "the source is silent"
            self.trouble = f"nothing has come for {self._settings.gone:g} s ({why})"
        return gone

    def __iter__(self) -> Iterator[TickInput]:
        """One after the other, in the avatar's world; times begin at 0 with the first frame's stamp."""
        frame, stamp, captured, begun = None, 0, 0, 0  # of the newest frame, and when the last tick began
        while not self._is_over():
            new = self._next(frame, begun)
            now = self._clock.now()
            if self._is_gone(now):
                return
            if new is not None:
                seen_ns = min(self._source.captured(new), now) - self._late_ns
                stamp = 0 if frame is None else stamp + self._elapsed(frame, new, seen_ns - captured)
                frame, captured = new, seen_ns
                self.newest = new
            elif frame is None:
                return
            stale = now - frame.arrival_time_ns > self._patience_ns
            self.predicted, self.stale, self.count = self.predicted + (new is None), self.stale + stale, self.count + 1
            # Time does not go back where a frame shows that the one before was late.
            at_ns = now + self._latency_ns
            time_ns = max(stamp + at_ns - captured, self._time_ns + self._settings.least_step_ns, stamp)
            self._time_ns, begun = time_ns, now
            self.ahead_ms.append(1e-6 * (time_ns - stamp))
            yield TickInput(None if new is None else self._in_world(new, stamp), time_ns, at_ns)

    @property
    def _patience_ns(self) -> float:
        return max(self._settings.stale * 1e9, self._settings.stale_frames * self._source.period_ns)

    def _next(self, seen: MarkerFrame | None, begun: int) -> MarkerFrame | None:
        """The next tick's frame, once it is there; None where it is time for a tick without one."""
        s = self._settings
        if seen is None:
            return self._source.newest(self._clock.now())
        shortest_ns = TICK_NS - s.early_ns
        self._clock.wait_until(begun + shortest_ns)
        expected = seen.arrival_time_ns + round(self._source.period_ns)
        soon = begun < expected <= begun + s.soon * TICK_NS
        due = expected + s.overdue_ns if soon else begun + TICK_NS
        frame = self._source.wait(seen, max(0.0, 1e-9 * (due - self._clock.now())))
        ready = due if frame is None else max(frame.arrival_time_ns, begun + shortest_ns)
        self.late += self._clock.now() - ready > 1_000_000
        return frame

    def _clocks_set(self) -> int:
        """How often a clock of the source's systems was set so far."""
        return sum(part.stamps.resets for part in self._source.parts)

    def _elapsed(self, before: MarkerFrame, frame: MarkerFrame, between_ns: int) -> int:
        """From frame to frame, ns, by the system's own clock, which does not jitter, as long as that is plausible."""
        own = frame.source_time_ns - before.source_time_ns
        resets, self._resets = self._resets, self._clocks_set()
        most = self._settings.clock_set_ns if resets == self._resets else self._settings.told_set_ns
        if own > 0 and abs(own - (frame.arrival_time_ns - before.arrival_time_ns)) < most:
            return own
        return max(between_ns, self._settings.least_step_ns)

    def watch(self, tick: Tick) -> None:
        """Sees each tick, to know when the high five is over."""
        idle = tick.target.phase is Phase.IDLE
        self._reached = self._reached or not idle
        if not idle or not self._reached:
            self._idle_since_ns = tick.time_ns

    def _is_over(self) -> bool:
        afterwards = self._time_ns - self._idle_since_ns if self._reached else 0
        return afterwards > self._settings.afterwards * 1e9 or self._time_ns > self._settings.longest * 1e9

    def _in_world(self, frame: MarkerFrame, time_ns: int) -> MarkerFrame:
        return replace(
            frame,
            positions=np.where(frame.valid[:, None], self._placement.apply(frame.positions), 0.0),
            unlabelled=self._placement.apply(frame.unlabelled),
            covariance=None if frame.covariance is None else self._placement.turned(frame.covariance),
            source_time_ns=time_ns,
        )

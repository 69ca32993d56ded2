"""What one tick takes: its stages in a hot loop, as parts of the model's own step; and paced at 120 Hz, as in use.

In a hot loop caches are warm and nothing waits: ratios within one run say what the program does, whatever the machine.
Paced, a tick begins when a frame has come through a live source: that is what a user gets, on this machine, now.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from highfive.hil.bench.live_people import System, frames_of, here, people
from highfive.hil.bench.wakes import percentiles, sleeps
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.session.session import RATE_HZ, Session
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.live_partner import LiveTrial
from highfive.hil.trials.partners import Partner
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model

STAGES = {
    "tracker": ("_tracker", "update"),
    "model": ("_responder._responder", "step"),
    "style timing": ("_timing", "answering"),
    "reach": ("_reach", "step"),
    "correction": ("_correction", "solve"),
}
"""Stages of a tick, and the part of a session that does each."""

Value = TypeVar("Value")


@dataclass(frozen=True)
class TickOptions:
    """How long is measured: rounds of a high five in each emotion, and seconds of a paced one."""

    rounds: int = 3
    seconds: float = 20.0
    seed: int = 0


class _Paced:
    """A link that hands each frame over at its time, by the machine's clock."""

    rate_hz = RATE_HZ

    def __init__(self, frames: Sequence[MarkerFrame]) -> None:
        self._frames, self._next, self._begin = frames, 0, time.monotonic_ns() + 500_000_000

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        if self._next >= len(self._frames):
            time.sleep(timeout_s)
            return ()
        frame = self._frames[self._next]
        wait = 1e-9 * (self._begin + frame.arrival_time_ns - time.monotonic_ns())
        if wait > timeout_s:
            time.sleep(timeout_s)
            return ()
        time.sleep(max(wait, 0.0))
        self._next += 1
        return (frame,)

    def close(self) -> None:
        """Nothing to let go of."""


def bench_tick(options: TickOptions, bar: Bar) -> dict[str, Any]:
    """Stages of a tick in a hot loop, ms and over the model's step; and paced: arrival to pose, ticks that were late.

    Raises:
        HighFiveError: nothing would be measured.
    """
    if options.rounds < 1 or not options.seconds >= 2.0:
        raise HighFiveError("measure one round and two seconds at least")
    model, scene = load_model(DEFAULT_MODEL), build_scene()
    persons = people(model.emotions, ("B2",), options.seed, bar)
    session = Session(model, {persons[0].emotion: 1.0}, persons[0].marker_set, scene)
    with quick_switching():
        hot = _hot(session, persons, options.rounds, bar)
        paced = _paced(session, persons[0], options.seconds, bar)
    return {"hot": hot, "paced": paced}


def _hot(session: Session, persons: Sequence[Partner], rounds: int, bar: Bar) -> dict[str, Any]:
    """Medians, ms: the correction's over ticks in which it leads the palm."""
    took: dict[str, list[float]] = {name: [] for name in STAGES}
    whole, leads = list[float](), list[bool]()
    with _timed(session, took):
        advance = bar("hot loop", rounds * len(persons))
        for _ in range(rounds):
            for person in persons:
                session.reset()
                session.set_style({person.emotion: 1.0})
                for frame in person.frames():
                    begun = time.perf_counter_ns()
                    tick = session.step(frame)
                    whole.append(1e-6 * (time.perf_counter_ns() - begun))
                    leads.append(tick.target.weight > 0.0)
                advance()
    led = np.array(leads)
    stages = {name: np.array(values) for name, values in took.items()}
    medians = {name: float(np.median(values)) for name, values in stages.items()}
    medians["correction"] = float(np.median(stages["correction"][led]))
    ticks = np.array(whole)
    medians["the rest"] = float(np.median(ticks - sum(stages.values(), np.zeros(len(ticks)))))
    step = medians["model"]
    return {
        "tick_ms": {"p50": round(float(np.median(ticks)), 3), "leading": round(float(np.median(ticks[led])), 3)},
        "stages_ms": {name: round(value, 3) for name, value in medians.items()},
        "over_step": {
            "tick": round(float(np.median(ticks)) / step, 2),
            "tick_leading": round(float(np.median(ticks[led])) / step, 2),
            **{name: round(value / step, 2) for name, value in medians.items()},
        },
    }


class _timed:  # reads as a statement
    """Measures each stage of a session's ticks while it lasts."""

    def __init__(self, session: Session, took: dict[str, list[float]]) -> None:
        self._places = []
        for name, (path, method) in STAGES.items():
            part: Any = session
            for attribute in path.split("."):
                part = getattr(part, attribute)
            self._places.append((part, method, _measured(getattr(part, method), took[name])))

    def __enter__(self) -> None:
        for part, method, measured in self._places:
            setattr(part, method, measured)

    def __exit__(self, *_: object) -> None:
        for part, method, _ in self._places:
            delattr(part, method)


def _measured(function: Callable[..., Value], took: list[float]) -> Callable[..., Value]:
    def measured(*args: Any, **named: Any) -> Value:
        begun = time.perf_counter_ns()
        value = function(*args, **named)
        took.append(1e-6 * (time.perf_counter_ns() - begun))
        return value

    return measured


def _paced(session: Session, person: Partner, seconds: float, bar: Bar) -> dict[str, Any]:
    """Arrival to pose, ms, of a person who comes in at 120 Hz; and how late a thread that sleeps wakes meanwhile."""
    frames = list(_again_and_again(frames_of(person, System(), 0, np.random.default_rng(0)), seconds + 1.0))
    advance = bar("paced", round(seconds))
    session.reset()
    took, tick_ms, wakes, ended = list[float](), list[float](), list[float](), threading.Event()
    sleeper = threading.Thread(target=sleeps, args=(wakes, ended), daemon=True)
    with closing(LiveSource("paced", lambda: _Paced(frames), None)) as source:
        source.first()
        sleeper.start()
        end, shown, late = time.monotonic() + seconds, 0, 0
        while time.monotonic() < end:
            trial = LiveTrial(source, here())  # a trial ends by itself
            for begins in trial:
                started = time.monotonic_ns()
                session.step(begins.frame, begins.time_ns)
                done = time.monotonic_ns()
                if begins.frame is not None:
                    took.append(1e-6 * (done - begins.frame.arrival_time_ns))
                tick_ms.append(1e-6 * (done - started))
                if (passed := round(seconds - (end - time.monotonic()))) > shown:
                    advance()
                    shown = passed
                if time.monotonic() >= end:
                    break
            late += trial.late
        ended.set()
        sleeper.join()
    return {
        "ticks": len(tick_ms),
        "arrival_to_pose_ms": percentiles(took),
        "tick_ms": percentiles(tick_ms),
        "late": late,
        "sleeper_late_ms": percentiles(wakes),
    }


def _again_and_again(frames: Sequence[MarkerFrame], seconds: float) -> Iterator[MarkerFrame]:
    """Frames of one high five after the other, numbers and stamps going on."""
    number, period = 0, 1e9 / RATE_HZ
    while number < seconds * RATE_HZ:
        for frame in frames:
            at = round(number * period)
            yield replace(frame, number=number, source_time_ns=at, arrival_time_ns=at)
            number += 1


def print_tick(result: dict[str, Any]) -> None:
    """The figures, for people."""
    paced, hot = result["paced"], result["hot"]
    arrival, tick, wakes = paced["arrival_to_pose_ms"], paced["tick_ms"], paced["sleeper_late_ms"]
    print(f"paced at 120 Hz, {paced['ticks']} ticks, {paced['late']} of them late")
    print(f"  arrival of a frame to its pose  p50 {arrival['p50']:.2f}, p99 {arrival['p99']:.2f} ms")
    print(f"  the tick alone                  p50 {tick['p50']:.2f}, p99 {tick['p99']:.2f} ms")
    print(f"  a thread that only sleeps       wakes {wakes['p50']:.2f} (p50), {wakes['p99']:.2f} ms (p99) late")
    print(f"hot loop: a tick {hot['tick_ms']['p50']:.2f} ms, {hot['tick_ms']['leading']:.2f} where it leads the palm")
    for name, value in hot["stages_ms"].items():
        print(f"  {name:<14}{value:6.3f} ms  {hot['over_step'][name]:5.2f} of the model's step")

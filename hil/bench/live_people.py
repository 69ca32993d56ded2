"""Simulated people before a live system of any rate, with delays, drops and a clock of its own, in virtual time.

Where a person is between the simulation's samples is a cubic spline through them, so that the truth is known at the
time at which a pose is shown, whatever the frames were.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from highfive.calibration.placement import Placement
from highfive.hil.arm.arm_trial import ArmWatch
from highfive.hil.arm.contact_outcome import ContactOutcome
from highfive.hil.bench.clocked_twin import clocked_loop
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.session.session import RATE_HZ, Session, Tick, TickInput
from highfive.hil.sim.people.capture import CLEAN, Defects
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.trials.frame_link import FrameLink, SentFrames
from highfive.hil.trials.key_frames import contact_tick
from highfive.hil.trials.live_partner import LiveTrial
from highfive.hil.trials.partners import Partner, simulated_partner
from highfive.hil.trials.trial import run_trial
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trained import HGPDM

BEFORE_S = 1.5
"""The person stands still for so long before the trial, s: the source finds the clock of the stamps."""

FAST = 0.5
"""m/s from which on a palm counts as moving."""

_DRAWS = 31_337
"""Keeps these people apart from those of other benchmarks with the same seed."""


@dataclass(frozen=True)
class System:
    """A live system.

    Attributes:
        rate_hz: frames a second.
        latency_ms: from the exposure until a frame arrives, at the least.
        reported_ms: what of it the system says.
        delay_ms: mean of the exponential delay on top of that.
        drop: fraction of frames that never arrive.
        drift_ppm: by how much its clock is faster than this computer's.
    """

    rate_hz: float = RATE_HZ
    latency_ms: float = 0.0
    reported_ms: float = 0.0
    delay_ms: float = 0.0
    drop: float = 0.0
    drift_ppm: float = 0.0


@dataclass(frozen=True)
class LiveFelt:
    """What came of one high five.

    Attributes:
        emotion, cell: of the person.
        touched: the palms met.
        error: m, of the played palm from the true one when they first touched; NaN where they did not.
        time_error: s, by how much that was later than the person's own contact.
        palm_speed: over the true one, of the tracked palm while it moved; NaN where it was never seen moving.
        palm_speed_rms: root mean square of what the tracked palm's speed was off by then, tick by tick, over the true
            one.
        arm: how the twin's plate met the palm, and why it was stopped, '' where it was not; None where none took part.
    """

    emotion: str
    cell: str
    touched: bool
    error: float
    time_error: float
    palm_speed: float
    palm_speed_rms: float
    arm: tuple[ContactOutcome, str] | None = None


def check_cells(cells: Sequence[str]) -> None:
    """Looks whether the grid has them.

    Raises:
        HighFiveError: it has not; it says which.
    """
    if strange := [cell for cell in cells if cell not in CELLS]:
        raise HighFiveError(f"unknown cell {strange[0]!r}; the grid has {', '.join(CELLS)}")


def people(emotions: Sequence[str], cells: Sequence[str], seed: int, bar: Bar) -> list[Partner]:
    """A person for each emotion and cell, captured without an error."""
    draws = [(emotion, cell, seed) for cell in cells for emotion in emotions]
    return list(parallel_map(_person, draws, lambda total: bar("people", total)))


def _person(draw: tuple[str, str, int]) -> Partner:
    emotion, cell, seed = draw
    rng = np.random.default_rng([seed, list(EMOTIONS).index(emotion), CELLS.index(cell), _DRAWS])
    return simulated_partner(emotion, cell, 0, rng, CLEAN)


def frames_of(
    person: Partner, system: System, begins_ns: int, rng: np.random.Generator, before_s: float = BEFORE_S
) -> list[MarkerFrame]:
    """What the system sends of a person who stands still for ``before_s`` first, from a time on."""
    points = person.recording.points
    spline = CubicSpline(np.arange(len(points)) / RATE_HZ, points)
    seconds = np.arange(0.0, before_s + (len(points) - 1) / RATE_HZ, 1.0 / system.rate_hz)
    arrivals, frames = 0, list[MarkerFrame]()
    for number, second in enumerate(seconds):
        delay_ms = system.latency_ms + rng.exponential(system.delay_ms) if system.delay_ms else system.latency_ms
        dropped = rng.random() < system.drop
        seen = spline(max(second - before_s, 0.0)) + rng.normal(0.0, Defects().noise, points.shape[1:])
        arrivals = max(arrivals, begins_ns + round(1e9 * second + 1e6 * delay_ms))  # in their order
        if dropped:
            continue
        frames.append(
            MarkerFrame(
                person.recording.names, seen, np.ones(len(seen), dtype=bool), number,
                round(1e9 * second * (1.0 + 1e-6 * system.drift_ppm)), arrivals, np.zeros((0, 3)),
                latency_ns=round(1e6 * system.reported_ms),
            )
        )  # fmt: skip
    return frames


@dataclass(frozen=True)
class LiveJob:
    """One high five before a system, in which the twin may take part."""

    person: Partner
    system: System
    seed: int
    twin: bool = False


@cache
def parts() -> tuple[HGPDM, Scene]:
    """The model that comes along, and a scene."""
    return load_model(DEFAULT_MODEL), build_scene()


def play(job: LiveJob) -> LiveFelt:
    """Plays one high five as a live session does."""
    person, system = job.person, job.system
    model, scene = parts()
    session = Session(model, {person.emotion: 1.0}, person.marker_set, scene)
    with VirtualClock(job.seed) as clock:
        begins = clock.now() + 100_000_000
        frames = frames_of(person, system, begins, np.random.default_rng(job.seed))
        link = FrameLink(clock, system.rate_hz, SentFrames(frames))
        with closing(LiveSource("simulated", lambda: link, None, system.rate_hz, VirtualScheduler(clock))) as source:
            zero = begins + round(1e9 * BEFORE_S)
            clock.wait_until(zero + round(1e6 * system.latency_ms))
            arm = ArmWatch(clocked_loop(default_planner(), clock)) if job.twin else None
            return meet(person, session, source, clock, zero, arm=arm)


def meet(
    person: Partner,
    session: Session,
    source: LiveSource,
    clock: VirtualClock,
    zero: int,
    latency_ns: int = 0,
    arm: ArmWatch | None = None,
) -> LiveFelt:
    """One high five with whom a source follows in virtual time, beside her true palm.

    Args:
        person: what she does, from ``zero`` ns on.
        session: answers.
        source: follows her, in the world.
        clock: of all.
        zero: ns of that clock.
        latency_ns: made up for beyond what the source reports.
        arm: takes part; None for none.
    """
    trial = LiveTrial(source, here(), clock, latency_ns)
    inputs, ticks = list[TickInput](), list[Tick]()

    if arm is not None:
        arm.begin()

    def noted() -> Any:
        for begins in trial if arm is None else arm.inputs(trial):
            inputs.append(begins)
            yield begins

    def watch(tick: Tick) -> None:
        ticks.append(tick)
        trial.watch(tick)
        if arm is not None:
            arm.watch(tick)

    result = run_trial(0, person, session, KinematicPlayOut(parts()[1]), noted(), watch)
    shown = 1e-9 * np.array([begins.at_ns - zero for begins in inputs], dtype=float)  # after the person began
    assert person.palm is not None
    truth = CubicSpline(np.arange(len(person.palm)) / RATE_HZ, person.palm)
    end = (len(person.palm) - 1) / RATE_HZ
    palm_speeds = _palm_speeds(ticks, shown, truth, end)
    by_arm = None if arm is None else _by_arm(arm, person)
    if result.contact.met_time_ns is None:
        return LiveFelt(person.emotion, person.cell, False, np.nan, np.nan, *palm_speeds, by_arm)
    at = contact_tick(result)
    error = float(np.linalg.norm(result.palm[at] - truth(min(shown[at], end))))
    late = float(shown[at]) - person.contact_frame / RATE_HZ
    return LiveFelt(person.emotion, person.cell, True, error, late, *palm_speeds, by_arm)


def _by_arm(arm: ArmWatch, person: Partner) -> tuple[ContactOutcome, str] | None:
    trial = arm.end(person.emotion, person.cell, -1)
    return None if trial is None else (trial.met, arm.loop.trouble)


def here() -> Placement:
    """Where the people were simulated."""
    return Placement(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), ("where it was simulated",))


def _palm_speeds(ticks: Sequence[Tick], shown: np.ndarray, truth: CubicSpline, end: float) -> tuple[float, float]:
    """Tracked over true, of the whole way; and the root mean square of the relative error, tick by tick."""
    true = np.linalg.norm(truth(np.clip(shown, 0.0, end), 1), axis=1)
    tracked = np.array([np.linalg.norm(tick.person.palm.velocity) for tick in ticks])
    moving = (true > FAST) & (shown < end) & np.array([tick.person.valid for tick in ticks])
    if not moving.any():
        return np.nan, np.nan
    off = tracked[moving] / true[moving] - 1.0
    return float(tracked[moving].sum() / true[moving].sum()), float(np.sqrt(np.mean(off**2)))


def figures(felt: Sequence[LiveFelt]) -> dict[str, Any]:
    """Medians and worst over the high fives: mm, ms, and the errors of the palm's speed as fractions; None of none.

    ``palm_speed_error`` is of the median over whole ways, in which fast and slow cancel out; ``palm_speed_rms``, over
    all high fives, is of single ticks.
    """
    touched = [one for one in felt if one.touched]
    errors = 1e3 * np.array([one.error for one in touched])
    times = 1e3 * np.abs([one.time_error for one in touched])
    speeds = np.array([one.palm_speed for one in felt if np.isfinite(one.palm_speed)])
    squares = np.array([one.palm_speed_rms for one in felt if np.isfinite(one.palm_speed_rms)]) ** 2
    return {
        "trials": len(felt),
        "touched": len(touched),
        "contact_error_mm": _median_and_max(errors, 2),
        "time_error_ms": _median_and_max(times, 1),
        "palm_speed_error": round(float(np.abs(np.median(speeds) - 1.0)), 4) if len(speeds) else None,
        "palm_speed_rms": round(float(np.sqrt(squares.mean())), 4) if len(squares) else None,
    }


def _median_and_max(values: np.ndarray, digits: int) -> dict[str, float | None]:
    if not len(values):
        return {"median": None, "max": None}
    return {"median": round(float(np.median(values)), digits), "max": round(float(values.max()), digits)}


def shown_pair(pair: dict[str, float | None], unit: str, digits: int) -> str:
    """Median and worst for people; a dash where there is none."""
    return " / ".join("    -" if value is None else f"{value:5.{digits}f}" for value in pair.values()) + f" {unit}"

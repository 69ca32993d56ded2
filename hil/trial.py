"""Runs one trial and keeps what happened."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray

from hil.avatar import Pose
from hil.partners import Partner
from hil.reach import Phase
from hil.session import RATE_HZ, Session, Tick
from hil.sim.contact_check import ContactReport, contact_report
from hil.sim.playout import PlayOut, PlayState
from hil.synchroniser import Synchroniser
from mocap_bridge.frames import HumanArm, MarkerFrame
from mocap_bridge.sources import C3DSource
from model.rotations import Array


@dataclass(frozen=True)
class TrialResult:
    """One trial: its figures, and the T ticks that they come from.

    Attributes:
        number: counted from 0.
        title, emotion, cell, simulated, notes: from the partner.
        contact: what the contact check found in the scene.
        error: m, palm to palm at contact; where they did not meet, at the nearest approach.
        uncorrected_error: m, of the generated pose at its own nearest approach.
        true_error: m, to the person's true palm rather than the tracked one, where it is known, else NaN.
        palm_angle: rad, between the palms, 0 when they face each other.
        out_of_reach: the palm could not be reached at contact; ``error`` says by how much.
        contact_time: s, when the palms met in this trial, NaN if they did not.
        time_error: s, later (positive) than the palms met originally, NaN where not known.
        other_error: m, nearest approach of who met this hand originally, NaN where not known.
        speed_change: largest change of a joint's speed from tick to tick in the fade-in, rad/s.
        uncorrected_speed_change: the same of the generated motion, in the whole trial.
        times: (T,) s.
        people: the live person, a tick each.
        poses, generated: what was played, and what the model had answered.
        person_palm, palm, generated_palm: (T, 3) m.
        other_palm: (T, 3) m, or None.
        weight: (T,) share of the correction.
        expected: (T,) s, time to contact as the model says.
        seen: (T, M) bool, markers measured.
        tick_ms: (T,) ms, markers in to corrected pose out.
    """

    number: int
    title: str
    emotion: str
    cell: str
    simulated: bool
    notes: tuple[str, ...]
    contact: ContactReport
    error: float
    uncorrected_error: float
    true_error: float
    palm_angle: float
    out_of_reach: bool
    contact_time: float
    time_error: float
    other_error: float
    speed_change: float
    uncorrected_speed_change: float
    times: Float[np.ndarray, " T"]
    people: tuple[HumanArm, ...]
    poses: tuple[Pose, ...]
    generated: tuple[Pose, ...]
    person_palm: Float[np.ndarray, "T 3"]
    palm: Float[np.ndarray, "T 3"]
    generated_palm: Float[np.ndarray, "T 3"]
    other_palm: Float[np.ndarray, "N 3"] | None
    weight: Float[np.ndarray, " T"]
    expected: Float[np.ndarray, " T"]
    seen: Bool[np.ndarray, "T M"]
    tick_ms: Float[np.ndarray, " T"]


def run_trial(
    number: int,
    partner: Partner,
    session: Session,
    playout: PlayOut,
    frames: Iterable[MarkerFrame] | None = None,
    watch: Callable[[Tick], None] = lambda tick: None,
) -> TrialResult:
    """One trial. The partner's recording goes as fast as it can; its figures are the same every time, timings apart.

    Args:
        number: of the trial.
        partner: who raises the hand.
        session: reset before the first frame.
        playout: plays the poses.
        frames: of a live partner, at their time; by default those of the partner's recording.
        watch: is shown each tick.
    """
    session.reset()
    synchroniser = Synchroniser()
    ticks: list[Tick] = []
    states: list[PlayState] = []
    tick_ms: list[float] = []
    for frame in C3DSource(partner.recording, RATE_HZ) if frames is None else frames:
        start = time.perf_counter_ns()
        tick = session.step(frame)
        tick_ms.append(1e-6 * (time.perf_counter_ns() - start))
        synchroniser.add(frame.source_time_ns, tick.pose)
        synchroniser.add_person(tick.person)
        moment = synchroniser.at(frame.source_time_ns)
        play = playout.step if states else playout.reset
        states.append(play(moment.pose, moment.person, moment.time_ns))
        ticks.append(tick)
        watch(tick)
    return _judge(number, partner, ticks, states, np.array(tick_ms))


def _judge(number: int, partner: Partner, ticks: list[Tick], states: list[PlayState], tick_ms: Array) -> TrialResult:
    contact = contact_report(states)
    person_palm = np.array([state.person_palm.position for state in states])
    palm = np.array([state.palm.position for state in states])
    generated_palm = np.array([tick.generated_palm.position for tick in ticks])
    times = np.arange(len(ticks)) / RATE_HZ
    touched = [i for i, tick in enumerate(ticks) if tick.target.phase is Phase.TOUCH]
    known = partner.contact_frame >= 0
    met = contact.met_time_ns
    contact_time = np.nan if met is None else 1e-9 * met
    nearest = round(1e-9 * contact.nearest_time_ns * RATE_HZ)
    hinges, generated = _hinge_track([t.pose for t in ticks]), _hinge_track([t.generated for t in ticks])
    fading = np.array([tick.target.phase is Phase.APPROACH for tick in ticks])
    return TrialResult(
        number=number,
        title=partner.title,
        emotion=partner.emotion,
        cell=partner.cell,
        simulated=partner.simulated,
        notes=partner.notes,
        contact=contact,
        error=contact.distance,
        uncorrected_error=_nearest(generated_palm, person_palm),
        true_error=np.nan if partner.palm is None else float(np.linalg.norm(palm[nearest] - partner.palm[nearest])),
        palm_angle=contact.palm_angle,
        out_of_reach=any(ticks[i].out_of_reach for i in touched),
        contact_time=contact_time,
        time_error=contact_time - partner.contact_frame / RATE_HZ if known else np.nan,
        other_error=np.nan if partner.other_palm is None else _nearest(partner.other_palm, person_palm),
        speed_change=_speed_change(hinges, fading),
        uncorrected_speed_change=_speed_change(generated, np.ones_like(fading)),
        times=times,
        people=tuple(tick.person for tick in ticks),
        poses=tuple(state.pose for state in states),
        generated=tuple(tick.generated for tick in ticks),
        person_palm=person_palm,
        palm=palm,
        generated_palm=generated_palm,
        other_palm=partner.other_palm,
        weight=np.array([tick.target.weight for tick in ticks]),
        expected=np.array([tick.response.time_to_contact for tick in ticks]),
        seen=np.array([tick.markers.seen for tick in ticks]),
        tick_ms=tick_ms,
    )


def _hinge_track(poses: list[Pose]) -> Array:
    return np.array([pose.hinges for pose in poses])


def _nearest(a: Array, b: Array) -> float:
    count = min(len(a), len(b))
    return float(np.linalg.norm(a[:count] - b[:count], axis=-1).min())


def _speed_change(hinges: Array, where: NDArray[np.bool_]) -> float:
    """Largest change of any hinge's speed between ticks, rad/s, over the ticks ``where`` it counts."""
    change = np.abs(np.diff(hinges, n=2, axis=0)).max(axis=(1, 2)) * RATE_HZ
    chosen = change[where[2:]]
    return float(chosen.max()) if chosen.size else 0.0

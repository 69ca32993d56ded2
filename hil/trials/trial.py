"""Runs one trial and keeps what happened."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import NDArray

from highfive.hil.session.reach import Phase
from highfive.hil.session.session import RATE_HZ, Session, Tick
from highfive.hil.session.synchroniser import Synchroniser
from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.contact_check import ContactReport, common_normal, contact_report
from highfive.hil.sim.playout import PlayOut, PlayState
from highfive.hil.trials.partners import Partner
from highfive.mocap_bridge.frames import HumanArm, MarkerFrame
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class TrialResult:
    """One trial: its figures, and the T ticks that they come from.

    Attributes:
        number: counted from 0.
        title, emotion, cell, simulated, notes: from the partner; the emotion is the simulated person's own.
        style: in which the avatar answered, such as ``'angry'`` or ``'angry 0.5 + neutral 0.5'``.
        contact: what the contact check found in the scene.
        error: m, palm to palm at contact; where they did not meet, at the nearest approach.
        uncorrected_error: m, of the generated pose at its own nearest approach.
        true_error: m, at the nearest, to the person's true palm rather than the tracked one; NaN where not known.
        touch_error: m, between the played palm and the person's true palm in the tick in which the palms first touch by
            the contact check; NaN where they do not, or the true palm is not known.
        touch_speed: m/s, at which the played palm and the true one close in along their common normal over that tick;
            NaN likewise.
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
    style: str
    cell: str
    simulated: bool
    notes: tuple[str, ...]
    contact: ContactReport
    error: float
    uncorrected_error: float
    true_error: float
    touch_error: float
    touch_speed: float
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

    The result's style is the partner's emotion; who has set another one puts it in.

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


def style_name(weights: Mapping[str, float]) -> str:
    """``{'angry': 0.5, 'neutral': 0.5}`` as ``'angry 0.5 + neutral 0.5'``; a pure style by its emotion alone."""
    parts = {emotion: weight for emotion, weight in weights.items() if weight > 0.0}
    if len(parts) == 1:
        return next(iter(parts))
    return " + ".join(f"{emotion} {weight:g}" for emotion, weight in parts.items())


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
    touch_error, touch_speed = _felt(states, contact, partner.palm)
    hinges, generated = _hinge_track([t.pose for t in ticks]), _hinge_track([t.generated for t in ticks])
    fading = np.array([tick.target.phase is Phase.APPROACH for tick in ticks])
    return TrialResult(
        number=number,
        title=partner.title,
        emotion=partner.emotion,
        style=partner.emotion,
        cell=partner.cell,
        simulated=partner.simulated,
        notes=partner.notes,
        contact=contact,
        error=contact.distance,
        uncorrected_error=_nearest(generated_palm, person_palm),
        true_error=np.nan if partner.palm is None else float(np.linalg.norm(palm[nearest] - partner.palm[nearest])),
        touch_error=touch_error,
        touch_speed=touch_speed,
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


def _felt(states: Sequence[PlayState], contact: ContactReport, true_palm: Array | None) -> tuple[float, float]:
    """What the person would feel at first touch: distance, m, of the played palm from the true one (T, 3), and closing
    speed, m/s; NaN where they did not touch, or nobody knows the true palm."""
    state = next((state for state in states if state.time_ns == contact.met_time_ns), None)
    if state is None or true_palm is None:
        return np.nan, np.nan
    frame = min(max(round(1e-9 * state.time_ns * RATE_HZ), 1), len(true_palm) - 1)
    distance = np.linalg.norm(state.palm.position - true_palm[frame])
    velocity = (true_palm[frame] - true_palm[frame - 1]) * RATE_HZ
    closing = (state.palm.velocity - velocity) @ common_normal(state.palm, state.person_palm)
    return float(distance), float(closing)


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

"""How a palm or plate met the person's palm, and whether there was time for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from highfive.hil.arm.contact_goal import palm_goal
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.planner_values import ConstraintRelaxation, ExpectedContact, PalmGoal
from highfive.hil.arm_model import dynamics
from highfive.hil.arm_model.servo_arm import solve
from highfive.hil.safety.people import speed_near_face
from highfive.hil.session.reach import Phase
from highfive.hil.session.session import RATE_HZ, Tick, tick_times
from highfive.hil.sim.profiles import minimum_jerk
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

if TYPE_CHECKING:
    pass


TICK = 1.0 / RATE_HZ


@dataclass(frozen=True)
class OutcomeSettings(Settings):
    """What counts as met, as known and as reached: conventions of the judging, set by hand."""

    skin: float = setting(0.002, "m", above=0.0)
    """Palm and plate this near, along the plate's normal, touch."""
    astray: float = setting(0.10, "m", above=0.0)
    """Palms that pass further than this beside the plate have not met it."""
    known: float = setting(0.05, "m", above=0.0)
    """Who knows the place so well may set off for it."""
    exact: float = setting(1e-3, "m", above=0.0)
    """Deviation of a contact that is forecast exactly."""
    reached: float = setting(0.01, "m", above=0.0)
    """A plate that can come so near reaches the place."""
    earliest: float = setting(0.25, "s", least=0.0)
    """Before the session's own contact, from which on a touch counts as this high five's."""


OUTCOME = OutcomeSettings()


@dataclass(frozen=True)
class ReferenceTrajectory:
    """What one simulated high five demanded of the arm.

    Attributes:
        emotion, cell: of the high five.
        goals: one per tick.
        person: (T, 3) m, the person's palm as tracked.
        avatar, avatar_normals: (T, 3) the avatar's palm.
        due: tick in which the session had the palms touch.
        met: tick in which they touched originally.
    """

    emotion: str
    cell: str
    goals: tuple[PalmGoal, ...]
    person: Array
    avatar: Array
    avatar_normals: Array
    due: int
    met: int


@dataclass(frozen=True)
class LeadTime:
    """Whether the arm could be there in time.

    Attributes:
        reached: some posture has the plate where the palms met.
        needed: s, of the quickest minimum-jerk movement there from the ready posture inside speed and torque, made
            slower where it leads near the person's face; infinite where it is not reached.
        given: s from when the arm first knew of a contact to the contact, less its lag.
        known: s from when the place was forecast to 5 cm, from then on, to the contact.
    """

    reached: bool
    needed: float
    given: float
    known: float

    @property
    def possible(self) -> bool:
        """The place can be reached, and in the time that was left when the arm came to know of a contact."""
        return self.reached and self.needed < self.given


@dataclass(frozen=True)
class ContactOutcome:
    """How one high five went.

    Attributes:
        emotion, cell: of the high five.
        error: m, between the plate's middle and the person's palm as they touched; if they did not, at the nearest.
        touched: they did.
        late: s after the session's own contact; NaN where they did not touch.
        later: s after the palms met originally.
        speed: m/s, of the plate relative to the hand as they touched.
        notice: that the arm had; None of an avatar, which can be anywhere at once.
        relaxation: what the retargeting gave up.
    """

    emotion: str
    cell: str
    error: float
    touched: bool
    late: float
    later: float
    speed: float
    notice: LeadTime | None
    relaxation: ConstraintRelaxation

    @property
    def possible(self) -> bool:
        """It could be there in time."""
        return self.notice is None or self.notice.possible


def reference_in(ticks: Sequence[Tick], emotion: str, cell: str, met: int) -> ReferenceTrajectory:
    """What a session's ticks demanded of the arm, at the model's rate: the ticks of a live person have their own."""
    times = tick_times(ticks)
    rows = TICK * np.arange(int(times[-1] / TICK + 0.5) + 1)
    nearest = np.abs(times[:, None] - rows).argmin(axis=0)
    touch = next((time for time, tick in zip(times, ticks, strict=True) if tick.calm.target.phase is Phase.TOUCH), None)
    person, avatar, normals = (
        np.array([np.interp(rows, times, axis) for axis in np.transpose(points)]).T
        for points in (
            [tick.person.palm.position for tick in ticks],
            [tick.palm.position for tick in ticks],
            [tick.palm.normal for tick in ticks],
        )
    )
    return ReferenceTrajectory(
        emotion,
        cell,
        tuple(palm_goal(ticks[i]) for i in nearest),
        person,
        avatar,
        normals,
        # A session that ends before the contact, or of whose clock a piece is missing, is judged at its end.
        min(max(met, 0) if touch is None else round(touch / TICK), len(rows) - 1),
        met,
    )


def with_known_contact(reference: ReferenceTrajectory, settings: OutcomeSettings = OUTCOME) -> ReferenceTrajectory:
    """The same, but from when a contact was first forecast the arm knows exactly where and when it will be.

    What it then misses by is its own; the rest is what the forecast does not know.
    """
    last, began = reference.goals[reference.due].contact, _began(reference)
    if last is None:
        return reference
    goals = list(reference.goals)
    for i in range(began, reference.due):
        known = ExpectedContact(
            reference.person[reference.due], settings.exact**2 * np.eye(3), last.normal, (reference.due - i) * TICK
        )
        goals[i] = replace(goals[i], contact=known, hypotheses=None)
    return replace(reference, goals=tuple(goals))


def _began(reference: ReferenceTrajectory) -> int:
    """Tick in which a contact was first expected, wherever it may be."""
    goals = enumerate(reference.goals[: reference.due])
    expected = (i for i, goal in goals if goal.contact is not None or goal.hypotheses is not None)
    return next(expected, reference.due)


def avatar_outcome(reference: ReferenceTrajectory) -> ContactOutcome:
    """The avatar itself, judged as the arm is."""
    return judged(reference, reference.avatar, reference.avatar_normals, None, ConstraintRelaxation())


def notice(reference: ReferenceTrajectory, retarget: Retarget, settings: OutcomeSettings = OUTCOME) -> LeadTime:
    """What the arm could do about this high five, and how long before it knew."""
    place, goal = reference.person[reference.due], reference.goals[reference.due].contact
    if goal is None:
        return LeadTime(False, np.inf, 0.0, 0.0)
    off = [
        np.inf if one.contact is None else float(np.linalg.norm(one.contact.point - place))
        for one in reference.goals[: reference.due]
    ]
    began = _began(reference)
    astray = max((i for i, distance in enumerate(off) if distance > settings.known), default=-1)
    given, known = (reference.due - began) * TICK - retarget.settings.lag, (reference.due - 1 - astray) * TICK
    joints, miss = solve(retarget.arm, place, goal.normal, retarget.ready)
    if miss >= settings.reached:
        return LeadTime(False, np.inf, given, known)
    seconds, head = (
        float(dynamics.quickest(retarget.arm.packed, retarget.ready, joints)),
        reference.goals[reference.due].head,
    )
    longer = 1.0 if head is None else _slower_near_face(retarget, joints, seconds, head)
    return LeadTime(True, seconds * longer, given, known)


def _slower_near_face(retarget: Retarget, joints: Array, seconds: float, head: Array) -> float:
    """How many times as long a minimum-jerk movement of ``seconds`` takes that keeps slow near a head at rest."""
    s, steps = retarget.settings, 200
    shares = minimum_jerk(np.linspace(0.0, 1.0, steps + 1))
    places = np.array([retarget.arm.plate_at(retarget.ready + a * (joints - retarget.ready)).position for a in shares])
    longer = []
    for place, way in zip(places[:-1], np.diff(places, axis=0), strict=True):
        length, away = float(np.linalg.norm(way)), head - place
        distance = float(np.linalg.norm(away))
        straight = float(away @ way) / max(length * distance, 1e-12)
        most = speed_near_face(s.face_speed, 0.0, distance - s.face_radius, s.face_braking, straight)
        longer.append(max(1.0, length * steps / seconds / most))
    return float(np.mean(longer))


def judged(
    reference: ReferenceTrajectory,
    places: Array,
    normals: Array,
    had: LeadTime | None,
    relaxation: ConstraintRelaxation,
    settings: OutcomeSettings = OUTCOME,
) -> ContactOutcome:
    """How a plate (or palm) that was at ``places`` (T, 3), m, facing ``normals`` (T, 3), met the hand.

    Where it was stopped there are fewer places than ticks: three at least.
    """
    apart = reference.person[: len(places)] - places
    gap, distance = np.einsum("ti,ti->t", apart, normals), np.linalg.norm(apart, axis=1)
    last = min(reference.due + round(settings.earliest * RATE_HZ), len(gap) - 2)
    first = min(
        max(reference.due - round(settings.earliest * RATE_HZ), 1), last
    )  # stopped before: where it was in the end
    touching = np.flatnonzero((gap[first : last + 1] < settings.skin) & (distance[first : last + 1] < settings.astray))
    touched = len(touching) > 0
    tick = first + int(touching[0] if touched else distance[first : last + 1].argmin())
    speed = float(np.linalg.norm(apart[tick] - apart[tick - 1]) / TICK)
    late, later = ((tick - reference.due) * TICK, (tick - reference.met) * TICK) if touched else (np.nan, np.nan)
    return ContactOutcome(
        reference.emotion, reference.cell, float(distance[tick]), touched, late, later, speed, had, relaxation
    )

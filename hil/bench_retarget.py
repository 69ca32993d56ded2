"""How near the arm's plate comes to the person's palm, and when, in simulated sessions.

Sessions are run once; what they ask of the arm in every tick is then played to whatever follows joint commands: an
arm that is where it was told to be, the twin behind servos, or an emulated rig.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from hil import arm_motion
from hil.partners import Partner, simulated_partners
from hil.reach import Phase
from hil.retarget import PalmGoal, Retarget, Sacrifice
from hil.retarget_goal import palm_goal
from hil.servo_arm import solve
from hil.session import RATE_HZ, Session
from hil.sim.actors import CELLS
from hil.sim.arm_plant import ArmPlant
from hil.sim.emotions import EMOTIONS
from hil.sim.scene import build_scene
from mocap_bridge.sources import C3DSource
from model.hgpdm import HGPDM
from model.rotations import Array
from scenes import servo_arm as measures

if TYPE_CHECKING:
    from hil.console import Bar

TICK = 1.0 / RATE_HZ
SKIN = 0.002
"""Palm and plate this near, m along the plate's normal, touch."""
ASTRAY = 0.10
"""Palms that pass further than this, m, beside the plate have not met it."""
EARLIEST = 0.25
"""s before the session's own contact from which on a touch counts as this high five's."""


class Follower(Protocol):
    """What follows joint commands, 120 a second."""

    def reset(self, positions: Array) -> None:
        """Starts at rest at (J,) rad."""
        ...

    def command(self, positions: Array) -> Array:
        """Takes a command (J,), rad; returns where the joints are a tick later."""
        ...


class IdealFollower:
    """An arm that is where it was told to be."""

    def reset(self, positions: Array) -> None:
        """Has nothing to forget."""

    def command(self, positions: Array) -> Array:
        """Returns the command."""
        return positions


class TwinFollower:
    """The twin's dynamics behind plain servos: a voltage in proportion to the error, and a motor with back-EMF.

    Full voltage at an error of ``full`` rad. Such a servo is late by ``full`` over its no-load speed, and gives way by
    ``full`` over its stall torque: what :class:`hil.retarget.RetargetSettings` calls lag and sag.
    """

    SUBSTEPS = 8

    def __init__(self, plant: ArmPlant, full: float = 0.07) -> None:
        """Around a plant."""
        self._plant, self._full = plant, full
        self._stall = np.array([count * servo.stall for servo, count in measures.SERVOS])
        self._no_load = np.array([servo.no_load for servo, _ in measures.SERVOS])
        self._positions, self._speeds = np.zeros(6), np.zeros(6)

    @property
    def lag(self) -> float:
        """s"""
        return self._full / measures.SPEED_LIMIT

    @property
    def sag(self) -> tuple[float, ...]:
        """(J,) rad per N·m."""
        return tuple((self._full / self._stall).tolist())

    def reset(self, positions: Array) -> None:
        """Starts at rest at (J,) rad."""
        self._plant.reset(positions)
        self._positions, self._speeds = np.array(positions), np.zeros(6)

    def command(self, positions: Array) -> Array:
        """Drives the plant for a tick; returns where its joints are then."""
        for _ in range(self.SUBSTEPS):
            voltage = np.clip((positions - self._positions) / self._full, -1.0, 1.0)
            torques = self._stall * (voltage - self._speeds / self._no_load)
            self._positions, self._speeds = self._plant.step(torques, TICK / self.SUBSTEPS)
        return self._positions


@dataclass(frozen=True)
class Asked:
    """What one simulated high five asked of the arm.

    Attributes:
        emotion, cell: of the high five.
        goals: one a tick.
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
class Met:
    """How one high five went.

    Attributes:
        emotion, cell: of the high five.
        error: m, between the plate's middle and the person's palm as they touched; if they did not, at the nearest.
        touched: they did.
        late: s after the session's own contact; NaN where they did not touch.
        later: s after the palms met originally.
        speed: m/s, of the plate relative to the hand as they touched.
        possible: the place can be reached, and in the time that was left when the arm came to know of it.
        sacrifice: what the retargeting gave up.
    """

    emotion: str
    cell: str
    error: float
    touched: bool
    late: float
    later: float
    speed: float
    possible: bool
    sacrifice: Sacrifice


def asked_of_arm(
    model: HGPDM, emotions: Sequence[str], cells: Sequence[str], seed: int, bar: Bar, repeats: int = 1
) -> list[Asked]:
    """Runs the sessions."""
    count = repeats * len(emotions) * len(cells)
    partners = simulated_partners(count, emotions, cells, seed, lambda total: bar("people", total))
    session = Session(model, {partners[0].emotion: 1.0}, partners[0].marker_set, build_scene())
    advance, asked = bar("sessions", len(partners)), []
    for partner in partners:
        asked.append(_asked(session, partner))
        advance()
    return asked


def _asked(session: Session, partner: Partner) -> Asked:
    session.set_style({partner.emotion: 1.0})
    session.reset()
    ticks = [session.step(frame) for frame in C3DSource(partner.recording, RATE_HZ)]
    touches = [i for i, tick in enumerate(ticks) if tick.target.phase is Phase.TOUCH]
    return Asked(
        partner.emotion,
        partner.cell,
        tuple(palm_goal(tick) for tick in ticks),
        np.array([tick.person.palm.position for tick in ticks]),
        np.array([tick.palm.position for tick in ticks]),
        np.array([tick.palm.normal for tick in ticks]),
        touches[0] if touches else partner.contact_frame,
        partner.contact_frame,
    )


def avatar_met(asked: Asked) -> Met:
    """The avatar itself, judged as the arm is."""
    return judged(asked, asked.avatar, asked.avatar_normals, True, Sacrifice())


def arm_met(asked: Asked, retarget: Retarget, follower: Follower, times: list[float] | None = None) -> Met:
    """Plays one high five to a follower; ``times`` collects ms of each retargeting step."""
    state = retarget.start()
    follower.reset(state.joints)
    places, normals = [], []
    for goal in asked.goals:
        begun = time.perf_counter_ns()
        state, step = retarget.step(state, goal)
        if times is not None:
            times.append(1e-6 * (time.perf_counter_ns() - begun))
        plate = retarget.arm.plate_at(follower.command(step.positions))
        places.append(plate.position)
        normals.append(plate.normal)
    return judged(asked, np.array(places), np.array(normals), possible(asked, retarget), state.sacrifice)


def possible(asked: Asked, retarget: Retarget) -> bool:
    """Whether the plate can be where the palms met, in the time that was left when the arm came to know of it.

    The time is that of the quickest minimum-jerk movement from the ready posture inside speed and torque.
    """
    place, began = asked.person[asked.due], [i for i, goal in enumerate(asked.goals) if goal.contact is not None]
    goal = asked.goals[asked.due].contact
    if goal is None or not began:
        return False
    joints, miss = solve(retarget.arm, place, goal.normal, retarget.ready)
    given = (asked.due - began[0]) * TICK - retarget.settings.lag
    return miss < 0.01 and float(arm_motion.quickest(retarget.arm.packed, retarget.ready, joints)) < given


def judged(asked: Asked, places: Array, normals: Array, reachable: bool, sacrifice: Sacrifice) -> Met:
    """How a plate (or palm) that was at ``places`` (T, 3), m, facing ``normals`` (T, 3), met the hand."""
    apart = asked.person - places
    gap, distance = np.einsum("ti,ti->t", apart, normals), np.linalg.norm(apart, axis=1)
    first = max(asked.due - round(EARLIEST * RATE_HZ), 1)
    last = min(asked.due + round(EARLIEST * RATE_HZ), len(gap) - 2)
    touching = np.flatnonzero((gap[first : last + 1] < SKIN) & (distance[first : last + 1] < ASTRAY))
    touched = len(touching) > 0
    tick = first + int(touching[0] if touched else distance[first : last + 1].argmin())
    speed = float(np.linalg.norm(apart[tick] - apart[tick - 1]) / TICK)
    late, later = ((tick - asked.due) * TICK, (tick - asked.met) * TICK) if touched else (np.nan, np.nan)
    return Met(asked.emotion, asked.cell, float(distance[tick]), touched, late, later, speed, reachable, sacrifice)


@dataclass(frozen=True)
class RetargetBenchOptions:
    """What is measured: emotions and cells (empty: all), how often each, and the seed of the simulated people."""

    emotions: tuple[str, ...] = ()
    cells: tuple[str, ...] = ()
    repeats: int = 1
    seed: int = 0


Rig = tuple[Retarget, Follower]
"""A follower, and the retargeting that knows its lag and sag."""


def bench_retarget(
    options: RetargetBenchOptions, model: HGPDM, rigs: Mapping[str, Rig], bar: Bar
) -> tuple[dict[str, Any], dict[str, list[Met]]]:
    """Figures of the avatar and of each rig, and what each high five came to."""
    emotions, cells = options.emotions or tuple(EMOTIONS), options.cells or CELLS
    asked = asked_of_arm(model, emotions, cells, options.seed, bar, options.repeats)
    advance = bar("high fives", len(rigs) * len(asked))
    met = {"avatar": [avatar_met(it) for it in asked]}
    times: list[float] = []
    for name, (retarget, follower) in rigs.items():
        met[name] = []
        for it in asked:
            met[name].append(arm_met(it, retarget, follower, times))
            advance()
    result: dict[str, Any] = {name: figures(rows) for name, rows in met.items()}
    p50, p99 = np.percentile(times or [np.nan], [50, 99])
    result |= {"step_ms": {"p50": round(float(p50), 3), "p99": round(float(p99), 3)}, "high_fives": len(asked)}
    return result, met


def figures(rows: Sequence[Met]) -> dict[str, Any]:
    """The figures of one follower: over the high fives that are possible; the others are counted and named."""
    able = [row for row in rows if row.possible]
    errors = 1e3 * np.array([row.error for row in able] or [np.nan])
    late = 1e3 * np.abs([row.late for row in able if row.touched] or [np.nan])
    later = 1e3 * np.abs([row.later for row in able if row.touched] or [np.nan])
    return {
        "error_mm": {"median": round(float(np.median(errors)), 2), "max": round(float(errors.max()), 2)},
        "time_error_ms": {"median": round(float(np.median(late)), 1), "max": round(float(late.max()), 1)},
        "true_time_error_ms": {"median": round(float(np.median(later)), 1), "max": round(float(later.max()), 1)},
        "max_relative_speed": round(max((row.speed for row in rows if row.touched), default=0.0), 3),
        "missed": sum(not row.touched for row in able),
        "unreachable": [f"{row.emotion} {row.cell}" for row in rows if not row.possible],
    }

"""What the arm did in one high five: every tick, every cycle of the bus, and how palm plate and palm met."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from highfive.hil.arm.contact_goal import palm_goal
from highfive.hil.arm.contact_outcome import ContactOutcome, ReferenceTrajectory, judged, notice, reference_in
from highfive.hil.arm.loop import ArmLoop, ArmTick, Watch, WayBack
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.planner_values import ConstraintRelaxation, PalmGoal
from highfive.hil.arm_model.servo_arm import PlatePose, ServoArm
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.runtime.interrupts import WholeTick
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.speeds import closing_speed, face_speed
from highfive.hil.safety.states import HALTED, State
from highfive.hil.session.session import RATE_HZ, Tick, TickInput, tick_times
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array

MS, NS = 1e3, 1e-9
MISSED = 1.5
"""Periods between two cycles from which on one between them is missing."""
FEWEST = 3
"""Ticks and cycles of which something can be said."""


@dataclass(frozen=True)
class ArmTrial:
    """One high five of the arm.

    Attributes:
        ticks: one per frame of the session.
        cycles: of the bus, meanwhile; one that is late is in it, one that was left out is not.
        plates: where the plate was at each tick, by what the servos said.
        met: how plate and palm met.
        due: tick in which the session had the palms touch.
        broken_off: the arm was stopped before plate and palm had touched; it says nothing of how well they meet.
        back: what it did after its last tick, on its way to where it rests; in none of the figures.
    """

    ticks: tuple[ArmTick, ...]
    cycles: tuple[Cycle, ...]
    plates: tuple[PalmPose, ...]
    met: ContactOutcome
    due: int
    broken_off: bool
    back: WayBack = field(default_factory=WayBack)

    @property
    def with_back(self) -> ArmTrial:
        """The same with the way back among its ticks and cycles: for what is judged of all that went over the wire."""
        return replace(
            self, ticks=(*self.ticks, *self.back.ticks), cycles=(*self.cycles, *self.back.cycles), back=WayBack()
        )

    @cached_property
    def times(self) -> Array:
        """(T,) s, of the ticks, from the first."""
        return NS * np.array([tick.frame_ns - self.ticks[0].frame_ns for tick in self.ticks])

    @cached_property
    def cycle_times(self) -> Array:
        """(C,) s, when the servos had answered, from the first tick."""
        return NS * np.array([cycle.state.time_ns - self.ticks[0].frame_ns for cycle in self.cycles])

    @cached_property
    def sent(self) -> Array:
        """(C, J) rad, goals as they went over the bus; NaN where none did."""
        none = np.full(self.actual.shape[1], np.nan)
        return np.array([none if cycle.sent is None else cycle.sent.positions for cycle in self.cycles])

    @cached_property
    def actual(self) -> Array:
        """(C, J) rad, what the servos said."""
        return np.array([cycle.state.positions for cycle in self.cycles])

    @cached_property
    def currents(self) -> Array:
        """(C, J) A."""
        return np.array([cycle.state.currents for cycle in self.cycles])

    @cached_property
    def planned(self) -> Array:
        """(T, J) rad, where retargeting planned the joints a lag later."""
        return np.array([tick.planned for tick in self.ticks])

    @cached_property
    def periods_ms(self) -> Array:
        """(C - 1,) ms, from cycle to cycle."""
        return 1e-6 * np.diff(np.array([cycle.begun_ns for cycle in self.cycles], dtype=np.float64))

    def following_error(self, lag: float) -> Array:
        """(T, J) rad, of the joints beside where they were planned, ``lag`` s later."""
        there = [np.interp(self.times + lag, self.cycle_times, joint) for joint in self.actual.T]
        return np.array(there).T - self.planned

    def separation_speeds(self, arm: ServoArm, limits: Limits) -> dict[str, float]:
        """m/s, the largest closing speed near the hand and the largest speed near the head, from positions.

        ``wire``: of the goals as they went out, against the hand as it was known then; ``body``: of what the servos
        said, against where the hand went; see :mod:`highfive.hil.safety.speeds`.
        """
        found = {f"{which}_{speed}_speed": 0.0 for which in ("wire", "body") for speed in ("closing", "face")}
        was = np.array([arm.points(pose)[0] for pose in self.actual])

        begun = NS * np.array([cycle.begun_ns - self.ticks[0].frame_ns for cycle in self.cycles])
        went = np.isfinite(self.sent).all(axis=1)
        if went.any():
            times, points = begun[went], np.array([arm.points(pose)[0] for pose in self.sent[went]])
            # A goal is of the tick before its cycle, which knew hand and plate as they were then.
            known = NS * np.array([tick.report.time_ns - self.ticks[0].frame_ns for tick in self.ticks])
            told = known[np.maximum(np.searchsorted(known, times, side="right") - 1, 0)]
            hands, speeds, heads = (rows_at(told, known, rows) for rows in self.person)
            bodies = was[self.known_at(told), 0]
            found["wire_closing_speed"] = closing_speed(times, points[:, 0], hands, limits.contact, bodies, speeds)
            found["wire_face_speed"] = face_speed(times, points, heads, limits.face)
        times = self.cycle_times
        hands, _, heads = (rows_at(times, self.times, rows) for rows in self.person)
        found["body_closing_speed"] = closing_speed(times, was[:, 0], hands, limits.contact)
        found["body_face_speed"] = face_speed(times, was, heads, limits.face)
        return found

    @cached_property
    def person(self) -> tuple[Array, Array, Array]:
        """Palm, m, its velocity, m/s, and head, m, each (T, 3), as each tick knew them; NaN where not known."""
        goals = [tick.goal for tick in self.ticks]
        return (
            _rows([None if goal.person is None else goal.person.position for goal in goals]),
            _rows([None if goal.person is None else goal.person.velocity for goal in goals]),
            _rows([goal.head for goal in goals]),
        )

    def known_at(self, times: Array) -> NDArray[np.intp]:
        """(N,), the cycles of which the servos' answers were the newest at ``times`` (N,), s from the first tick."""
        said = NS * np.array([it.begun_ns + it.took_ns - self.ticks[0].frame_ns for it in self.cycles])
        return np.maximum(np.searchsorted(said, times, side="right") - 1, 0)

    @cached_property
    def acted(self) -> Counter[str]:
        """How many ticks each rule of the envelope acted in; until the start-up's checks are through, that one."""
        began = frozenset({Rule.START_UP})
        acted = [tick.report.acted for tick in self.ticks]
        return Counter(rule.value for rules in acted for rule in (began if began <= rules else rules))


def kept_back(ticks: Sequence[ArmTick]) -> str:
    """Why an arm does not follow, in one line, that is not found fit to; '' where it is, or before the first tick."""
    last = ticks[-1].report if ticks else None
    return last.reason if last is not None and last.state is State.UNCHECKED else ""


def played_until_stopped(reference: ReferenceTrajectory, loop: ArmLoop, watch: Watch | None = None) -> ArmTrial | None:
    """Has the arm play one high five as far as it comes; ``loop.trouble`` says why it was stopped, if it was.

    ``watch`` as in :meth:`~highfive.hil.arm.loop.ArmLoop.play`.

    Returns:
        what it did; None where that are fewer than :data:`FEWEST` ticks or cycles.

    Raises:
        HighFiveError: it was not allowed to; it says why. Nothing has moved.
    """
    back = WayBack()
    ticks, cycles = loop.play(reference.goals, back, watch)
    if len(ticks) < FEWEST or len(_meanwhile(ticks, cycles)) < FEWEST:
        return None
    return replace(arm_trial(reference, loop.retarget, ticks, cycles, loop.relaxation), back=back)


def arm_trial(
    reference: ReferenceTrajectory,
    retarget: Retarget,
    ticks: Sequence[ArmTick],
    cycles: Sequence[Cycle],
    given_up: ConstraintRelaxation,
    moments: Array | None = None,
) -> ArmTrial:
    """Puts together what was collected, and judges it.

    Args:
        reference: the high five.
        retarget: of the arm.
        ticks: one for each of its goals, or for those until it was stopped; :data:`FEWEST` at least.
        cycles: of the bus, from before the first to after the last tick.
        given_up: what the retargeting had to give up.
        moments: (T,) ns, when each row of the reference was, on the loop's clock; by default when its tick was.
    """
    cycles = _meanwhile(ticks, cycles)
    frames = np.array([tick.frame_ns for tick in ticks], float)
    poses = _plates(retarget, cycles, frames)
    places = np.array([pose.position for pose in poses])
    velocities = np.array(np.gradient(places, 1e-9 * frames, axis=0))
    plates = tuple(PalmPose(p.position, p.normal, p.fingers, v) for p, v in zip(poses, velocities, strict=True))
    rows = frames if moments is None else moments
    met_by = poses if moments is None else _plates(retarget, cycles, rows)
    places, normals = np.array([p.position for p in met_by]), np.array([p.normal for p in met_by])
    met = judged(reference, places, normals, notice(reference, retarget), given_up)
    end = rows[min(reference.due, len(rows) - 1)]
    halted = any(tick.report.state in HALTED for tick in ticks if tick.frame_ns <= end)
    broken_off = not met.touched and (halted or len(rows) < len(reference.goals))
    return ArmTrial(tuple(ticks), tuple(cycles), plates, met, reference.due, broken_off)


def _plates(retarget: Retarget, cycles: Sequence[Cycle], times: Array) -> list[PlatePose]:
    """Where the plate was at times (T,), ns, by what the servos said."""
    heard = np.array([cycle.state.time_ns for cycle in cycles], float)
    joints = np.array([np.interp(times, heard, joint) for joint in np.array([c.state.positions for c in cycles]).T]).T
    return [retarget.arm.plate_at(retarget.arm.standing(pose)) for pose in joints]


def _rows(rows: Sequence[Array | None]) -> Array:
    """(T, 3), NaN where there is none."""
    return np.array([np.full(3, np.nan) if row is None else row for row in rows])


def rows_at(times: Array, known: Array, rows: Array) -> Array:
    """Rows (T, 3), ``known`` at some times, at others (N,), s: (N, 3)."""
    return np.array([np.interp(times, known, axis) for axis in rows.T]).T


def _meanwhile(ticks: Sequence[ArmTick], cycles: Sequence[Cycle]) -> list[Cycle]:
    first = ticks[0].frame_ns - round(2e9 / RATE_HZ)  # before that everything was read back
    return [cycle for cycle in cycles if cycle.begun_ns >= first]


class ArmWatch:
    """Lets the arm take part in a trial, and keeps what it does.

    Attributes:
        goal: what a tick of the session asks of the arm.
        record: is called after each tick of the way back.
    """

    def __init__(self, loop: ArmLoop) -> None:
        """Around a loop."""
        self.loop = loop
        self.goal: Callable[[Tick], PalmGoal] = palm_goal
        self._ticks: list[ArmTick] = []
        self._session: list[Tick] = []
        self._cycles: list[Cycle] = []
        self._back = WayBack()
        self._given_up = ConstraintRelaxation()
        self._taken = 0, 0
        self.record: Callable[[], None] = lambda: None
        self._rested = False

    def begin(self) -> None:
        """A new trial: the arm is checked again."""
        self._rested = False
        self._ticks, self._session, self._cycles, self._back = [], [], [], WayBack()
        self._taken = 0, 0
        self.loop.begin()

    def inputs(self, inputs: Iterable[TickInput]) -> Iterator[TickInput]:
        """What the trial's ticks begin with; after the last of them the arm goes to where it rests."""
        yield from self.loop.timed(inputs)
        self.rest()

    def rest(self) -> None:
        """The arm goes to where it rests, if it has followed in this trial and did not go there yet; all is recorded.

        Whoever interrupts that has pulled the emergency stop: the arm brakes, which is recorded, too.
        """
        if not self._ticks or self._rested:
            return
        try:
            self._go_back()
        except KeyboardInterrupt:
            self._go_back()
            raise
        finally:
            self._rested = True

    def _go_back(self) -> None:
        with WholeTick():
            if not self._back.ticks:
                self._given_up = self.loop.relaxation
                self._cycles += self.loop.cycles()
        self.loop.rest(self._back, watch=lambda tick, cycles: self.record())
        with WholeTick():
            self._back.cycles.extend(self.loop.cycles())
            self.record()

    @property
    def kept_back(self) -> str:
        """Why the arm did not follow in this trial, in one line, where it was not found fit to; '' where it was."""
        return kept_back(self._ticks)

    def watch(self, tick: Tick) -> None:
        """One tick of the session."""
        self._session.append(tick)
        self._ticks.append(self.loop.tick(self.goal(tick)))
        self._cycles += self.loop.cycles()

    @property
    def cycles(self) -> Sequence[Cycle]:
        """Of this trial so far, without the way back."""
        return self._cycles

    def fresh(self) -> tuple[Sequence[ArmTick], Sequence[Cycle]]:
        """Ticks and cycles of this trial, and of the way back from it, since the last call."""
        ticks, cycles = self._taken
        back, own = self._back, (len(self._ticks), len(self._cycles))
        self._taken = own[0] + len(back.ticks), own[1] + len(back.cycles)
        return (
            self._ticks[ticks:] + back.ticks[max(0, ticks - own[0]) :],
            self._cycles[cycles:] + back.cycles[max(0, cycles - own[1]) :],
        )

    def joints(self) -> tuple[Array, Array] | None:
        """(J,) rad as measured last, and as requested last; None before that."""
        return (self._cycles[-1].state.positions, self._ticks[-1].planned) if self._cycles and self._ticks else None

    @property
    def span_ns(self) -> tuple[int, int]:
        """When the frames of the first and of the newest tick were there, ns of the loop's clock; 0 before any."""
        return (self._ticks[0].frame_ns, self._ticks[-1].frame_ns) if self._ticks else (0, 0)

    def end(self, emotion: str, cell: str, met: int) -> ArmTrial | None:
        """What it did; None where that are fewer than :data:`FEWEST` ticks or cycles.

        Args:
            emotion, cell: of the trial.
            met: row of the trial, at the model's rate from its first tick on, in which the palms met originally, -1
                where not known.
        """
        if len(self._ticks) < FEWEST or len(_meanwhile(self._ticks, self._cycles)) < FEWEST:
            return None
        reference = reference_in(self._session, emotion, cell, met)
        # Rows of the reference come at the model's rate; the ticks of a live person come with the frames.
        times = tick_times(self._session)
        frames = np.array([tick.frame_ns for tick in self._ticks], dtype=float)
        rows = np.arange(len(reference.goals)) / RATE_HZ
        rows = rows[rows <= times[len(frames) - 1] + 0.5 / RATE_HZ]  # what was interrupted is no tick
        moments = np.interp(rows, times[: len(frames)], frames)
        trial = arm_trial(reference, self.loop.retarget, self._ticks, self._cycles, self._given_up, moments)
        return replace(trial, back=self._back)


def percentiles(values: Array) -> dict[str, float | None]:
    """``p50``, ``p99`` and ``max`` of values (N,); None of none."""
    if not len(values):
        return {"p50": None, "p99": None, "max": None}
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(float(values.max()), 3)}

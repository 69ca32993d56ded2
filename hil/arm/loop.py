"""The servo arm in a session, tick by tick: through retargeting and the safety envelope to the driver, and back.

Nothing here waits, but for :meth:`ArmLoop.rest`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.planner_values import ArmStep, ConstraintRelaxation, PalmGoal, RetargetState
from highfive.hil.drivers.bus.cycle_ring import Cycle, Mode
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.values import JointCommand
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.interrupts import WholeTick
from highfive.hil.safety import envelope
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.people import Human, Sighting
from highfive.hil.safety.posture import STANDS
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.startup import Check
from highfive.hil.safety.states import HALTED, State
from highfive.hil.safety.values import Inputs, Report, standing
from highfive.hil.session.session import TickInput
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

OFF_COURSE = 0.03
"""rad: where the envelope holds a joint back by more than this, the plan goes on from its commanded position."""

SAME_PACE, SHORT_TICK = 0.02, 0.5
"""A tick that is off the plan's own by a smaller fraction is taken for it; none is taken for shorter than the other."""

REST_S = 15.0
"""At most so long the arm takes to come to rest, s."""

STANDS_S = 1.0
"""So long an arm that was stopped is watched at most until it stands, s."""


@dataclass(frozen=True)
class ArmTick:
    """One tick of the arm.

    Attributes:
        frame_ns: monotonic clock when the tick's frame was there, ns.
        goal: what was requested.
        planned: (J,) rad, where retargeting planned the joints a lag later.
        report: of the envelope; ``report.sent`` is what went to the driver, unchanged.
        retarget_ms: what retargeting took, ms.
        step_ms: what retargeting and envelope took, ms.
    """

    frame_ns: int
    goal: PalmGoal
    planned: Array
    report: Report
    retarget_ms: float
    step_ms: float


@dataclass(frozen=True)
class WayBack:
    """What the arm does on its way to where it rests, as it comes.

    Attributes:
        ticks, cycles: of the arm and of the bus.
    """

    ticks: list[ArmTick] = field(default_factory=list)
    cycles: list[Cycle] = field(default_factory=list)


Watch = Callable[[ArmTick, Sequence[Cycle]], None]
"""Is given each tick, and the cycles of the bus since the one before."""


class Driver(Protocol):
    """Is commanded, and says what the arm does: :class:`highfive.hil.drivers.bus.arm_process.ArmProcess`, or a twin."""

    @property
    def mode(self) -> Mode:
        """What it is doing."""
        ...

    @property
    def trouble(self) -> str:
        """What is wrong, in one line; '' for nothing."""
        ...

    def drive(self, command: JointCommand) -> None:
        """Gives a command."""
        ...

    def newest(self) -> Cycle | None:
        """The last cycle."""
        ...

    def unread(self) -> list[Cycle]:
        """The cycles since the last call."""
        ...

    def pass_over(self) -> None:
        """Leaves out the cycles since the last call."""
        ...


@dataclass(frozen=True)
class _Seen:
    """A part of the person, and when one of its markers was last measured, ns of the loop's clock."""

    measured_ns: int
    deviation: float = 0.0

    def again(self, sighting: Sighting | None, given: bool, at_ns: int, ahead_ns: int) -> _Seen:
        """After a tick for ``at_ns``, ``ahead_ns`` after its frame; where that says nothing of how, the ``given`` was
        measured in it.

        What was not measured in it was measured no later than before, whatever the source's own clock makes of that.
        """
        if sighting is None:
            return _Seen(at_ns - ahead_ns) if given else self
        measured = at_ns - sighting.age_ns
        hidden = sighting.age_ns > ahead_ns
        return _Seen(min(measured, self.measured_ns) if hidden else measured, sighting.deviation)

    def at(self, now_ns: int) -> Sighting:
        """Now."""
        return Sighting(max(0, now_ns - self.measured_ns), self.deviation)


class ArmLoop:
    """Retargeting, envelope and driver in a row. One owner, one thread."""

    def __init__(
        self,
        arm: Driver,
        retarget: Retarget,
        limits: Limits,
        checked: Callable[[], Check],
        estop: Latch,
        clock: Clock = MACHINE,
    ) -> None:
        """Nothing moves before :meth:`begin`.

        Args:
            arm: the driver, engaged.
            retarget: for the arm on its mount.
            limits: of the envelope.
            checked: makes the start-up check.
            estop: the emergency stop.
            clock: of the driver.
        """
        self._arm, self.retarget, self.limits = arm, retarget, limits
        self._checked, self.estop, self.clock = checked, estop, clock
        self._human: Human | None = None
        self._estimated_ns = self._frame_ns = self._at_ns = self._before_ns = clock.now()
        self._ahead_ns = 0
        self._head = self._palm = _Seen(self._frame_ns)
        self._check: Check | None = None
        self._standing = standing(clock.now(), len(limits.joints))
        self._state: RetargetState | None = None
        self._reference: Array | None = None
        self._on_course = False

    def begin(self) -> None:
        """Has everything checked; then the arm follows, from where it stands.

        Raises:
            HighFiveError: the check found something, or the arm was stopped. It does not move.
        """
        if self.trouble:
            raise HighFiveError(self.trouble)
        self._check = self._checked()
        if self._check.mismatches:
            raise HighFiveError(first_of(self._check.mismatches))
        self._standing = standing(self._check.time_ns, len(self.limits.joints), self._standing.feed_forward)
        self._state = self._reference = None
        self._arm.pass_over()

    @property
    def state(self) -> State:
        """What the arm is doing."""
        return self._standing.state

    @property
    def trouble(self) -> str:
        """Why the arm is not to be driven any more, in one line; '' while it is."""
        follows = self.gone and self._arm.trouble and self.stopped_by <= {Rule.SILENT_SERVO, Rule.HEALTH}
        if self._standing.state in HALTED and not follows:  # that servos are silent says less than that nobody asks
            return self._standing.reason
        if self._arm.mode in (Mode.STOPPED, Mode.PORT_LOST, Mode.ENDED):
            return self._arm.trouble or self.estop.said or "the arm was stopped"
        return ""

    @property
    def stopped_by(self) -> frozenset[Rule]:
        """The envelope's rules that stopped the arm; none while it is driven, or where its driver stopped it."""
        return self._standing.stopped_by if self._standing.state in HALTED else frozenset()

    @property
    def gone(self) -> bool:
        """The driver's process, or its port, is not there any more."""
        return self._arm.mode in (Mode.PORT_LOST, Mode.ENDED)

    @property
    def _braking(self) -> bool:
        """A controlled stop takes some ticks; a driver that has stopped the arm by itself hears no more of them."""
        return self.state is State.STOPPING and self._arm.mode not in (Mode.STOPPED, Mode.PORT_LOST, Mode.ENDED)

    @property
    def _rests(self) -> bool:
        """There is no way left to go: it is where it rests, was never led, or was stopped, said why, and stands."""
        if self._braking:
            return False
        if not self.trouble or self.state is State.UNCHECKED:
            return self.state in (State.READY, State.UNCHECKED)
        if self.gone:  # nobody says any more where it is
            return self.state in (State.STOPPED, State.ESTOPPED)
        newest = self._arm.newest()
        return self.state in HALTED and (newest is None or float(np.abs(newest.state.velocities).max()) < STANDS)

    @property
    def relaxation(self) -> ConstraintRelaxation:
        """What the high five that is on, or was last, had to give up."""
        return ConstraintRelaxation() if self._state is None else self._state.relaxation

    def timed(self, inputs: Iterable[TickInput]) -> Iterator[TickInput]:
        """The inputs of a session's ticks, each with a note of when it is meant for."""
        for begins in inputs:
            self.note_frame(begins.at_ns, begins.ahead_ns)
            yield begins

    def note_frame(self, at_ns: int | None = None, ahead_ns: int = 0) -> None:
        """The next tick begins; it is for ``at_ns`` of the loop's clock (None: now), ``ahead_ns`` after its frame."""
        self._frame_ns = self.clock.now()
        self._at_ns, self._ahead_ns = self._frame_ns if at_ns is None else at_ns, ahead_ns

    @property
    def measured(self) -> Array | None:
        """(J,) rad, what the servos said last; None before they did."""
        newest = self._arm.newest()
        return None if newest is None else newest.state.positions

    def cycles(self) -> list[Cycle]:
        """What the bus did since the last call."""
        return self._arm.unread()

    def tick(self, goal: PalmGoal, *, run: bool = True) -> ArmTick:
        """One tick: plans, lets through what is safe, and gives it to the driver.

        Args:
            goal: of this tick.
            run: the arm shall follow; otherwise it goes back to where it rests.
        """
        started, begun = time.perf_counter_ns(), self.clock.now()
        newest = self._arm.newest()
        arm, health = (None, None) if newest is None else (newest.state, newest.health)
        if self._state is None and arm is not None:
            self._state = self.retarget.start(arm.positions)
        state = self._state or self.retarget.start()
        planning = time.perf_counter_ns()
        seconds = self._elapsed()
        state, step = self.retarget.step(state, goal, seconds)
        retarget_ms = 1e-6 * (time.perf_counter_ns() - planning)
        inputs = Inputs(
            step.joints, arm, health, self._person(goal, begun), run, self._check, self.estop.pulled_ns,
            feed_forward=self._feed_forward(step),
        )  # fmt: skip
        self._standing, command, report = envelope.step(
            self.limits, self.retarget.arm.points, self._standing, inputs, begun
        )
        if command is not None:
            self._arm.drive(command)
        self._state = self._followed(state, step.joints, report, seconds)
        step_ms = 1e-6 * (time.perf_counter_ns() - started)
        return ArmTick(self._frame_ns, goal, step.joints, report, retarget_ms, step_ms)

    def play(
        self, goals: Iterable[PalmGoal], back: WayBack | None = None, watch: Watch | None = None
    ) -> tuple[list[ArmTick], list[Cycle]]:
        """Goals of a high five, one per tick, from now on; then to where the arm rests. Ends early once it was stopped.

        Args:
            goals: of the ticks.
            back: added to on the way back.
            watch: is called once a tick's command is given, also on the way back; it has to be quick.

        Returns:
            the ticks, and the cycles of the bus until the last of them.

        Raises:
            HighFiveError: the check found something.
        """
        self.begin()
        ticks: list[ArmTick] = []
        cycles: list[Cycle] = []
        due, period = self.clock.now(), round(1e9 * self.limits.timing.period_s)
        for goal in goals:
            self.clock.wait_until(due)
            now = self.clock.now()
            if now - due > period // 4:  # a pause of the machine: no tick is made up for in a hurry
                due = now
            self.note_frame()
            ticks.append(self.tick(goal))
            fresh = self.cycles()
            cycles += fresh
            if watch is not None:
                watch(ticks[-1], fresh)
            due += period
            if self.trouble and not self._braking:
                break
        self.rest(WayBack() if back is None else back, watch=watch)
        return ticks, cycles

    def rest(self, back: WayBack | None = None, longest_s: float = REST_S, watch: Watch | None = None) -> None:
        """Goes back along the known path, slowly, and waits until the arm stands; a stop that is on is brought to its
        end. An arm that its driver has stopped is led nowhere: a tick says why, and it is watched until it stands.

        Args:
            back: added to meanwhile; None leaves the cycles unread.
            longest_s: s, that this takes.
            watch: as in :meth:`play`; where there is a ``back``.
        """
        plate = self.retarget.arm.plate_at(self.retarget.ready)
        goal = PalmGoal(PalmPose(plate.position, plate.normal, plate.fingers, np.zeros(3)))
        due, end = self.clock.now(), self.clock.now() + round(longest_s * 1e9)
        stopped = False
        while due < end and not self._rests:
            if self.trouble and not self._braking and not stopped:
                stopped, end = True, min(end, due + round(STANDS_S * 1e9))
            with WholeTick():  # what an interrupt cuts short would not be recorded
                self.note_frame()
                tick = self.tick(goal, run=False)
                if back is not None:
                    fresh = self.cycles()
                    back.ticks.append(tick)
                    back.cycles.extend(fresh)
                    if watch is not None:
                        watch(tick, fresh)
            due += round(1e9 * self.limits.timing.period_s)
            self.clock.wait_until(due)

    def _person(self, goal: PalmGoal, now_ns: int) -> Human | None:
        """The person as estimated last, and when head and hand were last measured."""
        self._head = self._head.again(goal.head_seen, goal.head is not None, self._at_ns, self._ahead_ns)
        self._palm = self._palm.again(goal.person_seen, goal.person is not None, self._at_ns, self._ahead_ns)
        if goal.head is not None:
            palm = goal.person
            at, velocity = (None, None) if palm is None else (palm.position, palm.velocity)
            self._human, self._estimated_ns = Human(goal.head, at, velocity, 0), self._at_ns
        if self._human is None:
            return None
        age_ns = max(0, now_ns - self._estimated_ns)
        return replace(self._human, age_ns=age_ns, head_seen=self._head.at(now_ns), palm_seen=self._palm.at(now_ns))

    def _feed_forward(self, step: ArmStep) -> Array:
        """(J,) rad, by how much goals shall lead: what each joint gives way to its torque.

        Off the plan's course only gravity's torque is known, of the joints' commanded positions.
        """
        sag, reference = np.array(self.retarget.settings.sag or 0.0), self._reference
        torques = step.torques if self._on_course or reference is None else self.retarget.arm.gravity(reference)
        return sag * torques

    def _elapsed(self) -> float:
        """From the last tick to this one, s, as far as the envelope follows: ticks come at the pace of the frames.

        What is nearly the plan's own tick is taken for it, and so is a tick of which no time is noted.
        """
        tick, elapsed = self.retarget.settings.tick, 1e-9 * (self._at_ns - self._before_ns)
        self._before_ns = self._at_ns
        if elapsed <= 0.0 or abs(elapsed - tick) < SAME_PACE * tick:
            return tick
        return min(max(elapsed, SHORT_TICK * tick), envelope.LATE_TICK * tick)

    def _followed(self, state: RetargetState, planned: Array, report: Report, seconds: float) -> RetargetState:
        """The plan's state, from what was really commanded."""
        reference = report.reference
        before, self._reference = self._reference, reference
        near = reference is not None and float(np.abs(reference - planned).max()) < OFF_COURSE
        self._on_course = near and report.state is State.TRACKING
        if reference is None or near:
            return state
        speeds = np.zeros_like(reference) if before is None else (reference - before) / seconds
        most = self.retarget.arm.packed.speeds
        return self.retarget.moved(state, reference, np.clip(speeds, -most, most))


def first_of(lines: Sequence[str]) -> str:
    """The first of some lines, and how many there are besides."""
    return lines[0] + (f" (and {len(lines) - 1} more)" if len(lines) > 1 else "")

"""How long the emulated rig takes to stop, in virtual time: from an event at any phase of the cycle to the last motion.

The arm swings, as fast as it may near nobody (:func:`stopped_by`), or plays a high five (:func:`high_five_at`);
then something happens. What counts is what the servos were commanded
(:class:`~highfive.hil.bench.black_box.BlackBox`): when a goal last changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.arm.loop import ArmTick
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.planner_values import PalmGoal
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.drivers.bus.cycle_ring import Mode
from highfive.hil.drivers.bus.rig import Rig, load_rig
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualArm, VirtualRig
from highfive.hil.drivers.values import JointCommand
from highfive.hil.runtime.virtual_clock import VirtualClock, VirtualTask
from highfive.hil.safety.people import Sighting
from highfive.hil.safety.states import State

PERIOD_NS = 8_333_333
SWING, SWING_HZ = np.array([0.25, 0.08, 0.25, 0.12, 0.25, 0.25]), 0.8  # rad
CURRENT = 2.0  # A
_BEFORE_NS, _AFTER_NS = 150_000_000, 250_000_000
_LOOKED_AT = 24  # ticks after the event
_LOOK_NS = 500_000

ENGAGING = -1
"""Before the first tick: the limp arm has been watched, and is being switched on and checked."""
_ENGAGING_NS = (1_500_000_000, 2_000_000_000)  # after the session has begun with the arm


@dataclass(frozen=True)
class Stopped:
    """What came of an event.

    Attributes:
        changed_ms: until a goal last changed, ms after it.
        commanded_ms: the same without what servos make their goal by themselves, as they are switched on or their
            watchdog trips.
        stood_ms: until the body stood, ms after it.
        mode: of the driver in the end.
        trips: watchdogs that have tripped.
        moved: rad, the furthest that a joint's body was after it from where it was then.
    """

    changed_ms: float
    commanded_ms: float
    stood_ms: float
    mode: Mode
    trips: int
    moved: float


Happening = Callable[["Swinging"], None]


@dataclass
class Swinging:
    """A rig that swings, and who makes it."""

    virtual: VirtualRig
    arm: VirtualArm
    host: VirtualTask | None = None

    @property
    def has_host(self) -> bool:
        """The host is alive."""
        return self.host is None or self.host.alive


def pull(it: Swinging) -> None:
    """The emergency stop is pulled."""
    it.arm.estop.pull()


def kill_host(it: Swinging) -> None:
    """The host is killed; the driver lives."""
    assert it.host is not None
    it.host.kill()


def kill_both(it: Swinging) -> None:
    """Power goes off at the computer: host and driver end at once, and only the servos' watchdogs are left."""
    kill_host(it)
    it.arm.task.kill()


def stall_host(it: Swinging) -> None:
    """The host stands still."""
    assert it.host is not None
    it.host.hold(it.virtual.clock.now() + 10**10)


def stopped_by(happening: Happening, phase: float, rig: Rig | None = None) -> Stopped:
    """What comes of ``happening`` at that phase, 0 to 1, of the driver's cycle.

    The host gives a command a period and does nothing of its own: what stops the arm is the driver or the servos.
    """
    rig = load_rig() if rig is None else rig
    with VirtualClock() as clock:
        bus = make_bus(emulator_options(ArmOptions()))
        box = BlackBox(bus, rig)
        virtual = VirtualRig(clock, bus, box.look)
        hosts: list[VirtualTask] = []
        arm = virtual.start_arm(rig, has_host=lambda: all(host.alive for host in hosts))
        it = Swinging(virtual, arm)
        arm.wait_ready()
        arm.engage()
        it.host = clock.start("host", lambda: _swing(it))
        hosts.append(it.host)
        clock.wait_until(clock.now() + _BEFORE_NS)
        newest = arm.newest()
        begun = clock.now() if newest is None else newest.begun_ns
        clock.wait_until(begun + 2 * PERIOD_NS + round(phase * PERIOD_NS))
        at = clock.now()
        happening(it)
        clock.wait_until(at + _AFTER_NS)
        return _stopped(box, arm, bus.watchdog_trips, at)


def _stopped(box: BlackBox, arm: VirtualArm, trips: int, at: int) -> Stopped:
    changed, stood = box.last_change_ns(at) - at, max(0, box.stands_since_ns() - at)
    positions = np.array(box.positions)[np.searchsorted(box.times, at) - 1 :]
    moved = float(np.abs(positions - positions[0]).max())
    return Stopped(1e-6 * changed, box.commanded_after_ms(at), 1e-6 * stood, arm.mode, trips, moved)


def _swing(it: Swinging) -> None:
    clock, newest = it.virtual.clock, it.arm.newest()
    assert newest is not None
    begun = due = clock.now()
    while True:
        angle = 2.0 * np.pi * SWING_HZ * 1e-9 * (due - begun)
        it.arm.drive(JointCommand(newest.state.positions + SWING * np.sin(angle), np.full(len(SWING), CURRENT)))
        due += PERIOD_NS
        clock.wait_until(due)


@dataclass
class Begun:
    """A high five of the emulated rig that has come to where something is to happen; whatever does is not undone.

    Attributes:
        virtual: the rig.
        box: what is seen of it.
        host: who plans, keeps the arm safe and commands it as in a session.
        since_ns: phase 0.
        span_ns: from there to phase 1.
        ticks: of the high five, as it goes on.
        lost: at which phase the person was last measured; empty while she is.
    """

    virtual: VirtualRig
    box: BlackBox
    host: VirtualTask | None = None
    since_ns: int = 0
    span_ns: int = PERIOD_NS
    ticks: list[ArmTick] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)

    def stopped(self, happening: Happening, phase: float) -> Stopped:
        """What comes of ``happening`` at that phase, 0 to 1."""
        clock, arm = self.virtual.clock, self.virtual.arm
        assert arm is not None and arm.estop.pulled_ns is None
        clock.wait_until(self.since_ns + round(phase * self.span_ns))
        happened = clock.now()
        happening(Swinging(self.virtual, arm, self.host))
        clock.wait_until(happened + _AFTER_NS)
        return _stopped(self.box, arm, self.virtual.bus.watchdog_trips, happened)

    def dead_servo_ms(self, phase: float, servo: int = 4) -> float:
        """ms from a servo's death at that phase until the envelope stops the arm."""
        self.virtual.clock.wait_until(self.since_ns + round(phase * self.span_ns))
        died = self.virtual.now()
        self.virtual.bus.set_faults(parse_faults([f"dead={servo}"]), died)
        return 1e-6 * (self._reached(State.STOPPING) - self.virtual.since_ns(died))

    def hold_ms(self, phase: float) -> float:
        """ms from the last measurement of the person, so much of a period before the next tick, to the hold."""
        frame = len(self.ticks) + 1
        self.lost.append(phase)
        held = self._reached(State.HOLDING)
        return 1e-6 * (held - (self.ticks[frame].frame_ns - phase * PERIOD_NS))

    def _reached(self, state: State) -> float:
        """When a tick first said so, ns; endless where none did for long."""
        for _ in range(_LOOKED_AT):
            self.virtual.clock.wait_until(self.virtual.clock.now() + PERIOD_NS)
            if found := [one.report.time_ns for one in self.ticks if one.report.state is state]:
                return found[0]
        return float("inf")


@contextmanager
def high_five_at(reference: ReferenceTrajectory, retarget: Retarget, tick: int) -> Iterator[Begun]:
    """A high five that has come to the beginning of that tick.

    :data:`ENGAGING` for a tick is the time in which the host has the arm switched on and checked: phases are of that
    time. Whoever looks at many phases of one tick does so in copies of the process.
    """
    with VirtualClock() as clock:
        bus = make_bus(emulator_options(ArmOptions()))
        box = BlackBox(bus, load_rig())
        begun = Begun(VirtualRig(clock, bus, box.look), box)

        def play() -> None:
            has_host = lambda: begun.host is None or begun.host.alive  # noqa: E731
            with virtual_arm(begun.virtual, retarget=retarget, has_host=has_host) as loop:
                if tick == ENGAGING:
                    first, last = _ENGAGING_NS
                    begun.since_ns, begun.span_ns = clock.now() + first, last - first
                loop.play(goals(), watch=lambda tick, _: begun.ticks.append(tick))

        def goals() -> Iterator[PalmGoal]:
            seen = reference.goals[0]
            for number, goal in enumerate(reference.goals):
                if number == tick:
                    begun.since_ns = clock.now()
                yield _unseen(goal, seen, (number - tick - 1 + begun.lost[0]) * PERIOD_NS) if begun.lost else goal
                seen = seen if begun.lost else goal

        begun.host = clock.start("host", play)
        while not begun.since_ns and begun.host.alive:
            clock.wait_until(clock.now() + _LOOK_NS)
        assert begun.since_ns, begun.host.error
        clock.wait_until(begun.since_ns)
        yield begun


def _unseen(goal: PalmGoal, last: PalmGoal, late_ns: float) -> PalmGoal:
    """A goal whose person was last measured so long before it."""
    unseen = Sighting(round(late_ns), 0.0)
    return replace(goal, person=last.person, head=last.head, person_seen=unseen, head_seen=unseen)

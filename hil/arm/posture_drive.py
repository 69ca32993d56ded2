"""Drives an arm from posture to posture, slowly, through the safety envelope; it waits while somebody is in the way."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from highfive.hil.arm.free_postures import RESTS, way_is_free
from highfive.hil.arm.loop import Driver, first_of
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.drivers.bus.cycle_ring import Cycle, Mode
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.values import JointState
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.safety import envelope, motion, retract
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.people import Human
from highfive.hil.safety.startup import Check
from highfive.hil.safety.states import HALTED, State
from highfive.hil.safety.values import Inputs, standing
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class DriveSettings(Settings):
    """How postures are reached."""

    joint_speed: float = setting(0.8, "rad/s", above=0.0)
    point_speed: float = setting(0.2, "m/s", above=0.0)
    """Most that any known point of the arm moves at: below that of a face (0.22)."""
    ramp: float = setting(0.5, "s", above=0.0)
    """For so long it speeds up, and slows down."""
    still: float = setting(0.01, "rad/s", above=0.0)
    """A slower joint stands; servos count in steps of 0.024."""
    stands_within: float = setting(4.0, "s", above=0.0)
    says: float = setting(0.5, "s", least=0.0)
    """So long somebody is in the way before it is said; once on a way."""
    patience: float = setting(30.0, "s", above=0.0)
    """So long somebody may be in the way before it is given up."""


DRIVE = DriveSettings()

NO_WAY_BACK = "the straight way to where it rests leads through the floor, its mount or itself"

Value = TypeVar("Value")

_FAR = np.array([30.0, 0.0, 1.6])
"""m, where the head of nobody is: the envelope lets nothing move without a person it knows of."""


def way_seconds(body: ServoArm, start: Array, target: Array, settings: DriveSettings = DRIVE) -> float:
    """That the way between two postures (J,), rad, takes: at constant speed, with ramps, joints and points slow."""
    change = target - start
    quickest = [float(np.abs(change).max()) / settings.joint_speed]
    for share in np.linspace(0.0, 1.0, 9):
        moves = body.points(start + share * change)[1] @ change
        quickest.append(float(np.linalg.norm(moves, axis=1).max()) / settings.point_speed)
    return max(quickest) + settings.ramp


class PostureDrive:
    """One arm, checked, that goes where it is told. One owner, one thread.

    Whoever drives computes before or afterwards: an arm that is not told of its place for 80 ms stops.
    """

    def __init__(
        self,
        arm: Driver,
        body: ServoArm,
        limits: Limits,
        sag: Array,
        checked: Callable[[], Check],
        estop: Latch,
        clock: Clock,
        in_the_way: Callable[[], str],
        command: Callable[[str], str],
        settings: DriveSettings = DRIVE,
    ) -> None:
        """Has everything checked; the arm stands.

        Args:
            arm: the driver, ready.
            body: as drawn.
            limits: of the envelope.
            sag: (J,) rad/(N·m), by which joints give way that goals lead by.
            checked: makes the start-up check, and engages the arm.
            estop: the emergency stop.
            clock: of the driver.
            in_the_way: why the arm must not move now, in one line; '' where it may. Asked in every tick.
            command: what to type for a command of ``highfive rig`` about this arm.
            settings: how fast.

        Raises:
            HighFiveError: the check found something.
        """
        self._arm, self._body, self._limits, self._sag = arm, body, limits, sag
        self._estop, self.clock, self._in_the_way, self.settings = estop, clock, in_the_way, settings
        self.command = command
        self._standing = standing(clock.now(), len(limits.joints))
        self._check = checked()
        if self._check.mismatches:
            raise HighFiveError(first_of(self._check.mismatches))
        self._standing = standing(self._check.time_ns, len(limits.joints))
        self._reference: Array | None = None
        self._stays = False
        self.moving_s = 0.0
        """For so long it moved, s."""
        arm.pass_over()

    @property
    def positions(self) -> Array:
        """(J,) rad, as the servos said last."""
        return self.measured.positions

    @property
    def measured(self) -> JointState:
        """What the servos said last."""
        newest = self._arm.newest()
        if newest is None:
            raise HighFiveError("the arm was not read")
        return newest.state

    @property
    def reference(self) -> Array:
        """(J,) rad, where the joints are commanded to be; where they are, before they were commanded anything."""
        return self.positions if self._reference is None else self._reference

    def go(self, target: Array) -> Array:
        """Goes straight to a posture (J,), rad, and stands there; from which side each joint came (J,), ± 1.

        Raises:
            HighFiveError: the arm was stopped, did not come to stand, or somebody stayed in the way.
        """
        start = self.reference
        seconds = way_seconds(self._body, start, target, self.settings)
        period, done, waited, told = self._limits.timing.period_s, 0.0, 0.0, False
        while done < seconds:
            if why := self._in_the_way():
                waited += period
                if waited > self.settings.says and not told:
                    say_aside(f"the arm waits: {why}")
                    told = True
                if waited > self.settings.patience:
                    raise HighFiveError(f"{why}; the arm waited for {waited:.0f} s and goes back")
            else:
                done, waited = min(seconds, done + period), 0.0
                self.moving_s += period
            self.tick(start + self._share(done, seconds) * (target - start))
        self._stand(target)
        return np.where(target >= start, 1.0, -1.0)

    def hold(self, seconds: float, encoders: list[Array], look: Callable[[], object]) -> None:
        """Stands where it is, and adds what the servos say (J,), rad, in each cycle; ``look`` is called every tick."""
        end = self.clock.now() + round(1e9 * seconds)
        self._arm.pass_over()
        assert self._reference is not None
        while self.clock.now() < end:
            self.tick(self._reference)
            encoders += [cycle.state.positions for cycle in self._arm.unread()]
            look()

    def follow(
        self, course: Callable[[float], Array], seconds: float, look: Callable[[], object] = lambda: None
    ) -> list[Cycle]:
        """Leads the arm along a course, (J,) rad at s from now on, and returns the bus's cycles meanwhile; ``look`` is
        called every tick.

        Raises:
            HighFiveError: the arm was stopped, or somebody is in the way.
        """
        period, done, cycles = self._limits.timing.period_s, 0.0, []
        self._arm.pass_over()
        while done < seconds:
            if why := self._in_the_way():
                raise HighFiveError(why)
            done += period
            self.moving_s += period
            self.tick(course(done))
            cycles += self._arm.unread()
            look()
        return cycles

    def while_standing(self, work: Callable[[], Value]) -> Value:
        """Has something done that takes some time, or waits for the disk, while the arm is told of its place.

        Not in one piece of compiled code: threads take turns between such calls alone.

        Raises:
            HighFiveError: the arm was stopped; or what ``work`` raises.
        """
        if self.clock is not MACHINE:  # there nothing takes time
            return work()
        with ThreadPoolExecutor(1) as beside:
            done = beside.submit(work)
            while not done.done():
                self.tick(self.reference)
            return done.result()

    def stay(self) -> None:
        """Stands where it is, and is not brought back to where it rests.

        Raises:
            HighFiveError: it was stopped, or does not come to stand.
        """
        self._stays = True
        self._stand(motion.target_position(self._limits, self.reference)[0])

    def rest(self, longest_s: float = 30.0) -> None:
        """Goes back along the known path, slowly, and waits until the arm stands; where no free way leads there, it
        stays where it is.

        Raises:
            HighFiveError: it was stopped before it was on its way.
        """
        if self._stays or self._rests:
            return
        at = self.reference
        on_the_path = self._limits.way_points[retract.nearest(self._limits, at)]
        if not self.while_standing(
            lambda: way_is_free(self._body, at, on_the_path, min(0.0, self._body.clearance(at)) - RESTS)
        ):
            say_aside(f"the arm stays where it is: {NO_WAY_BACK}")
            return
        end = self.clock.now() + round(1e9 * longest_s)
        while self.clock.now() < end and not self._rests:
            self._tick(None, run=False)

    @property
    def _rests(self) -> bool:
        """There is no way left to go."""
        return self._standing.state in (State.READY, State.UNCHECKED, *HALTED)

    def tick(self, wanted: Array) -> None:
        """One period in which the arm is to be at (J,), rad.

        Raises:
            HighFiveError: the arm was stopped.
        """
        self._tick(wanted, run=True)
        if self._standing.state in HALTED:
            raise HighFiveError(f"the arm was stopped: {self._standing.reason}")
        if self._arm.mode in (Mode.STOPPED, Mode.PORT_LOST, Mode.ENDED):
            raise HighFiveError(self._arm.trouble or ": ".join(filter(None, ("the arm was stopped", self._estop.said))))

    def _tick(self, wanted: Array | None, *, run: bool) -> None:
        now, newest = self.clock.now(), self._arm.newest()
        arm, health = (None, None) if newest is None else (newest.state, newest.health)
        at = wanted if self._reference is None else self._reference
        lead = None if at is None else self._sag * self._body.gravity(at)
        nobody = Human(_FAR, None, None, 0)
        inputs = Inputs(wanted, arm, health, nobody, run, self._check, self._estop.pulled_ns, feed_forward=lead)
        self._standing, command, report = envelope.step(self._limits, self._body.points, self._standing, inputs, now)
        if command is not None:
            self._arm.drive(command)
        self._reference = report.reference if report.reference is not None else self._reference
        self.clock.wait_until(now + round(1e9 * self._limits.timing.period_s))

    def _share(self, now: float, seconds: float) -> float:
        """Of the way that is done after so long: speed rises and falls along a straight line."""
        ramp = min(self.settings.ramp, 0.5 * seconds)
        speed = 1.0 / (seconds - ramp)
        if now < ramp:
            return 0.5 * speed * now**2 / ramp
        if now > seconds - ramp:
            return 1.0 - 0.5 * speed * (seconds - now) ** 2 / ramp
        return speed * (now - 0.5 * ramp)

    def _stand(self, target: Array) -> None:
        end = self.clock.now() + round(1e9 * self.settings.stands_within)
        while self.clock.now() < end:
            self.tick(target)
            newest = self._arm.newest()
            assert newest is not None and self._reference is not None
            there = float(np.abs(self._reference - target).max()) < 1e-3
            if there and float(np.abs(newest.state.velocities).max()) < self.settings.still:
                return
        raise HighFiveError("the arm does not come to stand; a joint hunts or is pushed: lower its P gain, or clear it")

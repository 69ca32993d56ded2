"""The twin in virtual time beside others: it goes on with the clock of a live session, one cycle after the other."""

from __future__ import annotations

from highfive.hil.arm.loop import ArmLoop
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.rig_planner import full_errors
from highfive.hil.arm.simulated_driver import SimulatedDriver, mounted_arm
from highfive.hil.drivers.bus.cycle_ring import Cycle, Mode
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.values import JointCommand
from highfive.hil.runtime.clock import Clock
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.safety.startup import Check


class ClockedTwin:
    """A :class:`SimulatedDriver` that has done its cycles up to now whenever it is asked.

    A command takes effect with the next cycle, as on the bus.
    """

    trouble = ""

    def __init__(self, twin: SimulatedDriver, clock: Clock, period_ns: int) -> None:
        """Goes on by ``clock``, with a cycle each ``period_ns``, from what the twin's own clock says."""
        self._twin, self._clock, self._period_ns = twin, clock, period_ns

    @property
    def mode(self) -> Mode:
        """What it is doing."""
        return self._twin.mode

    def drive(self, command: JointCommand) -> None:
        """What its servos are commanded from the next cycle on."""
        self._catch_up()
        self._twin.drive(command)

    def newest(self) -> Cycle | None:
        """The last cycle."""
        self._catch_up()
        return self._twin.newest()

    def unread(self) -> list[Cycle]:
        """The cycles since the last call."""
        self._catch_up()
        return self._twin.unread()

    def pass_over(self) -> None:
        """Leaves out the cycles since the last call."""
        self._catch_up()
        self._twin.pass_over()

    def _catch_up(self) -> None:
        while (end := self._twin.now() + self._period_ns) <= self._clock.now():
            self._twin.wait_until(end)


def clocked_loop(retarget: Retarget, clock: Clock) -> ArmLoop:
    """The twin at rest, ready to take part in a session by ``clock``."""
    limits = load_limits()
    driver = SimulatedDriver(mounted_arm(), full_errors(load_rig()), clock.now())
    twin = ClockedTwin(driver, clock, round(1e9 * limits.timing.period_s))
    return ArmLoop(twin, retarget, limits, lambda: Check(clock.now(), ()), Latch(clock), clock)

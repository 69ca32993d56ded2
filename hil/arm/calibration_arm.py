"""An arm made ready for a calibration: checked, engaged and slow; it goes back to where it rests afterwards."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.emergency_stop import SIGNALS, listening
from highfive.hil.arm.lifecycle import START_S, checked, tell_torque, weakened
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm.preconditions import check_arm, check_options, refuse_unless_ready
from highfive.hil.arm.rig_planner import sags
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.drivers.bus.arm_host import ArmHost
from highfive.hil.drivers.bus.arm_process import ArmProcess
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.servo_port import ALLOWANCE_MS
from highfive.hil.drivers.emulator.virtual_rig import PATH, VirtualRig
from highfive.hil.drivers.latch import Latch
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.interrupts import answered_by_a_stop
from highfive.hil.safety.limits import Limits
from highfive.hil.session.session import RATE_HZ


@contextmanager
def calibration_arm(options: ArmOptions, body: ServoArm, in_the_way: Callable[[], str]) -> Iterator[PostureDrive]:
    """A real arm, ready; key, signals and pipe stop it.

    Args:
        options: which arm; always slow.
        body: as it is known.
        in_the_way: why it must not move now; '' where it may.

    Raises:
        HighFiveError: port, rig or limits cannot be used, a servo is not as it has to be, or the port is not armed.
            Nothing has moved then.
    """
    limits, rig = check_arm(options)
    estop = Latch()
    with ExitStack() as stack:
        terminal = 0 if sys.stdin.isatty() else None
        stack.enter_context(listening(estop, terminal, pipe=options.estop, signals=SIGNALS))
        stack.enter_context(answered_by_a_stop())
        stack.callback(tell_torque, options.port, rig)
        arm = ArmProcess(options.port, weakened(rig, limits), RATE_HZ, estop, ALLOWANCE_MS)
        stack.callback(arm.close)
        arm.wait_ready(START_S)
        yield from _driven(arm, body, rig, limits, options, estop, MACHINE, in_the_way)


@contextmanager
def virtual_calibration_arm(
    virtual: VirtualRig, options: ArmOptions, body: ServoArm, in_the_way: Callable[[], str]
) -> Iterator[PostureDrive]:
    """An emulated arm in virtual time, ready as :func:`calibration_arm` makes a real one.

    Raises:
        HighFiveError: as there.
    """
    limits, rig = check_options(options)
    estop = Latch(virtual.clock)
    refuse_unless_ready(PATH, rig, limits, virtual.wiring)
    arm = virtual.start_arm(weakened(rig, limits), RATE_HZ, estop, ALLOWANCE_MS)
    try:
        arm.wait_ready(START_S)
        yield from _driven(arm, body, rig, limits, options, estop, virtual.clock, in_the_way)
    finally:
        arm.close()


def _driven(
    arm: ArmHost, body: ServoArm, rig: Rig, limits: Limits, options: ArmOptions, estop: Latch, clock: Clock,
    in_the_way: Callable[[], str],
) -> Iterator[PostureDrive]:  # fmt: skip
    check = lambda: checked(arm, body, rig, limits, options, clock)  # noqa: E731
    sag, command = sags(rig, body.folder) + body.compliance, lambda verb: rig.command(verb, options.port)
    drive = PostureDrive(arm, body, limits, sag, check, estop, clock, in_the_way, command)
    try:
        yield drive
    finally:
        drive.rest()

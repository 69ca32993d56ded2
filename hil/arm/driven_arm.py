"""An arm made ready to be driven from posture to posture; it goes back to where it rests afterwards."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.lifecycle import START_S, checked, started_arm, weakened
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm.preconditions import check_arm, check_options, refuse_unless_ready
from highfive.hil.arm.rig_planner import sags
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.drivers.bus.arm_host import ArmHost
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.servo_port import ALLOWANCE_MS
from highfive.hil.drivers.emulator.virtual_rig import PATH, VirtualRig
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.priority import going_first
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.safety.limits import Limits
from highfive.hil.session.session import RATE_HZ


@contextmanager
def driven_arm(
    options: ArmOptions, body: ServoArm, in_the_way: Callable[[], str], *, keys: bool = True
) -> Iterator[PostureDrive]:
    """A real arm, or one emulated by the clock, ready; signals and pipe stop it, and, with ``keys``, a key.

    Args:
        options: which arm.
        body: as it is known.
        in_the_way: why it must not move now; '' where it may.
        keys: space and Esc stop it, where there is a terminal.

    Raises:
        HighFiveError: port, rig or limits cannot be used, a servo is not as it has to be, or the port is not armed.
            Nothing has moved then.
    """
    limits, rig = check_arm(options)
    with started_arm(options, limits, rig, keys=keys) as arm, quick_switching(), going_first():
        # What was built until now is not garbage: a collection between two ticks need not look at it.
        gc.collect()
        gc.freeze()
        yield from _driven(arm, body, rig, limits, options, arm.estop, MACHINE, in_the_way)


@contextmanager
def virtual_driven_arm(
    virtual: VirtualRig, options: ArmOptions, body: ServoArm, in_the_way: Callable[[], str]
) -> Iterator[PostureDrive]:
    """An emulated arm in virtual time, ready as :func:`driven_arm` makes a real one.

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

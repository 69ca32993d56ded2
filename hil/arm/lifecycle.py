"""A servo arm made ready for a session, real or emulated, and laid to rest afterwards."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import UTC, datetime

from highfive.hil.arm.arm_files import rig_file, rig_of
from highfive.hil.arm.arm_options import VIRTUAL, ArmOptions
from highfive.hil.arm.calibrated import calibration_file, known_arm, known_lags, known_rig, trusted_calibration
from highfive.hil.arm.emergency_stop import SIGNALS, listening
from highfive.hil.arm.loop import ArmLoop
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.preconditions import check_arm, check_options, check_person, refuse_unless_ready, room
from highfive.hil.arm.rig_planner import planner
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.drivers.bus.arm_host import ArmHost
from highfive.hil.drivers.bus.arm_process import ArmProcess
from highfive.hil.drivers.bus.control_table import load_table, to_si
from highfive.hil.drivers.bus.cycle_ring import Mode
from highfive.hil.drivers.bus.rig import Rig, required_registers
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.bus.servo_port import ALLOWANCE_MS, PATIENCE_MS
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, EmulatorProcess, make_bus
from highfive.hil.drivers.emulator.virtual_rig import PATH, VirtualRig
from highfive.hil.drivers.latch import Latch
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import Bar, say_aside
from highfive.hil.runtime.interrupts import answered_by_a_stop
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.posture import posture_mismatches
from highfive.hil.safety.startup import Check, Registers, ServoLimits, start_up_check
from highfive.hil.session.session import RATE_HZ, STALLED_NS
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.model.compiled import when_compiling
from highfive.model.errors import HighFiveError

PLANT = "highfive.hil.arm.simulated_driver:mounted_arm"
"""The body that emulated servos move."""

START_S = 30.0
"""So long the driver's process may take to begin, s."""

STOOD_S, STANDS_WITHIN_S = 0.3, 4.0
"""So long an arm has to stand where it can before it is driven, and so long that is waited for, s."""


@contextmanager
def ready_arm(options: ArmOptions, bar: Bar | None = None, marker_set: MarkerSet | None = None) -> Iterator[ArmLoop]:
    """An arm that was checked, holds where it stands, and follows; it is brought to rest in the end.

    The emergency stop is armed meanwhile: space or Esc where there is a terminal, SIGTERM, SIGUSR1 and Ctrl-C, and the
    named pipe.

    Args:
        options: which arm.
        bar: shows that it is being made ready, which takes minutes where nothing is compiled yet.
        marker_set: that the live person wears; None where nobody is tracked.

    Raises:
        HighFiveError: port, rig or limits cannot be used, a servo is not as it has to be, a real port is not armed, or
            no marker shows the head of the live person beside it. Nothing has moved then.
    """
    check_person(options, marker_set)
    limits, rig = check_arm(options)
    advance = None if bar is None else bar("arm", 1)
    if advance is not None:
        advance("starting", 0)
    with when_compiling(lambda: advance and advance("compiling, a minute or two the first time", 0)):
        retarget = session_planner(options, rig, limits)
    with ExitStack() as stack:
        if options.port == VIRTUAL:
            terminal = 0 if sys.stdin.isatty() else None
            clock = stack.enter_context(VirtualClock())
            virtual = virtual_rig(clock, options)
            stack.callback(_tell_faults_to_come, options, clock.now(), clock)
            estop = Latch(clock)
            stack.enter_context(listening(estop, terminal, pipe=options.estop, signals=SIGNALS))
            stack.enter_context(answered_by_a_stop())
            stack.enter_context(clock.signals_to_first(SIGNALS))
            loop = stack.enter_context(virtual_arm(virtual, options, retarget, estop))
            if advance is not None:
                advance("", 1)
            yield loop
            return
        arm = stack.enter_context(started_arm(options, limits, rig))
        loop = ArmLoop(arm, retarget, limits, lambda: checked(arm, retarget.arm, rig, limits, options), arm.estop)
        if advance is not None:
            advance("", 1)
        try:
            yield loop
        finally:
            loop.rest()


@contextmanager
def started_arm(options: ArmOptions, limits: Limits, rig: Rig, *, keys: bool = True) -> Iterator[ArmProcess]:
    """The process of a real or emulated arm, which answers; nothing is switched on yet.

    Its emergency stop is armed meanwhile, as in :func:`ready_arm`; with ``keys`` by keys, too.

    Raises:
        HighFiveError: a servo is not as it has to be, or does not answer. Nothing has moved then.
    """
    estop, port = Latch(), options.port
    terminal = 0 if keys and sys.stdin.isatty() else None
    with ExitStack() as stack:
        if options.emulated:
            emulator = stack.enter_context(EmulatorProcess(emulator_options(options)))
            emulator.set_faults(options.faults)
            stack.callback(_tell_faults_to_come, options, MACHINE.now(), MACHINE)
            port = emulator.port
        refuse_unless_ready(port, rig, limits)
        stack.enter_context(listening(estop, terminal, pipe=options.estop, signals=SIGNALS))
        stack.enter_context(answered_by_a_stop())
        if not options.emulated:
            stack.callback(tell_torque, options.port, rig)
        allowance = PATIENCE_MS if options.emulated else ALLOWANCE_MS
        arm = ArmProcess(port, weakened(rig, limits), RATE_HZ, estop, allowance)
        stack.callback(arm.close)
        arm.wait_ready(START_S)
        yield arm


def _tell_faults_to_come(options: ArmOptions, since_ns: int, clock: Clock) -> None:
    """At the end: what was to go wrong later than that, of which nothing has been seen."""
    lasted = 1e-9 * (clock.now() - since_ns)
    for fault in parse_faults(options.faults):
        if fault.start > lasted:
            say_aside(f"--faults: {fault.kind}@{fault.start:g} never came; the arm was driven for {lasted:.1f} s")


def virtual_rig(clock: VirtualClock, options: ArmOptions) -> VirtualRig:
    """Bus, line and servos of an emulated arm in virtual time, with what is to go wrong there."""
    virtual = VirtualRig(clock, make_bus(emulator_options(options)))
    virtual.bus.set_faults(parse_faults(options.faults), virtual.now())
    return virtual


@contextmanager
def virtual_arm(
    virtual: VirtualRig,
    options: ArmOptions | None = None,
    retarget: Retarget | None = None,
    estop: Latch | None = None,
    has_host: Callable[[], bool] = lambda: True,
) -> Iterator[ArmLoop]:
    """An emulated arm in virtual time, checked, engaged and brought to rest as :func:`ready_arm` does.

    Args:
        virtual: bus, line and servos.
        options: limits and rig; None for those that come with the project.
        retarget: for that arm; None makes one.
        estop: the emergency stop; None for one that nobody pulls.
        has_host: whether the host, which calls this, is alive.

    Raises:
        HighFiveError: as :func:`ready_arm`.
    """
    options, clock = options or ArmOptions(), virtual.clock
    limits, rig = check_options(options)
    estop = Latch(clock) if estop is None else estop
    refuse_unless_ready(PATH, rig, limits, virtual.wiring)
    retarget = session_planner(options, rig, limits) if retarget is None else retarget
    arm = virtual.start_arm(weakened(rig, limits), RATE_HZ, estop, ALLOWANCE_MS, has_host)
    try:
        arm.wait_ready(START_S)
        check = lambda: checked(arm, retarget.arm, rig, limits, options, clock)  # noqa: E731
        loop = ArmLoop(arm, retarget, limits, check, estop, clock)
        try:
            yield loop
        finally:
            loop.rest()
    finally:
        arm.close()


def session_planner(options: ArmOptions, rig: Rig, limits: Limits) -> Retarget:
    """Retargeting for the arm of a session, as its calibration has it.

    Raises:
        HighFiveError: as :func:`highfive.hil.arm.calibrated.trusted_calibration`.
    """
    folder, found = find_arm(options.arm), trusted_calibration(options, rig, datetime.now(UTC))
    return planner(rig, limits, known_arm(folder, found), known_lags(found, folder.names))


def emulator_options(options: ArmOptions) -> EmulatorOptions:
    """The emulator of an arm's options, without their faults: an arm that was calibrated is emulated as it is.

    Raises:
        HighFiveError: as :func:`highfive.hil.arm.calibrated.trusted_calibration`.
    """
    folder = find_arm(options.arm)
    path = options.rig or rig_file(folder)
    rig = rig_of(folder, options.rig)
    found = trusted_calibration(options, rig, datetime.now(UTC))
    if found is None:
        return EmulatorOptions(rig=str(path), plant=f"{PLANT}:{options.arm}")
    zeros = tuple(joint.astray for joint in known_rig(rig, found).joints)
    plant = f"{PLANT}:{options.arm}::{calibration_file(options, rig)}"
    return EmulatorOptions(rig=str(path), plant=plant, astray=zeros)


def weakened(rig: Rig, limits: Limits) -> Rig:
    """The rig as the driver knows it: it holds, too, with no more current than the limits say. What the servos are set
    to themselves stays."""
    own = [
        replace(j, current_limit=min(j.current_limit, k.current))
        for j, k in zip(rig.joints, limits.joints, strict=True)
    ]
    return replace(rig, joints=tuple(own))


def checked(
    arm: ArmHost, body: ServoArm, rig: Rig, limits: Limits, options: ArmOptions, clock: Clock = MACHINE
) -> Check:
    """Switches the servos on, if they are not, reads everything back, and compares it with rig and limits.

    Before and after they are switched on the posture that they claim has to be one in which an arm can stand.
    """
    first = arm.mode is Mode.READING
    if first and (impossible := _posture(arm, body, limits, clock, held=True)):
        return Check(clock.now(), impossible)
    held = arm.engage(START_S)
    if first and (impossible := _posture(arm, body, limits, clock, held=False)):
        return Check(clock.now(), impossible)
    expected = {servo: {**registers, "torque_enable": 1} for servo, registers in required_registers(rig).items()}
    now = clock.now()
    near = room(options, rig, datetime.now(UTC))
    return start_up_check(
        limits, expected, held, servo_limits(rig, held), not options.emulated, options.armed, now, near
    )


def _posture(arm: ArmHost, body: ServoArm, limits: Limits, clock: Clock, *, held: bool) -> tuple[str, ...]:
    """What speaks against where the servos say that the arm stands, once it has stood for a moment; waits for that."""
    strength, stall_currents = body.folder.each[0], body.folder.stall_currents
    now, period = clock.now(), round(1e9 * limits.timing.period_s)
    well, end, found = now, now + round(1e9 * STANDS_WITHIN_S), ("the arm was not read",)
    while now < end and now - well < 1e9 * STOOD_S and not arm.trouble:
        if (newest := arm.newest()) is not None:
            state = newest.state
            given = state.currents / stall_currents * strength
            found = posture_mismatches(
                limits,
                state,
                body.gravity(state.positions),
                strength,
                given,
                body.clearance(state.positions),
                held=held,
            )
        clock.wait_until(now + period)
        now = clock.now()
        well = now if found else well
    return found


def tell_torque(port: str, rig: Rig) -> None:
    """Says in one line that an arm is left with torque on, how to let it go; read from its servos. One that does not
    answer may hold.

    Args:
        port: of the arm; nobody else has it open.
        rig: the arm.
    """
    how = f"to let it go, hold the arm, then: {rig.command('release', port)}"
    try:
        bus = ServoBus(port, rig.baud_rate, rig.models, PATIENCE_MS)
        try:
            on = [servo for servo in rig.servos if bus.read(servo, "torque_enable")]
        finally:
            bus.close()
    except HighFiveError as error:
        say_aside(f"the arm MAY STILL HOLD, with torque on ({error}); {how}")
        return
    if on:
        who = "" if len(on) == len(rig.servos) else f" in servos {', '.join(map(str, on))}"
        say_aside(f"the arm holds where it is, torque is on{who}; {how}")


def servo_limits(rig: Rig, held: Registers) -> list[ServoLimits]:
    """What every servo holds itself to, in SI units, from the registers as read back."""
    found = []
    for servo, joint in rig.servos.items():
        table, own = load_table(joint.model), held[servo]
        speed, current, heat, watchdog = (
            to_si(register, own[register.name])
            for register in (
                table["velocity_limit"],
                table.ampere("current_limit"),
                table["temperature_limit"],
                table["bus_watchdog"],
            )
        )
        torque = bool(own["torque_enable"])
        mode = own["operating_mode"]
        found.append(ServoLimits(joint.name, mode, speed, current, heat, watchdog, torque, table.limits_current))
    return found


def at_their_time(frames: Iterable[MarkerFrame], clock: Clock = MACHINE) -> Iterator[MarkerFrame]:
    """The frames of a recording as they would come from a live system: each at its time, from now on.

    After a pause of the machine the person goes on from where she was: what was missed does not come in a burst.
    """
    start = clock.now()
    for frame in frames:
        clock.wait_until(start + frame.source_time_ns)
        now = clock.now()
        if now - start - frame.source_time_ns > STALLED_NS:
            start = now - frame.source_time_ns
        yield replace(frame, arrival_time_ns=now)

"""What has to hold before a servo arm may move: options, limits, rig, the room, and its servos."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

from highfive.calibration.arm_file import load_arm
from highfive.hil.arm.arm_files import limits_of, rig_of
from highfive.hil.arm.arm_options import EMULATED, VIRTUAL, ArmOptions
from highfive.hil.arm.calibrated import calibration_file, known_limits, known_rig, trusted_calibration
from highfive.hil.arm.emergency_stop import check_pipe
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.loop import first_of
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import mounted
from highfive.hil.drivers.bus.ports import too_slow
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.rig_setup import differences, missing_servos, shadow_gaps
from highfive.hil.drivers.bus.serial_line import MACHINE_WIRING, Wiring
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.bus.servo_port import PATIENCE_MS
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.limits_file import load_safer, lowered, parse_changes
from highfive.hil.safety.startup import Room, room_unknown
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.sources.address import parse_address
from highfive.model.errors import HighFiveError


def check_arm(options: ArmOptions) -> tuple[Limits, Rig]:
    """Looks at what was requested before anything that takes long: limits, rig, pipe, and the servos of a real port.

    Returns:
        the limits that hold, and the rig.

    Raises:
        HighFiveError: as :func:`ready_arm`. Nothing has moved.
    """
    limits, rig = check_options(options)
    if not options.emulated:
        refuse_unless_ready(options.port, rig, limits)
    return limits, rig


def check_person(options: ArmOptions, marker_set: MarkerSet | None) -> None:
    """Refuses a real arm beside a live person whose head no marker shows: the face zone would follow trunk or neck.

    Args:
        options: which arm, and who is beside it.
        marker_set: that the live person wears; None where nobody is tracked.

    Raises:
        HighFiveError: nothing shows the head. Nothing has moved.
    """
    if options.emulated or not options.person:
        return
    if marker_set is None:
        raise HighFiveError(f"no marker set says where the head of the person from {options.person} is; name one")
    if not marker_set.on_head:
        head = marker_set.arm.head
        carriers = ", ".join(dict.fromkeys(marker_set.joints[marker_set.index(name)] for name in head))
        raise HighFiveError(
            f"marker set {marker_set.name} has no marker on the head: {', '.join(head)} stand in for it (carried by "
            f"{carriers}); a real arm near a live person needs one there: use a set with head markers, such as paper"
        )


def check_options(options: ArmOptions) -> tuple[Limits, Rig]:
    """Looks at what can be judged without the port: limits, rig, whether the arm may move, and who is near it.

    Returns:
        the limits that hold, and the rig.

    Raises:
        HighFiveError: as :func:`ready_arm`. The port was not opened.
    """
    if parse_faults(options.faults) and not options.emulated:
        raise HighFiveError(f"--faults go wrong on an emulated arm; {options.port} may be a real one")
    if options.port == VIRTUAL and options.person:
        raise HighFiveError(f"--rig {VIRTUAL} is in virtual time, where no live person is; use --rig {EMULATED}")
    folder = find_arm(options.arm)
    limits = limits_of(folder)
    if options.limits is not None:
        limits = load_safer(options.limits, limits)
    limits = lowered(limits, parse_changes(options.lower))
    if options.slow:
        limits = lowered(limits, {"motion.point_speed": min(limits.motion.point_speed, limits.face.speed)})
    rig = rig_of(folder, options.rig)
    if not options.emulated and not options.armed:
        reach = mounted(folder).reach
        raise HighFiveError(
            f"{options.port} may be a real arm: it moves, up to {reach:.1f} m from its base, only with --arm "
            "and a word about who is near it: --nobody-near, --slow, or for a live person --calibration"
        )
    now = datetime.now(UTC)
    if troubles := room_unknown(not options.emulated, room(options, rig, now)):
        raise HighFiveError(f"{options.port}: {first_of(troubles)}")
    if (found := trusted_calibration(options, rig, now)) is not None:
        rig = known_rig(rig, found)
        limits = known_limits(limits, rig, folder)
    if options.estop is not None:
        check_pipe(options.estop)
    parse_faults(options.faults, rig.servos)
    watchdog = min(rig.settings.watchdog, limits.timing.watchdog_s)
    return limits, replace(rig, settings=replace(rig.settings, watchdog=watchdog))


def room(options: ArmOptions, rig: Rig, now: datetime) -> Room:
    """Who is near the arm, and whether that is known.

    Raises:
        HighFiveError: the calibration cannot be read.
    """
    file = calibration_file(options, rig)
    if file is None or not options.person:
        return Room(options.person, nobody_near=options.nobody_near, slow=options.slow)
    found = load_arm(file).registration
    mismatches = found.mismatches(fingerprint(rig, find_arm(options.arm)), parse_address(options.person).scheme, now)
    return Room(options.person, True, mismatches, options.nobody_near, options.slow)


def refuse_unless_ready(port: str, rig: Rig, limits: Limits, wiring: Wiring = MACHINE_WIRING) -> None:
    """Looks at every servo before anything is switched on.

    Raises:
        HighFiveError: one is missing, set otherwise, or stands apart from its shadow. Nothing has moved.
    """
    bus = ServoBus(port, rig.baud_rate, rig.models, PATIENCE_MS, wiring)
    try:
        if slow := too_slow(port):
            raise HighFiveError(f"{port}: {slow}; nothing moves")
        troubles = missing_servos(bus, rig) or [str(one) for one in differences(bus, rig)]
        troubles = troubles or shadow_gaps(bus, rig, limits.servo.shadow_rest)
    finally:
        bus.close()
    if troubles:
        raise HighFiveError(f"{first_of(troubles)}; nothing moves ({rig.command('check', port)} shows all)")

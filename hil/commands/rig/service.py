"""``highfive rig scan``, ``check``, ``configure`` and ``release``: what is on a servo bus, and how it is set.

None of them drives a joint; ``release`` lets the arm fall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from highfive.calibration.arm_file import ArmCalibration, load_arm
from highfive.hil.arm.arm_files import called, limits_of
from highfive.hil.arm.arm_files import rig_file as own_rig
from highfive.hil.arm.calibrated import calibration_troubles, known_rig
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, ArmFolder, find_arm
from highfive.hil.drivers.bus.control_table import to_si
from highfive.hil.drivers.bus.joint_bus import JointBus
from highfive.hil.drivers.bus.ports import Port, latency_ms, serial_ports, too_slow
from highfive.hil.drivers.bus.rig import LAST_ID, Rig, angle, load_rig
from highfive.hil.drivers.bus.rig_setup import Difference, configure, differences, missing_servos, shadow_gaps
from highfive.hil.drivers.bus.serial_line import MACHINE_WIRING, Wiring
from highfive.hil.drivers.bus.servo_bus import Found, ServoBus
from highfive.hil.drivers.bus.servo_port import PATIENCE_MS, PortError
from highfive.hil.drivers.servo_errors import WATCHDOG_TRIPPED, hardware_errors
from highfive.hil.runtime.console import Bar, counted
from highfive.model.errors import HighFiveError

PROBED_IDS = range(1, 21)
"""IDs that a scan asks for unless it is to ask for all: labs count from 1."""

EVERY_ID = range(LAST_ID + 1)
"""All that a servo can have."""

_ELSEWHERE = (
    "is the adapter plugged in, and the arm powered? The port of an emulated arm is found by its name alone, which rig "
    "emulate says: highfive rig scan PORT"
)


@dataclass(frozen=True)
class ScanOptions:
    """Where to look.

    Attributes:
        ports: paths; none for all that the system knows.
        bauds: rates to try, in this order; the first at which somebody answers is taken.
        ids: requested.
        rig: the arm's file; None for its own.
        arm: whose servos are expected on a port on which somebody answers.
    """

    ports: tuple[str, ...] = ()
    bauds: tuple[int, ...] = (1_000_000, 57_600, 2_000_000, 3_000_000, 4_000_000, 115_200)
    ids: Sequence[int] = PROBED_IDS
    rig: Path | None = None
    arm: str = DEFAULT_ARM


def scan(options: ScanOptions, bar: Bar) -> dict[str, Any]:
    """What answers on each port: servos, double IDs, the rate; or why nothing does.

    Raises:
        HighFiveError: a port that was named cannot be opened, or the arm's file cannot be used.
    """
    rig = named_rig(options.rig, find_arm(options.arm))
    known = serial_ports()
    if options.ports:
        paths = {port.path: port for port in known}
        known = [paths.get(path) or Port(path, "", latency_ms(path)) for path in options.ports]
        for path in options.ports:  # what was requested by name has to be there
            if not Path(path).exists():
                raise HighFiveError(
                    f"{path}: no such port; if rig emulate is to make it, wait until it says that it is there; the "
                    "machine's own are listed by highfive rig scan without a port"
                )
            ServoBus(path, options.bauds[0]).close()
    advance = bar("asking", len(known) * len(options.bauds))
    rows = []
    for number, port in enumerate(known, 1):
        row: dict[str, Any] = {
            "port": port.path, "description": port.description, "latency_ms": port.latency_ms, "advice": port.advice,
            "baud": None, "servos": [], "double_or_damaged": [], "missing": [], "trouble": "",
        }  # fmt: skip
        rows.append(row)
        for baud in options.bauds:
            try:
                found, damaged = _scanned(port.path, baud, options.ids)
            except PortError as error:
                if options.ports:
                    raise
                row["trouble"] = str(error)
                break
            finally:
                advance()
            row |= {"latency_ms": latency_ms(port.path), "advice": too_slow(port.path)}  # opening it may have mended it
            if found or damaged:
                answered = {one.servo for one in found} | set(damaged)
                missing = [{"id": servo, "joint": joint.name} for servo, joint in rig.servos.items()
                           if servo not in answered]  # fmt: skip
                row |= {"baud": baud, "servos": [_described(one) for one in found], "double_or_damaged": damaged}
                row["missing"] = missing
                break
        advance(done=number * len(options.bauds))  # the rates that were not tried
    return {"rig": rig.name, "ports": rows}


def _scanned(path: str, baud: int, ids: Sequence[int]) -> tuple[list[Found], list[int]]:
    bus = ServoBus(path, baud, allowance_ms=PATIENCE_MS)
    try:
        return bus.scan(ids)
    finally:
        bus.close()


def _described(found: Found) -> dict[str, Any]:
    return {"id": found.servo, "model": found.model, "model_number": found.number, "firmware": found.firmware}


@contextmanager
def opened(port: str, rig: Rig, wiring: Wiring = MACHINE_WIRING) -> Iterator[ServoBus]:
    """A rig's bus, closed in the end.

    Raises:
        HighFiveError: the port cannot be opened.
    """
    bus = ServoBus(port, rig.baud_rate, rig.models, PATIENCE_MS, wiring)
    try:
        yield bus
    finally:
        bus.close()


def named_rig(file: Path | None, folder: ArmFolder) -> Rig:
    """The rig of a file, or an arm's own: what is on the bus is looked at, whether or not it is all of the arm.

    Raises:
        HighFiveError: the file cannot be used.
    """
    return called(load_rig(file or own_rig(folder)), folder, file)


def check(
    port: str,
    rig_file: Path | None,
    wiring: Wiring = MACHINE_WIRING,
    arm: str = DEFAULT_ARM,
    calibration: Path | None = None,
) -> dict[str, Any]:
    """Everything that the rig's servos hold, against what it wants; ``ready`` says whether they may be used.

    The rig is the ``arm``'s own unless another file is named, the calibration the rig's.

    Raises:
        HighFiveError: the rig's file, the calibration or the port cannot be used.
    """
    folder = find_arm(arm)
    rig = named_rig(rig_file, folder)
    file, found, told = calibration or rig.calibration, None, []
    if file is not None:
        found = load_arm(file)
        if not (told := calibration_troubles(found, rig, folder, datetime.now(UTC))):
            rig = known_rig(rig, found)
    with opened(port, rig, wiring) as bus:
        slow = too_slow(port)
        troubles = missing_servos(bus, rig)
        wrong: list[Difference] = []
        servos: list[dict[str, Any]] = []
        if not troubles:
            wrong = differences(bus, rig)
            servos = [_health(bus, rig, servo) for servo in rig.servos]
            if not wrong:
                troubles = shadow_gaps(bus, rig, limits_of(folder).servo.shadow_rest)
        troubles += told
        troubles += [
            f"servo {row['id']} ({row['joint']}): {', '.join(row['errors'])}" for row in servos if row["errors"]
        ] + ([slow] if slow else [])
    return {
        "port": port,
        "rig": rig.name,
        "ready": not troubles and not wrong,
        "troubles": troubles,
        "differences": [vars(one) for one in wrong],
        "configure": rig.command("configure", port),
        "servos": servos,
        "calibration": None if found is None else _calibrated(found),
    }


def _calibrated(found: ArmCalibration) -> dict[str, Any]:
    return {
        "file": str(found.registration.path),
        "date": found.registration.date.isoformat(),
        "joints": {
            name: {
                "zero_deg": round(math.degrees(joint.zero), 2),
                "play_deg": round(math.degrees(joint.play), 2),
                "friction_Nm": None if joint.friction is None else round(joint.friction, 3),
            }
            for name, joint in found.joints.items()
        },
    }


def _health(bus: ServoBus, rig: Rig, servo: int) -> dict[str, Any]:
    table, joint = bus.table(servo), rig.servos[servo]
    bits = bus.read(servo, "hardware_error_status")
    return {
        "id": servo,
        "joint": joint.name,
        "model": table.model,
        "firmware": bus.read(servo, "firmware_version"),
        "torque": bool(bus.read(servo, "torque_enable")),
        "angle_deg": round(math.degrees(angle(joint, bus.read(servo, "present_position"))), 1),
        "stopped_by_watchdog": bus.read(servo, "bus_watchdog") == WATCHDOG_TRIPPED,
        "temperature_C": to_si(table["present_temperature"], bus.read(servo, "present_temperature")),
        "voltage_V": round(to_si(table["present_input_voltage"], bus.read(servo, "present_input_voltage")), 2),
        "errors": hardware_errors(bits),
    }


def configure_rig(
    port: str, rig_file: Path | None, agreed: Callable[[list[str]], bool], arm: str = DEFAULT_ARM
) -> dict[str, Any]:
    """Sets the servos as the rig wants them, if ``agreed`` says yes to the differences.

    Raises:
        HighFiveError: a servo is missing, of another model or does not keep what is written; torque is on.
    """
    rig = named_rig(rig_file, find_arm(arm))
    with opened(port, rig) as bus:
        if troubles := missing_servos(bus, rig):
            raise HighFiveError(troubles[0] + (f" ({len(troubles) - 1} more)" if len(troubles) > 1 else ""))
        wrong = differences(bus, rig)
        if wrong and (written := agreed([str(one) for one in wrong])):
            configure(bus, rig, wrong)
        else:
            written = False
    return {"port": port, "rig": rig.name, "differences": [vars(one) for one in wrong], "written": written}


def release(port: str, rig_file: Path | None, arm: str = DEFAULT_ARM) -> dict[str, Any]:
    """Switches torque off: the arm falls. ``failed`` are servos that did not confirm it.

    Raises:
        HighFiveError: the rig's file or the port cannot be used.
    """
    rig = named_rig(rig_file, find_arm(arm))
    with opened(port, rig) as bus:
        return {"port": port, "rig": rig.name, "failed": JointBus(bus, rig).release()}


def print_scan(result: dict[str, Any]) -> None:
    """The ports and servos, for people."""
    if not any(row["servos"] or row["double_or_damaged"] for row in result["ports"]):
        print(f"{'nobody answers' if result['ports'] else 'no serial port'}; {_ELSEWHERE}")
    for row in result["ports"]:
        print(f"{row['port']}  {row['description']}".rstrip())
        if row["trouble"] or row["advice"]:
            print(f"  {row['trouble'] or row['advice']}")
        if row["baud"] is None and not row["trouble"]:
            print("  nobody answers")
        for servo in row["servos"]:
            model = servo["model"] or f"model number {servo['model_number']}"
            print(f"  ID {servo['id']:<4}{model:<12} firmware {servo['firmware']}, {row['baud']:,} baud")
        for identity in row["double_or_damaged"]:
            print(f"  ID {identity:<4}only damaged answers: two servos may share it")
        if row["missing"]:
            names = ", ".join(f"{one['id']} ({one['joint']})" for one in row["missing"])
            print(f"  no answer of servo {names}, which {result['rig']} has; another arm: --arm NAME")


def print_check(result: dict[str, Any]) -> None:
    """What was read back, for people."""
    print(f"{result['rig']} on {result['port']}: {'ready' if result['ready'] else 'NOT ready'}")
    for line in result["troubles"]:
        print(f"  {line}")
    for of in result["differences"]:
        print(f"  {Difference(**of)}")
    if result["differences"]:
        print(f"  {result['configure']} sets them")
    if stopped := [str(row["id"]) for row in result["servos"] if row["stopped_by_watchdog"]]:
        print(
            f"  the watchdog has stopped servos {', '.join(stopped)}: they stay where they are until the next session"
        )
    for row in result["servos"]:
        torque = "on" if row["torque"] else "off"
        print(
            f"  ID {row['id']:<3}{row['joint']:<14}{row['model']}  {row['temperature_C']:.0f} °C  "
            f"{row['voltage_V']:.1f} V  {row['angle_deg']:6.1f}°  torque {torque}"
        )
    if (of := result["calibration"]) is not None:
        zeros = ", ".join(f"{name} {joint['zero_deg']:.2f}°" for name, joint in of["joints"].items())
        print(f"  zeros of {of['file']} ({of['date'][:10]}): {zeros}")


def print_configured(result: dict[str, Any]) -> None:
    """What was set, for people."""
    count = len(result["differences"])
    if not count:
        print(f"{result['rig']} on {result['port']}: everything is as it should be; nothing was written")
    else:
        done = "written and read back" if result["written"] else "left as they were"
        print(f"{result['rig']} on {result['port']}: {counted(count, 'register')} {done}")


def print_released(result: dict[str, Any]) -> None:
    """Who let go, for people."""
    if failed := ", ".join(map(str, result["failed"])):
        print(f"{result['port']}: torque MAY STILL BE ON, servos {failed} did not confirm that it is off")
    else:
        print(f"torque is off on {result['port']}")

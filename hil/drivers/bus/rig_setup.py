"""Whether the servos on a bus are those of a rig, and set as it wants them; and how to set them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from highfive.hil.drivers.bus.control_table import Register, load_table, to_si
from highfive.hil.drivers.bus.rig import COUNTS, REVERSE, SET_AT_START, Rig, required_registers
from highfive.hil.drivers.bus.servo_bus import DamagedAnswer, NoAnswer, ServoBus
from highfive.model.errors import HighFiveError

# The watchdog only counts, and can only be armed, while torque is on; the others are forgotten at every start.
_SET_LATER = ("bus_watchdog", *SET_AT_START)
_BY_WHICH_IT_IS_FOUND = ("id", "baud_rate")
_WORDS = {
    "operating_mode": {
        0: "current", 1: "velocity", 3: "position", 4: "position over turns", 5: "position with a largest current",
        16: "duty",
    },
    "drive_mode": {0: "not reversed", REVERSE: "reversed"},
    "status_return_level": {0: "answers pings alone", 1: "answers reads", 2: "answers everything"},
    "shadow_id": {255: "follows no other servo"},
}  # fmt: skip
"""What the numbers of a register without a unit stand for."""


@dataclass(frozen=True)
class Difference:
    """A register that does not hold what the rig wants.

    Attributes:
        servo: ID.
        joint: name.
        register: name.
        found, required: raw.
        found_means, required_means: the same in units, or in words; '' for plain numbers.
    """

    servo: int
    joint: str
    register: str
    found: int
    required: int
    found_means: str = ""
    required_means: str = ""

    def __str__(self) -> str:
        """As in ``servo 4 (elbow): velocity_limit is 128 (3.07 rad/s), not 131 (3.14 rad/s)``."""
        found, required = (
            f"{raw} ({means})" if means else str(raw)
            for raw, means in ((self.found, self.found_means), (self.required, self.required_means))
        )
        return f"servo {self.servo} ({self.joint}): {self.register} is {found}, not {required}"


def meaning(register: Register, raw: int) -> str:
    """What a raw value stands for, in units or in words; '' where it is a plain number."""
    if register.name in _WORDS:
        return _WORDS[register.name].get(raw, "")
    value = to_si(register, raw)
    match register.si:
        case "":
            return ""
        case "rad":
            return f"{math.degrees(value):.1f}°"
        case "1":
            return f"{100.0 * value:.0f} %"
        case "s":
            return f"{1e3 * value:.3g} ms"
        case unit:
            return f"{value:.3g} {unit}"


def missing_servos(bus: ServoBus, rig: Rig) -> list[str]:
    """What stands in the way of using the servos at all, a line each: silent ones, double IDs, other models; one line
    where nobody answers.

    Raises:
        PortError: the port is gone.
    """
    troubles, silent = [], 0
    for servo, joint in rig.servos.items():
        where = f"servo {servo} ({joint.name})"
        try:
            found = bus.ping(servo)
        except DamagedAnswer:
            troubles.append(f"{where}: only damaged answers; two servos may have this ID, or the cable is bad")
        except NoAnswer:
            silent += 1
            troubles.append(
                f"{where}: no answer; is it plugged in, has it power, and is it set to {rig.baud_rate:,} baud?"
            )
        else:
            if found.model != joint.model:
                other = found.model or f"a model with number {found.number}"
                troubles.append(f"{where}: it is {other}, expected {joint.model}")
            elif found.firmware < (least := load_table(joint.model).firmware):
                troubles.append(
                    f"{where}: firmware {found.firmware} is older than {least}; update it with the maker's tool"
                )
    if silent == len(rig.servos):
        return [f"no servo answers; is it a bus of servos, has it power, and is it set to {rig.baud_rate:,} baud?"]
    return troubles


def read_back(bus: ServoBus, rig: Rig, between: Callable[[], None]) -> dict[int, dict[str, int]]:
    """What the registers that a rig cares for hold, and whether torque is on: by ID, then by name, raw.

    Args:
        bus: with the servos.
        rig: the arm.
        between: called before each register, for this takes longer than the servos' watchdogs wait.

    Raises:
        NoAnswer, ServoError, PortError: a servo does not answer, or refuses.
    """
    held: dict[int, dict[str, int]] = {}
    for servo, required in required_registers(rig).items():
        held[servo] = {}
        for name in (*required, "torque_enable"):
            between()
            held[servo][name] = bus.read(servo, name)
    return held


def shadow_counts(bus: ServoBus, rig: Rig) -> dict[str, int]:
    """By how many counts each joint's second servo says less than its first: by the joint's name, those that have one.

    Raises:
        NoAnswer, ServoError, PortError: a servo does not answer, or refuses.
    """
    found = {}
    for joint in rig.joints:
        if joint.shadow_id is not None:
            before, second, after = (bus.read(servo, "present_position") for servo in (*joint.ids, joint.id))
            found[joint.name] = round((before + after) / 2) - second  # a limp arm may still be falling
    return found


def shadow_gaps(bus: ServoBus, rig: Rig, most: float) -> list[str]:
    """A line for every joint whose two servos stand more than ``most`` rad apart: switched on, they would push against
    each other; or more than that otherwise than when they were calibrated.

    Raises:
        NoAnswer, ServoError, PortError: a servo does not answer, or refuses.
    """
    lines, joints = [], {joint.name: joint for joint in rig.joints}
    for name, gap in shadow_counts(bus, rig).items():
        joint = joints[name]
        if abs(gap) * math.tau / COUNTS > most:
            lines.append(
                f"{name}: servos {joint.id} and {joint.shadow_id} stand {abs(gap)} counts apart "
                f"({360.0 * abs(gap) / COUNTS:.1f}°), at most {int(most * COUNTS / math.tau)}: look at the horns "
                "first: one that slipped is put right, not written down; if both sit as they should, write "
                f"shadow_offset = {joint.shadow_offset + gap} into {rig.path} ([[joints]] of {name}), and "
                f"{rig.command('configure', bus.path)}"
            )
        elif abs(gap * math.tau / COUNTS - joint.gap) > most:
            lines.append(
                f"{name}: servos {joint.id} and {joint.shadow_id} stand {gap} counts apart, "
                f"{round(joint.gap * COUNTS / math.tau)} when they were calibrated: a horn has slipped; put it right, "
                "and highfive calibrate servos"
            )
    return lines


def differences(bus: ServoBus, rig: Rig) -> list[Difference]:
    """The registers of all servos that do not hold what the rig wants; read back one by one.

    Raises:
        NoAnswer, ServoError, PortError: a servo does not answer, or refuses.
    """
    required = required_registers(rig)
    found = []
    for servo, joint in rig.servos.items():
        for name, value in required[servo].items():
            if name not in (*_SET_LATER, *_BY_WHICH_IT_IS_FOUND) and (holds := bus.read(servo, name)) != value:
                register = bus.table(servo)[name]
                words = meaning(register, holds), meaning(register, value)
                found.append(Difference(servo, joint.name, name, holds, value, *words))
    return found


def configure(bus: ServoBus, rig: Rig, required: Sequence[Difference]) -> None:
    """Writes what was found different, and reads everything back.

    Raises:
        HighFiveError: torque is on (the servos then refuse), or a servo does not keep what was written.
        NoAnswer, ServoError, PortError: a servo does not answer, or refuses.
    """
    for servo in rig.servos:
        if bus.read(servo, "torque_enable"):
            raise HighFiveError(
                f"servo {servo}: torque is on, and its settings are locked; hold the arm, and "
                f"{rig.command('release', bus.path)} first"
            )
    for one in sorted(
        required, key=lambda one: one.register != "status_return_level"
    ):  # without it nothing is confirmed
        bus.write(one.servo, one.register, one.required)
    if kept := differences(bus, rig):
        raise HighFiveError(f"{kept[0]}, although that was written")

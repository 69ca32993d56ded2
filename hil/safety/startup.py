"""What has to be true before anything moves: what was read back from the servos, held against what it has to be."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from highfive.hil.safety.limits import Limits

CURRENT_BASED_POSITION = 5
"""The operating mode in which a servo yields (the maker's manual, register Operating Mode)."""

POSITION = 3
"""The same of a servo that cannot limit its current: its goal PWM limits the duty, and so what it gives at rest."""

WATCHDOG_S = (0.06, 0.1)
"""Shortest and longest watchdog, s."""

SPEED_STEP = 0.229 * math.tau / 60.0
"""rad/s, in which servos count their velocity limit."""

CURRENT_STEP = 0.00269
"""A, in which servos count their current limit."""

Registers = Mapping[int, Mapping[str, int]]
"""By ID, then by the register's name: raw values."""


@dataclass(frozen=True)
class Check:
    """What the start-up check found.

    Attributes:
        time_ns: monotonic clock when the servos were read.
        mismatches: what keeps the arm from moving, a line each.
    """

    time_ns: int
    mismatches: tuple[str, ...]


@dataclass(frozen=True)
class ServoLimits:
    """What one servo holds itself to, as read back and brought to SI units.

    Attributes:
        joint: its joint's name.
        operating_mode: as in its register.
        speed: rad/s.
        current: A.
        temperature: °C, at which it switches itself off.
        watchdog_s: s without a command after which it stops; 0 where it never does.
        torque: it holds its joint.
        limits_current: it can hold its current to what it is told; else its duty, in plain position mode.
    """

    joint: str
    operating_mode: int
    speed: float
    current: float
    temperature: float
    watchdog_s: float
    torque: bool
    limits_current: bool = True


def register_mismatches(required: Registers, found: Registers) -> list[str]:
    """A line for every register that was read back and is not what it has to be, or was not read back at all.

    Calibration (homing offset, direction) is among them.
    """
    lines: list[str] = []
    for servo, registers in required.items():
        if servo not in found:
            lines.append(f"servo {servo} did not answer")
            continue
        for name, value in registers.items():
            if name not in found[servo]:
                lines.append(f"servo {servo}: {name} was not read back")
            elif found[servo][name] != value:
                lines.append(f"servo {servo}: {name} is {found[servo][name]}, it has to be {value}")
    return lines


def limit_mismatches(limits: Limits, servos: Iterable[ServoLimits]) -> list[str]:
    """A line for everything in which a servo would not hold itself to the limits, or could not follow them."""
    lines: list[str] = []
    known: set[str] = set()
    for servo in servos:
        if servo.joint not in limits.names:
            lines.append(f"{servo.joint} is no joint of this arm")
            continue
        known.add(servo.joint)
        lines += [f"{servo.joint}: {line}" for line in _mismatches(limits, servo)]
    return lines + [f"{name}: nothing was read back" for name in limits.names if name not in known]


def watchdog_mismatch(limits: Limits, servo: ServoLimits) -> str:
    """What is wrong with a servo's watchdog; nothing if it is armed and short enough."""
    least, most = WATCHDOG_S[0], min(WATCHDOG_S[1], limits.timing.watchdog_s)
    if least - 1e-6 <= servo.watchdog_s <= most + 1e-6:
        return ""
    return f"its watchdog is {1e3 * servo.watchdog_s:g} ms, it has to be {1e3 * least:.0f} to {1e3 * most:.0f} ms"


def not_armed(real_port: bool, armed: bool) -> list[str]:
    """A line where a real port was not armed; the emulated bus needs no arming."""
    return ["the port is a real one: nothing moves it without --arm"] if real_port and not armed else []


@dataclass(frozen=True)
class Room:
    """Who is near a real arm, and how that is known.

    Attributes:
        person: where a live person comes from, such as ``vicon://host``; '' where nobody is tracked: a simulated or a
            recorded person is not in the room.
        registered: the motion capture's room is registered with the arm's base: a file says so.
        mismatches: why that file is not of this arm, or this room, or this month, a line each.
        nobody_near: the operator said that nobody can be reached by the arm, and answers for it.
        slow: every known point of the arm is as slow as near a face.
    """

    person: str = ""
    registered: bool = False
    mismatches: tuple[str, ...] = ()
    nobody_near: bool = False
    slow: bool = False


def room_unknown(real_port: bool, room: Room) -> list[str]:
    """Lines where a real arm would move and nobody knows where people are beside it; an emulated one reaches nobody."""
    if not real_port:
        return []
    if not room.person:
        if room.nobody_near or room.slow:
            return []
        return [
            "the port is a real one and nobody is tracked beside the arm: nothing moves it without --nobody-near "
            "(nobody can be reached by it; you answer for that) or --slow (every point as slow as near a face)"
        ]
    if room.nobody_near:
        return [f"--nobody-near contradicts the live person from {room.person}; leave it out"]
    if not room.registered:
        return [
            f"the port is a real one, and nothing says where the arm's base stands in the room of {room.person}: "
            "nothing moves it without --calibration FILE.toml (docs/calibration.md)"
        ]
    return list(room.mismatches)


def start_up_check(
    limits: Limits,
    required: Registers,
    found: Registers,
    servos: Iterable[ServoLimits],
    real_port: bool,
    armed: bool,
    time_ns: int,
    room: Room,
) -> Check:
    """Everything that keeps the arm from moving; nothing moves until there is nothing.

    Args:
        limits: all of them.
        required: what the registers have to hold.
        found: what they hold.
        servos: the same of what they hold, in SI units, a servo each.
        real_port: the port is not the emulated bus.
        armed: a person gave ``--arm``.
        time_ns: when the servos were read.
        room: who is near the arm.
    """
    lines = [
        *not_armed(real_port, armed),
        *room_unknown(real_port, room),
        *register_mismatches(required, found),
        *limit_mismatches(limits, servos),
    ]
    return Check(time_ns, tuple(lines))


def _mismatches(limits: Limits, servo: ServoLimits) -> list[str]:
    own = limits.joints[limits.names.index(servo.joint)]
    lines = [watchdog_mismatch(limits, servo)]
    mode = CURRENT_BASED_POSITION if servo.limits_current else POSITION
    if servo.operating_mode != mode:
        lines.append(f"its operating mode is {servo.operating_mode}, it has to be {mode}")
    if not servo.torque:
        lines.append("its torque is off")
    if servo.speed > math.pi + SPEED_STEP:
        lines.append(f"its velocity limit is {servo.speed:.2f} rad/s, at most {math.pi:.2f}")
    if servo.current < own.current - CURRENT_STEP:
        lines.append(f"its current limit is {servo.current:.2f} A, less than the {own.current:.2f} it may be sent")
    if servo.temperature <= limits.servo.temperature:
        lines.append(
            f"it switches itself off at {servo.temperature:.0f} °C, "
            f"before the arm stops by itself at {limits.servo.temperature:.0f}"
        )
    return [line for line in lines if line]

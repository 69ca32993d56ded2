"""What one arm is made of: its joints in order, the servos that drive them, and what those are set to. Pure.

The arm that comes with the project is ``rig.toml``; a lab's own file works the same way.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.drivers.bus.control_table import baud_index, load_table, models, packing, to_raw
from highfive.hil.drivers.values import Array
from highfive.model.errors import HighFiveError
from highfive.model.toml_file import check_keys, number, read_toml, typed

DEFAULT_RIG = Path(__file__).parent / "rig.toml"

COUNTS = 4096
"""Of one turn."""

_REPLY_HEAD, _REPLY_PART = 8, 4
"""Bytes of the one answer to a fast sync read: header to instruction; error, ID and CRC of each servo."""

LAST_ID = 252
"""Largest ID that a servo can have."""

POSITION, CURRENT_POSITION = 3, 5
"""Operating modes: to a goal with a largest duty, and with a largest current."""

REVERSE = 1
"""Bit of the drive mode: the servo counts the other way."""

PROFILE = ("profile_acceleration", "profile_velocity")
"""Registers of the servo's own profile, which the driver goes without: goals come 120 times a second."""

SET_AT_START = ("position_p_gain", *PROFILE)
"""Registers that a servo forgets when it starts again, and its watchdog's trip in part: each session sets them."""


@dataclass(frozen=True)
class RigJoint:
    """One joint and what drives it.

    Attributes:
        name: of the joint.
        model: of its servos, such as ``"XM540-W270"``.
        id: of its servo.
        shadow_id: of a second servo that follows the first one's commands, its mirror image; None where there is none.
        shadow_offset: counts, homing offset of that second servo beside the first's: what it takes that both say the
            same.
        reversed: the servo turns the other way than the joint. Its drive mode turns that round inside the servo (the
            shadow's is the opposite), so a count always grows with the angle: see :func:`angle` and :func:`count`.
        zero: count at angle 0.
        lower, upper: rad, how far the joint may go.
        current_limit: A, of each of its servos.
        position_p_gain: raw; the stiffer, the less the joint lags and sags.
        astray: rad, by which the joint is further than its servo's count says: its calibrated zero. The servos know
            nothing of it, so it is no part of what tells one arm from another (``repr``).
        gap: rad, by which its shadow says less than its servo where nothing moved since it was calibrated; neither is
            this.
    """

    name: str
    model: str
    id: int
    shadow_id: int | None
    shadow_offset: int
    reversed: bool
    zero: int
    lower: float
    upper: float
    current_limit: float
    position_p_gain: int
    astray: float = field(default=0.0, repr=False)
    gap: float = field(default=0.0, repr=False)

    @property
    def ids(self) -> tuple[int, ...]:
        """Its servos, the commanded one first."""
        return (self.id,) if self.shadow_id is None else (self.id, self.shadow_id)


@dataclass(frozen=True)
class RigSettings:
    """What every servo is set to.

    Attributes:
        return_delay: s, that a servo waits before it replies.
        operating_mode: as in the register of that name.
        velocity_limit: raw, 0.229 rev/min.
        watchdog: s without an instruction after which a servo stops by itself; 0 for never.
        status_return_level: 2: it replies to everything.
        homing_offset: raw, counts.
        temperature_limit: °C.
    """

    return_delay: float
    operating_mode: int
    velocity_limit: int
    watchdog: float
    status_return_level: int
    homing_offset: int
    temperature_limit: float


@dataclass(frozen=True)
class Rig:
    """One arm on one bus.

    Attributes:
        name: for people.
        baud_rate: of its line.
        settings: of every servo.
        joints: from the base on.
        calibration: file that says by what it differs from its drawing, and where it stands; None for none.
        file: that it was read from; None for the arm's own.
        arm: its name on a command line, or its folder; '' for the one that comes along.
        path: of the file that it was read from.
    """

    name: str
    baud_rate: int
    settings: RigSettings
    joints: tuple[RigJoint, ...]
    calibration: Path | None = None
    file: Path | None = None
    arm: str = ""
    path: Path = DEFAULT_RIG

    @property
    def reply_s(self) -> float:
        """s, that all servos' one answer takes on the line. They measure when they are asked, as it begins."""
        sizes = [packing(load_table(model).answers).size for model in self.models.values()]
        return 10.0 * (_REPLY_HEAD + sum(_REPLY_PART + size for size in sizes)) / self.baud_rate

    def command(self, verb: str, port: str) -> str:
        """What to type for a command of ``highfive rig`` about this arm, such as ``release``."""
        return shlex.join(["highfive", "rig", verb, port, *self._told("--rig")])

    def calibrate(self, verb: str, port: str, *more: str) -> str:
        """What to type for a command of ``highfive calibrate`` that moves this arm, with more words."""
        return shlex.join(["highfive", "calibrate", verb, port, "--arm", *self._told("--rig-file"), *more])

    def _told(self, file: str) -> list[str]:
        own = [] if self.file is None else [file, str(self.file)]
        return [*own, "--arm", self.arm] if self.arm else own

    @property
    def servos(self) -> dict[int, RigJoint]:
        """Every servo's joint, by ID, in the order of the joints."""
        return {servo: joint for joint in self.joints for servo in joint.ids}

    @property
    def models(self) -> dict[int, str]:
        """Every servo's model, by ID, in the order of the joints."""
        return {servo: joint.model for servo, joint in self.servos.items()}

    @property
    def current_limits(self) -> Array:
        """(J,) A, of each servo of a joint."""
        return np.array([joint.current_limit for joint in self.joints])


def angle(joint: RigJoint, count: float) -> float:
    """Joint angle, rad, at a servo's (or its shadow's) position count."""
    return (count - joint.zero) * math.tau / COUNTS + joint.astray


def count(joint: RigJoint, angle: float) -> int:
    """Position count that is nearest to a joint angle, rad. It is not held against the joint's limits."""
    return joint.zero + round((angle - joint.astray) * COUNTS / math.tau)


def required_registers(rig: Rig) -> dict[int, dict[str, int]]:
    """What the registers of every servo shall hold: by ID, then by the register's name, raw.

    Those above 64 (status return level, gain, profile, bus watchdog) a servo forgets when it starts again. The watchdog
    counts only while torque is on.
    """
    return {servo: _required(rig, joint, servo) for servo, joint in rig.servos.items()}


def load_rig(path: str | Path | None = None, *, simulated: bool = False) -> Rig:
    """Reads and checks a rig's description; without a path, that of the default arm.

    Args:
        path: of the file.
        simulated: no bus is to be driven: servos that cannot be driven together are taken, too.

    Raises:
        HighFiveError: there is no such file, it is no TOML, or it makes no sense; one line says what.
    """
    path = Path(path or DEFAULT_RIG)
    document = read_toml(path, "the rig file")
    try:
        rig = _rig(document, simulated, path.parent)
        if not simulated:
            required_registers(rig)
    except HighFiveError as error:
        raise HighFiveError(f"{path}: {error}") from None
    return replace(rig, path=path)


def _required(rig: Rig, joint: RigJoint, servo: int) -> dict[str, int]:
    joint = replace(joint, astray=0.0)  # what the servos are set to goes by their own counts
    table, settings = load_table(joint.model), rig.settings
    shadow, limit = servo == joint.shadow_id, table.ampere("current_limit")
    return {
        "id": servo,
        "baud_rate": baud_index(rig.baud_rate),
        "return_delay_time": to_raw(table["return_delay_time"], settings.return_delay),
        "drive_mode": REVERSE if joint.reversed != shadow else 0,
        "operating_mode": settings.operating_mode if table.limits_current else POSITION,
        "shadow_id": joint.id if shadow else 255,
        "homing_offset": settings.homing_offset + (joint.shadow_offset if shadow else 0),
        "temperature_limit": to_raw(table["temperature_limit"], settings.temperature_limit),
        limit.name: to_raw(limit, joint.current_limit),
        "velocity_limit": settings.velocity_limit,
        "max_position_limit": min(count(joint, joint.upper), COUNTS - 1),
        "min_position_limit": count(joint, joint.lower),
        "position_p_gain": joint.position_p_gain,
        **dict.fromkeys(PROFILE, 0),
        "status_return_level": settings.status_return_level,
        "bus_watchdog": to_raw(table["bus_watchdog"], settings.watchdog),
    }


def _rig(document: Mapping[str, Any], simulated: bool, folder: Path) -> Rig:
    check_keys(document, "the file", {"name", "baud_rate", "settings", "joints"}, optional={"calibration"})
    entries = document["joints"]
    if not isinstance(entries, list) or not entries:
        raise HighFiveError("joints: expected one table [[joints]] a joint")
    joints = tuple(_joint(entry, n) for n, entry in enumerate(entries, 1))
    _once("joint", [joint.name for joint in joints])
    _once("ID", [str(servo) for joint in joints for servo in joint.ids])
    rig = Rig(
        typed(document, "", "name", str),
        typed(document, "", "baud_rate", int),
        _settings(document["settings"]),
        joints,
        folder / typed(document, "", "calibration", str) if "calibration" in document else None,
    )
    if not simulated:
        _check_servos(rig)
    return rig


def _check_servos(rig: Rig) -> None:
    """Refuses servos that cannot be driven together."""
    if rig.settings.operating_mode != CURRENT_POSITION:
        raise HighFiveError(
            f"settings: operating mode {rig.settings.operating_mode}; expected {CURRENT_POSITION}, in which servos "
            "limit their current"
        )
    for joint in rig.joints:
        table = load_table(joint.model)
        # A servo that cannot limit its current goes in position mode, with a largest duty.
        if table.limits_current and CURRENT_POSITION not in table.operating_modes:
            raise HighFiveError(f"settings: a {joint.model} has no operating mode {CURRENT_POSITION}")
        table.places  # noqa: B018 (refuses a servo that cannot show what it is asked)


def _once(what: str, values: list[str]) -> None:
    if twice := next((value for value in values if values.count(value) > 1), None):
        raise HighFiveError(f"{what} {twice} is there twice; each may be there once")


def _settings(entry: Mapping[str, Any]) -> RigSettings:
    names = {
        "return_delay_s": (float, 0.0, 508e-6),
        "operating_mode": (int, 0, 16),
        "velocity_limit": (int, 1, 1023),
        "watchdog_s": (float, 0.0, 2.54),
        "status_return_level": (int, 0, 2),
        "homing_offset": (int, -1_044_479, 1_044_479),
        "temperature_limit_C": (float, 1.0, 100.0),
    }
    check_keys(entry, "settings", set(names))
    values = [number(entry, "settings: ", name, *rule) for name, rule in names.items()]
    return RigSettings(*values)


def _joint(entry: Mapping[str, Any], n: int) -> RigJoint:
    where = f"joint {n}"
    check_keys(
        entry,
        where,
        {"name", "model", "id", "reversed", "zero", "limits_deg", "current_limit_A", "position_p_gain"},
        optional={"shadow_id", "shadow_offset"},
    )
    name = typed(entry, f"{where}: ", "name", str)
    where = f"joint {name!r}"
    model = typed(entry, f"{where}: ", "model", str)
    if model not in models():
        raise HighFiveError(f"{where}: no control table for {model!r}; there are {', '.join(models())}")
    zero = number(entry, f"{where}: ", "zero", int, 0, COUNTS - 1)
    lower, upper = _limits(entry, where, zero)
    table = load_table(model)
    highest = table.motor.stall_current
    return RigJoint(
        name=name,
        model=model,
        id=number(entry, f"{where}: ", "id", int, 0, LAST_ID),
        shadow_id=number(entry, f"{where}: ", "shadow_id", int, 0, LAST_ID) if "shadow_id" in entry else None,
        shadow_offset=number({"shadow_offset": 0, **entry}, f"{where}: ", "shadow_offset", int, -COUNTS, COUNTS),
        reversed=typed(entry, f"{where}: ", "reversed", bool),
        zero=zero,
        lower=lower,
        upper=upper,
        current_limit=number(entry, f"{where}: ", "current_limit_A", float, 0.0, highest),
        position_p_gain=number(entry, f"{where}: ", "position_p_gain", int, 1, 16_383),
    )


def _limits(entry: Mapping[str, Any], where: str, zero: int) -> tuple[float, float]:
    limits = entry["limits_deg"]
    if not isinstance(limits, list) or len(limits) != 2:
        raise HighFiveError(f"{where}: limits_deg is {limits!r}; expected two numbers, such as [-90.0, 90.0]")
    pair = {"lower": limits[0], "upper": limits[1]}
    low, high = -zero * 360.0 / COUNTS, (COUNTS - zero) * 360.0 / COUNTS  # the servo's one turn
    lower = number(pair, f"{where}, limits_deg: ", "lower", float, low, high)
    return math.radians(lower), math.radians(number(pair, f"{where}, limits_deg: ", "upper", float, lower, high))

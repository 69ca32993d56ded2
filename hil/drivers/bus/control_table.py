"""The registers of a servo as data with units, and their values in SI: pure.

The data is ``control_tables.toml``. A raw value is what the register means (−3 where it holds 0xFFFFFFFD); bytes are
little-endian, as on the bus.
"""

from __future__ import annotations

import math
import struct
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Any

from highfive.model.errors import HighFiveError

RAM_START = 64
"""First address that keeps its value only while there is power; all below is EEPROM."""

BAUD_RATES = (9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""Baud, by the value of the register ``baud_rate``."""

_CODES = {(1, False): "B", (1, True): "b", (2, False): "H", (2, True): "h", (4, False): "I", (4, True): "i"}


@dataclass(frozen=True)
class Register:
    """One item of a control table.

    Attributes:
        name: as in the manual, in lower case with underscores.
        address: of its first byte.
        size: bytes: 1, 2 or 4.
        writable: False where it can only be read.
        signed: it holds two's complement.
        initial: raw, from the factory; None where the servo sets it when it starts.
        minimum: smallest raw value that it takes; None where the manual gives none.
        maximum: largest.
        limited_by: name of the register whose value bounds the size of this one's; None for none.
        si: unit that :func:`to_si` gives ("rad", "A", …); "" for a plain number.
        scale: SI units a count.
    """

    name: str
    address: int
    size: int
    writable: bool
    signed: bool = False
    initial: int | None = None
    minimum: int | None = None
    maximum: int | None = None
    limited_by: str | None = None
    si: str = ""
    scale: float = 1.0

    @property
    def end(self) -> int:
        """The address after its last byte."""
        return self.address + self.size

    @property
    def eeprom(self) -> bool:
        """It keeps its value without power, and refuses writes while torque is on."""
        return self.address < RAM_START


GOALS = ("goal_current", "goal_position")
"""What is written in every cycle; :meth:`Table.ampere` says where."""

ANSWERS = (
    "present_current",
    "present_velocity",
    "present_position",
    "hardware_error_status",
    "present_temperature",
    "present_input_voltage",
    "bus_watchdog",
    "realtime_tick",
)
"""What is read in every cycle."""

_BY_DUTY = {"goal_current": "goal_pwm", "current_limit": "pwm_limit", "present_current": "present_load"}
"""What stands for a register of the current in a servo that has none."""


@dataclass(frozen=True)
class Motor:
    """A servo's motor behind its gears, at ``voltage`` V: N·m and A when it stands, rad/s when it runs free."""

    voltage: float
    stall_torque: float
    stall_current: float
    no_load_speed: float


@dataclass(frozen=True)
class IndirectBlock:
    """``count`` indirect addresses of 2 bytes from ``address``; what they point at shows from ``data``, a byte each."""

    address: int
    data: int
    count: int


@dataclass(frozen=True)
class Places:
    """Where a servo takes its goals and shows its answers in every cycle.

    Attributes:
        goals, answers: addresses of the first byte of each.
        between: bytes of 0 between the goals of current and position: none through indirect data; where that is too
            short for both, what lies between them (goal velocity and profile, which are 0 in a session).
        shown: registers, in order, that the indirect data shows.
    """

    goals: int
    answers: int
    between: int
    shown: tuple[Register, ...]


@dataclass(frozen=True)
class Table:
    """One model of servo: its number, firmware, modes, motor and registers by name."""

    model: str
    number: int
    firmware: int
    operating_modes: tuple[int, ...]
    motor: Motor
    indirect: tuple[IndirectBlock, ...]
    registers: Mapping[str, Register]

    def __getitem__(self, name: str) -> Register:
        """The register of a name.

        Raises:
            HighFiveError: this model has none of that name.
        """
        try:
            return self.registers[name]
        except KeyError:
            raise HighFiveError(
                f"{self.model} has no register {name!r}; it has {', '.join(sorted(self.registers))}"
            ) from None

    def ampere(self, name: str) -> Register:
        """``goal_current``, ``current_limit`` or ``present_current``, in A.

        A servo that has none of them limits its duty instead: a share of it draws that share of the stall current where
        the motor stands, and less where it turns as it pushes; pushed back it draws more (docs/safety.md).
        """
        if name in self:
            return self[name]
        register = self[_BY_DUTY[name]]
        return replace(register, si="A", scale=register.scale * self.motor.stall_current)

    @property
    def limits_current(self) -> bool:
        """It holds its current to what it is told, and not its duty."""
        return "goal_current" in self

    def __contains__(self, name: str) -> bool:
        """Whether this model has it."""
        return name in self.registers

    def __iter__(self) -> Iterator[Register]:
        """The registers by address."""
        return iter(self.registers.values())

    @property
    def goals(self) -> tuple[Register, ...]:
        """What is written in every cycle."""
        return tuple(self.ampere(name) if "current" in name else self[name] for name in GOALS)

    @property
    def answers(self) -> tuple[Register, ...]:
        """What is read in every cycle, in the order of :data:`ANSWERS`."""
        return tuple(self.ampere(name) if "current" in name else self[name] for name in ANSWERS)

    @property
    def places(self) -> Places:
        """Of goals and answers.

        Raises:
            HighFiveError: not even the answers fit into its first block of indirect data.
        """
        block, (current, position) = self.indirect[0], self.goals
        size, room = sum(register.size for register in self.answers), block.count
        goals = current.size + position.size
        if goals + size <= room:
            return Places(block.data, block.data + goals, 0, (*self.goals, *self.answers))
        if size > room:
            raise HighFiveError(f"a {self.model} shows {room} bytes in one block, {size} are needed")
        return Places(current.address, block.data, position.address - current.end, self.answers)

    @property
    def end(self) -> int:
        """The address after the last register's."""
        return max(register.end for register in self)


def to_si(register: Register, raw: int) -> float:
    """A raw value in SI units. A register that stands for a plain number gives that number."""
    return raw * register.scale


def to_raw(register: Register, value: float) -> int:
    """The raw value that is nearest to ``value`` in SI units.

    Raises:
        HighFiveError: it is no finite number, or outside what the register takes or its bytes hold.
    """
    if not math.isfinite(value):
        raise HighFiveError(f"{register.name}: {value} is no number that a servo could be given")
    raw = round(value / register.scale)
    low, high = bounds(register)
    if not low <= raw <= high:
        unit = f" {register.si}" if register.si else ""
        raise HighFiveError(
            f"{register.name}: {value:g}{unit} is outside {low * register.scale:g} to {high * register.scale:g}{unit}"
        )
    return raw


def bounds(register: Register) -> tuple[int, int]:
    """Smallest and largest raw value: the manual's, or where it gives none, what the bytes hold."""
    bits = 8 * register.size
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if register.signed else (0, (1 << bits) - 1)
    return (
        low if register.minimum is None else register.minimum,
        high if register.maximum is None else register.maximum,
    )


def decode(register: Register, data: bytes) -> int:
    """The raw value in a register's bytes.

    Raises:
        HighFiveError: they are not as many as the register has.
    """
    if len(data) != register.size:
        raise HighFiveError(f"{register.name}: got {len(data)} bytes, it has {register.size}")
    return int.from_bytes(data, "little", signed=register.signed)


def encode(register: Register, raw: int) -> bytes:
    """A raw value as the register's bytes.

    Raises:
        HighFiveError: they cannot hold it.
    """
    try:
        return raw.to_bytes(register.size, "little", signed=register.signed)
    except OverflowError:
        raise HighFiveError(f"{register.name}: {raw} does not fit in {register.size} bytes") from None


def packing(registers: Iterable[Register]) -> struct.Struct:
    """Registers that lie one after another in bytes."""
    return struct.Struct("<" + "".join(_CODES[register.size, register.signed] for register in registers))


def baud_index(baud: int) -> int:
    """Value of the register ``baud_rate`` for a baud rate.

    Raises:
        HighFiveError: no servo speaks at it.
    """
    if baud not in BAUD_RATES:
        raise HighFiveError(f"no servo speaks at {baud} baud; there are {', '.join(map(str, BAUD_RATES))}")
    return BAUD_RATES.index(baud)


def models() -> tuple[str, ...]:
    """Names of the models that there are tables for."""
    return tuple(_document()["models"])


def model_of(number: int) -> str | None:
    """Name of the model with that number (what a servo says when it is pinged); None where there is no table for it."""
    return next((name for name, entry in _document()["models"].items() if entry["number"] == number), None)


@cache
def load_table(model: str) -> Table:
    """The control table of a model, such as ``"XM540-W270"``.

    Raises:
        HighFiveError: there is none of that name.
    """
    document = _document()
    if model not in document["models"]:
        raise HighFiveError(f"no control table for {model!r}; there are {', '.join(models())}")
    entry, units = document["models"][model], document["units"]
    rows = {row["name"]: row for row in (*document["common"]["registers"], *entry["registers"])}
    for name in entry["without"]:
        del rows[name]
    own = {"model_number": entry["number"], "firmware_version": entry["firmware"]}
    blocks = tuple(IndirectBlock(**block) for block in entry["indirect"])
    found = [_register(row, units, own.get(name)) for name, row in rows.items()] + _indirect(blocks)
    ordered = sorted(found, key=lambda register: register.address)
    motor = entry["motor"]
    return Table(
        model=model,
        number=entry["number"],
        firmware=entry["firmware"],
        operating_modes=tuple(entry["operating_modes"]),
        motor=Motor(
            voltage=motor["voltage_V"],
            stall_torque=motor["stall_torque_Nm"],
            stall_current=motor["stall_current_A"],
            no_load_speed=motor["no_load_speed_rpm"] * math.tau / 60.0,
        ),
        indirect=blocks,
        registers=MappingProxyType({register.name: register for register in ordered}),
    )


@cache
def _document() -> dict[str, Any]:
    return tomllib.loads(
        resources.files("highfive.hil.drivers.bus").joinpath("control_tables.toml").read_text(encoding="utf-8")
    )


def _register(row: Mapping[str, Any], units: Mapping[str, Any], own: int | None) -> Register:
    unit = units[row["unit"]] if "unit" in row else {"si": "", "scale": 1.0}
    return Register(
        name=row["name"],
        address=row["address"],
        size=row["size"],
        writable=row["access"] == "RW",
        signed=row.get("signed", False),
        initial=row.get("initial", own),
        minimum=row.get("minimum"),
        maximum=row.get("maximum"),
        limited_by=row.get("limited_by"),
        si=unit["si"],
        scale=unit["scale"],
    )


def _indirect(blocks: tuple[IndirectBlock, ...]) -> list[Register]:
    """The registers of the blocks, numbered from 1 through all of them; each points at its own data at first."""
    last = max(block.data + block.count for block in blocks) - 1
    registers, number = [], 0
    for block in blocks:
        for n in range(block.count):
            number += 1
            pointer, data = block.address + 2 * n, block.data + n
            registers += [
                Register(f"indirect_address_{number}", pointer, 2, True, False, data, RAM_START, last),
                Register(f"indirect_data_{number}", data, 1, True, False, 0, 0, 255),
            ]
    return registers

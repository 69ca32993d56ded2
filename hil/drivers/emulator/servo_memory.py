"""The control table of one emulated servo in bytes: what lies where, and what an indirect address points at."""

from __future__ import annotations

from highfive.hil.drivers.bus.control_table import Register, Table, decode, encode, packing
from highfive.hil.drivers.servo_errors import Error

MEASURED = (
    "realtime_tick", "moving", "moving_status", "present_pwm", "present_current", "present_load", "present_velocity",
    "present_position", "velocity_trajectory", "position_trajectory", "present_input_voltage", "present_temperature",
)  # fmt: skip
"""Registers that the servo sets itself, which lie in a row."""

_MOST_KEPT = 100  # ways of reading, and of writing, that are remembered


class ServoMemory:
    """Registers by name and by address. It knows no rule of who may write what.

    Attributes:
        values: what every register holds, by name, raw, but for :data:`MEASURED`.
    """

    def __init__(self, table: Table) -> None:
        """Every register holds the factory's value, but none is in the bytes before it is :meth:`put` there."""
        self._table = table
        self.values: dict[str, int] = {r.name: r.initial or 0 for r in table}
        self._bytes = bytearray(table.end)
        self._at = {r.address: r for r in table}
        self._defined = bytearray(table.end)
        for register in table:
            self._defined[register.address : register.end] = b"\1" * register.size
        measured = [table[name] for name in MEASURED if name in table]
        self._measured_from = measured[0].address
        self._packing = packing(measured)
        self._seen: dict[tuple[int, int], tuple[int, ...] | None] = {}
        self._written: dict[tuple[int, int], tuple[tuple[Register, tuple[int, ...]], ...] | Error] = {}

    def put(self, name: str, raw: int) -> None:
        """Sets a register."""
        register = self._table.registers[name]
        self.values[name] = raw
        self._bytes[register.address : register.end] = encode(register, raw)

    def put_measured(self, *raw: int) -> None:
        """Sets the bytes of :data:`MEASURED`: one number for each that the table has, in their order."""
        self._packing.pack_into(self._bytes, self._measured_from, *raw)

    def places(self, address: int, length: int) -> tuple[int, ...] | None:
        """Where the bytes from ``address`` on really lie: what an indirect address points at. None for nowhere."""
        key = (address, length)
        if key not in self._seen:
            self._seen = self._seen if len(self._seen) < _MOST_KEPT else {}
            self._seen[key] = self._find_places(address, length)
        return self._seen[key]

    def bytes_at(self, places: tuple[int, ...]) -> bytes:
        """What lies there."""
        return bytes([self._bytes[place] for place in places])

    def decoded(self, address: int, data: bytes) -> list[tuple[Register, int]] | Error:
        """The registers that ``data`` from ``address`` on would set, each with its raw value; or why it sets none."""
        key = (address, len(data))
        if key not in self._written:
            self._written = self._written if len(self._written) < _MOST_KEPT else {}
            self._written[key] = self._plan(*key)
        plan = self._written[key]
        if isinstance(plan, Error):
            return plan
        return [(register, decode(register, bytes([data[n] for n in places]))) for register, places in plan]

    def forget_places(self) -> None:
        """The indirect addresses have changed."""
        self._seen.clear()
        self._written.clear()

    def _find_places(self, address: int, length: int) -> tuple[int, ...] | None:
        if length < 1 or 0 in self._defined[address : address + length] or address + length > len(self._defined):
            return None
        return tuple(self._place(one) for one in range(address, address + length))

    def _place(self, address: int) -> int:
        for block in self._table.indirect:
            if block.data <= address < block.data + block.count:
                pointer = block.address + 2 * (address - block.data)
                place = int.from_bytes(self._bytes[pointer : pointer + 2], "little")
                return place if self._defined[place] else address
        return address

    def _plan(self, address: int, length: int) -> tuple[tuple[Register, tuple[int, ...]], ...] | Error:
        """Which registers a write would set, each with which of its bytes; or why it may not."""
        places = self._find_places(address, length)
        if places is None:
            return Error.ACCESS
        left = {place: n for n, place in enumerate(places)}
        plan = []
        for place in places:
            if place not in left:
                continue
            register = self._at.get(place)
            if register is None or any(one not in left for one in range(register.address, register.end)):
                return Error.DATA_LENGTH
            plan.append((register, tuple(left.pop(one) for one in range(register.address, register.end))))
        return tuple(plan)

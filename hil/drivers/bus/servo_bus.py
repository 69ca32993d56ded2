"""One bus of Dynamixel servos through the maker's SDK, by names of registers, with what goes wrong told apart.

The SDK is synchronous and belongs to one thread: whoever opens a bus uses it alone. Raw values are those of
:mod:`highfive.hil.drivers.bus.control_table`, signs right.

An answer does not say what it answers, only who speaks and how long it is. So an answer of another length than the
question's is passed over, and a servo that left a question open is asked for a length that nobody asks for otherwise,
each time another, before it is asked anything else: a servo answers in turn, so what comes before that answer is old.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TypeVar

from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler
from dynamixel_sdk.robotis_def import BROADCAST_ID, INST_PING, INST_READ, INST_REBOOT, INST_WRITE

from highfive.hil.drivers.bus.control_table import Table, decode, encode, load_table, model_of
from highfive.hil.drivers.bus.packet import crc16
from highfive.hil.drivers.bus.rig import LAST_ID
from highfive.hil.drivers.bus.serial_line import MACHINE_WIRING, Wiring
from highfive.hil.drivers.bus.servo_port import ALLOWANCE_MS, PortError, ServoPort
from highfive.hil.drivers.servo_errors import ALERT, error_text
from highfive.hil.runtime.clock import Clock
from highfive.model.errors import HighFiveError

_TRIES = 3  # of what is not done in a cycle: now and then an answer is late, or the line noisy

_PATIENCE_MS = 150.0
"""What comes later than that is not waited for, not even by those who have time."""

_PING_SIZE = 3  # bytes of data in the answer to a ping: the model's number and the firmware
_MARKS = range(5, 15)  # bytes from the first on, of whatever model, read only to see that a servo has come so far
_BARE = 11  # bytes of an answer without data
_DATA = 9  # where they begin
_ROWS = 8  # where the rows of an answer of several servos begin

Result = TypeVar("Result")


class ServoError(HighFiveError):
    """A servo refused an instruction.

    Attributes:
        code: 1 to 7, of the status packet.
    """

    def __init__(self, message: str, code: int):
        """Args: the line that is shown, and the code."""
        super().__init__(message)
        self.code = code


class NoAnswer(HighFiveError):
    """A servo did not answer as it should."""


class DamagedAnswer(NoAnswer):
    """Something came, but nothing whole."""


@dataclass(frozen=True)
class Found:
    """A servo that answered a ping: its ID, its model (None if unknown), the model's number and its firmware."""

    servo: int
    model: str | None
    number: int
    firmware: int


class _Sdk(Protocol2PacketHandler):
    """The maker's, but for how the CRC is worked out: byte by byte it is half of what the SDK takes in a cycle."""

    def updateCRC(self, crc_accum: int, data_blk_ptr: Sequence[int], data_blk_size: int) -> int:
        """The CRC of the first bytes, going on from another."""
        return crc16(bytes(data_blk_ptr[:data_blk_size]), crc_accum)


class ServoBus:
    """An open bus."""

    def __init__(
        self,
        path: str,
        baud: int,
        models: Mapping[int, str] | None = None,
        allowance_ms: float = ALLOWANCE_MS,
        wiring: Wiring = MACHINE_WIRING,
    ):
        """Opens the port.

        Args:
            path: the serial port.
            baud: bits a second.
            models: model of each servo by ID, where it is known.
            allowance_ms: how long an answer may be late.
            wiring: clock and lines.

        Raises:
            PortError: the port cannot be opened.
        """
        self._port = ServoPort(path, baud, allowance_ms, wiring)
        self._sdk = _Sdk()
        self._tables = {servo: load_table(model) for servo, model in (models or {}).items()}
        self._open: set[int] = set()  # servos whose answer to an earlier question may still come
        self._marks = cycle(_MARKS)

    @property
    def path(self) -> str:
        """The port."""
        return self._port.path

    @property
    def clock(self) -> Clock:
        """What it goes by."""
        return self._port.clock

    def table(self, servo: int) -> Table:
        """The control table of a servo.

        Raises:
            HighFiveError: its model is not known.
        """
        if servo not in self._tables:
            raise HighFiveError(f"servo {servo}: its model is not known; ping it first")
        return self._tables[servo]

    def reopen(self) -> None:
        """Opens the port again after it was lost.

        Raises:
            PortError: it is still gone.
        """
        self._port.reopen()

    def close(self) -> None:
        """Lets go of the port; torque stays as it is."""
        self._port.close()

    def ping(self, servo: int) -> Found:
        """Asks one servo who it is.

        Raises:
            NoAnswer: nothing, or nothing whole, came.
            PortError: the port is gone.
        """
        return self._tried(lambda: self._ping(servo))

    def _ping(self, servo: int) -> Found:
        data = self._exchange(servo, INST_PING, b"", _PING_SIZE)
        number = int.from_bytes(data[:2], "little")
        model = model_of(number)
        if model is not None:
            self._tables[servo] = load_table(model)
        return Found(servo, model, number, data[2])

    def scan(self, servos: Sequence[int] = range(LAST_ID + 1)) -> tuple[list[Found], list[int]]:
        """The servos that answer, and the IDs of which only damaged answers came: two servos that share one, or noise.

        Raises:
            PortError: the port is gone.
        """
        found, damaged = [], []
        for servo in servos:
            try:
                found.append(self._ping(servo))
            except DamagedAnswer:
                damaged.append(servo)
            except NoAnswer:
                continue
        return found, damaged

    def read(self, servo: int, name: str) -> int:
        """A register's raw value.

        Raises:
            NoAnswer: the servo is silent.
            ServoError: it refused.
            PortError: the port is gone.
        """
        register = self.table(servo)[name]
        place = register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little")
        return decode(register, self._tried(lambda: self._exchange(servo, INST_READ, place, register.size)))

    def write(self, servo: int, name: str, raw: int) -> None:
        """Writes a register and waits for the servo to say that it took the value.

        Raises:
            NoAnswer, ServoError, PortError: as in :meth:`read`.
        """
        register = self.table(servo)[name]
        if not register.writable:
            raise HighFiveError(f"servo {servo}: {name} is read-only")
        data = register.address.to_bytes(2, "little") + encode(register, raw)
        self._tried(lambda: self._exchange(servo, INST_WRITE, data, 0, name))

    def reboot(self, servo: int) -> None:
        """Starts a servo anew; its hardware errors are cleared, its torque is off.

        Raises:
            NoAnswer, ServoError, PortError: as in :meth:`read`.
        """
        self._exchange(servo, INST_REBOOT, b"", 0)

    def sync_write(self, address: int, values: Mapping[int, bytes]) -> None:
        """Writes the same registers of several servos in one packet; none answers.

        Raises:
            PortError: the port is gone.
        """
        size = len(next(iter(values.values())))
        data = [byte for servo, value in values.items() for byte in (servo, *value)]
        with self._used():
            result = self._sdk.syncWriteTxOnly(self._port, address, size, data, len(data))
        if result != COMM_SUCCESS:
            raise PortError(f"{self.path}: could not send ({self._sdk.getTxRxResult(result).split('] ')[-1]})")

    def fast_sync_read(self, address: int, size: int, servos: Sequence[int]) -> dict[int, bytes]:
        """The same registers of several servos, all in one answer: of every one of them or, if one is silent, of none.

        Raises:
            NoAnswer: the answer is not whole.
            PortError: the port is gone.
        """
        return self._together(servos, size, lambda: self._ask(address, size, servos, fast=True))

    def _together(self, servos: Sequence[int], size: int, ask: Callable[[], object]) -> dict[int, bytes]:
        """The one answer of several servos."""
        length = (size + 4) * len(servos)
        with self._used():
            ask()
            packet, result = self._sdk.rxPacket(self._port, True)
        if result != COMM_SUCCESS or packet[4] != BROADCAST_ID or len(packet) != _ROWS + length:
            raise NoAnswer(f"servos {_listed(servos)}: no whole answer to a fast sync read")
        rows = [bytes(packet[start : start + size + 2]) for start in range(_ROWS, len(packet), size + 4)]
        found = {row[1]: row[2:] for row in rows}
        if set(found) != set(servos):
            raise NoAnswer(f"servos {_listed(servos)} were asked, {_listed(sorted(found))} are in the answer")
        return found

    def sync_read(self, address: int, size: int, servos: Sequence[int]) -> dict[int, bytes]:
        """The same registers of several servos, an answer each: those that came before the first one that did not.

        Raises:
            PortError: the port is gone.
        """
        return self._one_by_one(servos, size, lambda: self._ask(address, size, servos, fast=False))

    def _one_by_one(self, servos: Sequence[int], size: int, ask: Callable[[], object]) -> dict[int, bytes]:
        """The answers of several servos, up to the first that does not come."""
        found = {}
        with self._used():
            ask()
            for servo in servos:
                packet, result = self._answer(servo, size)
                if result != COMM_SUCCESS or _size(packet) != size:
                    break
                found[servo] = bytes(packet[_DATA : _DATA + size])
        self._open.update(set(servos) - set(found))
        return found

    def bulk_write(self, values: Mapping[int, tuple[int, bytes]]) -> None:
        """Writes registers of several servos, each at an address of its own, in one packet; none answers.

        Raises:
            PortError: the port is gone.
        """
        rows = [(servo, *_word(at), *_word(len(value)), *value) for servo, (at, value) in values.items()]
        data = [byte for row in rows for byte in row]
        with self._used():
            result = self._sdk.bulkWriteTxOnly(self._port, data, len(data))
        if result != COMM_SUCCESS:
            raise PortError(f"{self.path}: could not send ({self._sdk.getTxRxResult(result).split('] ')[-1]})")

    def fast_bulk_read(self, places: Mapping[int, int], size: int) -> dict[int, bytes]:
        """``size`` bytes of several servos, each from an address of its own, all in one answer.

        Raises:
            NoAnswer, PortError: as in :meth:`fast_sync_read`.
        """
        return self._together(list(places), size, lambda: self._ask_each(places, size, fast=True))

    def bulk_read(self, places: Mapping[int, int], size: int) -> dict[int, bytes]:
        """The same, an answer each: those that came before the first one that did not.

        Raises:
            PortError: the port is gone.
        """
        return self._one_by_one(list(places), size, lambda: self._ask_each(places, size, fast=False))

    def _ask_each(self, places: Mapping[int, int], size: int, fast: bool) -> None:
        data = [byte for servo, at in places.items() for byte in (servo, *_word(at), *_word(size))]
        self._check(BROADCAST_ID, self._sdk.bulkReadTx(self._port, data, len(data), fast))

    def _ask(self, address: int, size: int, servos: Sequence[int], fast: bool) -> None:
        result = self._sdk.syncReadTx(self._port, address, size, list(servos), len(servos), fast)
        self._check(BROADCAST_ID, result)

    def _exchange(self, servo: int, instruction: int, parameters: bytes, size: int, name: str = "") -> bytes:
        """Tells one servo something; the ``size`` bytes of data that it answers.

        Raises:
            NoAnswer, ServoError, PortError: as in :meth:`read`.
        """
        if servo in self._open:
            self._settle(servo)
        self._open.add(servo)
        with self._used():
            self._tell(servo, instruction, parameters)
            self._port.setPacketTimeout(_BARE + size)
            packet, result = self._answer(servo, size)
        self._check(servo, result, name)
        self._open.discard(servo)
        if code := _error(packet):
            raise ServoError(f"{_named(servo, name)}: {error_text(code)}", code)
        return bytes(packet[_DATA : _DATA + size])

    def _settle(self, servo: int) -> None:
        """Lets a servo finish its answers to earlier questions, which would be taken for the answer to the next one.

        Raises:
            NoAnswer: it says nothing, or nothing whole.
        """
        size = next(self._marks)
        with self._used():
            self._tell(servo, INST_READ, (0).to_bytes(2, "little") + size.to_bytes(2, "little"))
            self._port.setPacketTimeoutMillis(self._port.tx_time_per_byte * (_BARE + size) + _PATIENCE_MS)
            packet, result = self._answer(servo, size)
            while result == COMM_SUCCESS and _size(packet) != size:  # an old refusal
                packet, result = self._answer(servo, size)
        self._check(servo, result)
        self._open.discard(servo)

    def _tell(self, servo: int, instruction: int, parameters: bytes) -> None:
        packet = [0, 0, 0, 0, servo, len(parameters) + 3, 0, instruction, *parameters, 0, 0]
        self._check(servo, self._sdk.txPacket(self._port, packet))

    def _answer(self, servo: int, size: int) -> tuple[list[int], int]:
        """The next packet of a servo that has ``size`` bytes of data, or says an error, and how that went."""
        while True:
            packet, result = self._sdk.rxPacket(self._port, False)
            if result != COMM_SUCCESS:
                return packet, result
            if packet[4] == servo and (_size(packet) == size or (_size(packet) == 0 and _error(packet))):
                return packet, result

    def _tried(self, call: Callable[[], Result]) -> Result:
        """What ``call`` gives, at the first of some tries that finds an answer; the last one waits long."""
        for _ in range(_TRIES - 1):
            with contextlib.suppress(NoAnswer):
                return call()
        allowance, self._port.allowance_ms = self._port.allowance_ms, max(self._port.allowance_ms, _PATIENCE_MS)
        try:
            return call()
        finally:
            self._port.allowance_ms = allowance

    @contextlib.contextmanager
    def _used(self) -> Iterator[None]:
        """Whatever happens in a transfer, the next one finds the port free: after an error the SDK leaves it taken."""
        try:
            yield
        except IndexError:
            raise NoAnswer(f"{self.path}: the answer was cut short") from None
        finally:
            self._port.is_using = False

    def _check(self, servo: int, result: int, name: str = "") -> None:
        if result == COMM_RX_TIMEOUT:
            raise NoAnswer(f"{_named(servo, name)}: no answer at {self._port.baudrate:,} baud on {self.path}")
        if result != COMM_SUCCESS:
            raise DamagedAnswer(f"{_named(servo, name)}: {self._sdk.getTxRxResult(result).split('] ')[-1]}")


def _word(value: int) -> bytes:
    return value.to_bytes(2, "little")


def _size(packet: Sequence[int]) -> int:
    """Bytes of data in an answer; what the SDK gives is longer where it has taken out stuffed bytes."""
    return packet[5] + (packet[6] << 8) + 7 - _BARE


def _error(packet: Sequence[int]) -> int:
    """Why a servo refused; 0 if it did not."""
    return packet[8] & ~ALERT


def _named(servo: int, name: str) -> str:
    return f"servo {servo}" + (f", {name}" if name else "")


def _listed(servos: Sequence[int]) -> str:
    return ", ".join(str(servo) for servo in servos)

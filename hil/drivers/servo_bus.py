"""One bus of Dynamixel servos through the maker's SDK, by names of registers, with what goes wrong told apart.

The SDK is synchronous and belongs to one thread: whoever opens a bus uses it alone. Raw values are those of
:mod:`hil.drivers.control_table`, signs right.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler
from dynamixel_sdk.robotis_def import BROADCAST_ID

from hil.drivers.control_table import Table, decode, encode, load_table, model_of
from hil.drivers.rig import LAST_ID
from hil.drivers.servo_port import ALLOWANCE_MS, PortError, ServoPort
from model.errors import HighFiveError

ALERT = 0x80
"""Bit of a status packet's error byte: the servo has a hardware error."""

_TRIES = 3  # of what is not done in a cycle: now and then an answer is late, or the line noisy

_PATIENCE_MS = 60.0

_FIRMWARE = 6  # address, the same in all models

Result = TypeVar("Result")

_ERRORS = {
    1: "it could not carry out the instruction",
    2: "it does not know the instruction",
    3: "the packet came damaged",
    4: "the value is out of the register's range",
    5: "the data has the wrong length",
    6: "the value is beyond a limit that is set",
    7: "the register cannot be written now (read-only, or torque is on)",
}


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


class ServoBus:
    """An open bus."""

    def __init__(
        self, path: str, baud: int, models: Mapping[int, str] | None = None, allowance_ms: float = ALLOWANCE_MS
    ):
        """Opens the port.

        Args:
            path: the serial port.
            baud: bits a second.
            models: model of each servo by ID, where it is known.
            allowance_ms: how long an answer may be late.

        Raises:
            PortError: the port cannot be opened.
        """
        self._port = ServoPort(path, baud, allowance_ms)
        self._sdk = Protocol2PacketHandler()
        self._tables = {servo: load_table(model) for servo, model in (models or {}).items()}

    @property
    def path(self) -> str:
        """The port."""
        return self._port.path

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
        with self._used():
            number, result, _ = self._sdk.ping(self._port, servo)
        self._check(servo, result, 0)
        model = model_of(number)
        if model is not None:
            self._tables[servo] = load_table(model)
        return Found(servo, model, number, self._read_bytes(servo, _FIRMWARE, 1)[0])

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
        return decode(register, self._tried(lambda: self._read_bytes(servo, register.address, register.size)))

    def _read_bytes(self, servo: int, address: int, size: int) -> bytes:
        with self._used():
            data, result, error = self._sdk.readTxRx(self._port, servo, address, size)
        self._check(servo, result, error)
        if len(data) != size:  # an answer that is an error has no data; the SDK's read4ByteTxRx raises IndexError
            raise NoAnswer(f"servo {servo}: its answer has {len(data)} bytes of data, {size} were asked for")
        return bytes(data)

    def write(self, servo: int, name: str, raw: int) -> None:
        """Writes a register and waits for the servo to say that it took the value.

        Raises:
            NoAnswer, ServoError, PortError: as in :meth:`read`.
        """
        register = self.table(servo)[name]
        if not register.writable:
            raise HighFiveError(f"servo {servo}: {name} is read-only")
        data = encode(register, raw)

        def once() -> None:
            with self._used():
                result, error = self._sdk.writeTxRx(self._port, servo, register.address, register.size, list(data))
            self._check(servo, result, error, name)

        self._tried(once)

    def reboot(self, servo: int) -> None:
        """Starts a servo anew; its hardware errors are cleared, its torque is off.

        Raises:
            NoAnswer, ServoError, PortError: as in :meth:`read`.
        """
        with self._used():
            result, error = self._sdk.reboot(self._port, servo)
        self._check(servo, result, error)

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
        length = (size + 4) * len(servos)
        with self._used():
            self._ask(address, size, servos, fast=True)
            data, result, _ = self._sdk.fastSyncReadRx(self._port, BROADCAST_ID, length)
        if result != COMM_SUCCESS or len(data) < length - 2:
            raise NoAnswer(f"servos {_listed(servos)}: no whole answer to a fast sync read")
        rows = [bytes(data[start : start + size + 2]) for start in range(0, length, size + 4)]
        found = {row[1]: row[2:] for row in rows}
        if set(found) != set(servos):
            raise NoAnswer(f"servos {_listed(servos)} were asked, {_listed(sorted(found))} are in the answer")
        return found

    def sync_read(self, address: int, size: int, servos: Sequence[int]) -> dict[int, bytes]:
        """The same registers of several servos, an answer each: those that came before the first one that did not.

        Raises:
            PortError: the port is gone.
        """
        found = {}
        with self._used():
            self._ask(address, size, servos, fast=False)
            for servo in servos:
                data, result, _ = self._sdk.readRx(self._port, servo, size)
                if result != COMM_SUCCESS or len(data) != size:
                    break
                found[servo] = bytes(data)
        return found

    def _ask(self, address: int, size: int, servos: Sequence[int], fast: bool) -> None:
        result = self._sdk.syncReadTx(self._port, address, size, list(servos), len(servos), fast)
        self._check(BROADCAST_ID, result, 0)

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

    def _check(self, servo: int, result: int, error: int, name: str = "") -> None:
        where = f"servo {servo}" + (f", {name}" if name else "")
        if result == COMM_RX_TIMEOUT:
            raise NoAnswer(f"{where}: no answer at {self._port.baudrate:,} baud on {self.path}")
        if result != COMM_SUCCESS:
            raise DamagedAnswer(f"{where}: {self._sdk.getTxRxResult(result).split('] ')[-1]}")
        if code := error & ~ALERT:
            raise ServoError(f"{where}: {_ERRORS.get(code, f'error {code}')}", code)


def _listed(servos: Sequence[int]) -> str:
    return ", ".join(str(servo) for servo in servos)

"""A serial port as ``dynamixel_sdk`` wants one, without what goes wrong in the SDK's own.

The SDK's port measures time with the wall clock, waits in a busy loop, and allows 34 ms for an answer that takes one.
Here time and waiting are the clock's that is passed in, and the allowance is a setting.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

from dynamixel_sdk.port_handler import PortHandler

from highfive.hil.drivers.bus.control_table import BAUD_RATES
from highfive.hil.drivers.bus.serial_line import MACHINE_WIRING, Line, Wiring
from highfive.model.errors import HighFiveError

ALLOWANCE_MS = 4.0
"""How long after its last byte could have come an answer is waited for: two polls of a USB adapter and some more."""

PATIENCE_MS = 50.0
"""The same where nothing is in a hurry, as before anything moves; an adapter may keep an answer back for 16 ms."""

_BITS = 10  # a byte on the line: start, eight bits, stop


class PortError(HighFiveError):
    """The port cannot be opened, or is gone."""


class ServoPort(PortHandler):
    """An open serial port. One owner, one thread: nothing here is locked."""

    def __init__(self, path: str, baud: int, allowance_ms: float = ALLOWANCE_MS, wiring: Wiring = MACHINE_WIRING):
        """Opens it.

        Args:
            path: such as ``/dev/ttyUSB0``.
            baud: one that the SDK knows, up to 4,000,000.
            allowance_ms: for answers.
            wiring: clock and lines.

        Raises:
            PortError: there is no such port, it is busy or no serial port, or the rate is none.
        """
        super().__init__(path)
        self.path, self.allowance_ms, self.clock = path, allowance_ms, wiring.clock
        self._open_line = wiring.open_line
        self._open: Line | None = None
        if self.getCFlagBaud(baud) <= 0:
            known = ", ".join(f"{rate:,}" for rate in BAUD_RATES if self.getCFlagBaud(rate) > 0)
            raise PortError(f"{path}: {baud:,} baud cannot be had through the SDK; servos and SDK share {known}")
        self.baudrate = baud
        self.reopen()

    def reopen(self) -> None:
        """Opens the port, again if need be, at low latency; whatever was under way is forgotten.

        Raises:
            PortError: it cannot be opened.
        """
        self.close()
        try:
            self._open = self._open_line(self.path, self.baudrate)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise PortError(f"{self.path}: {_reason(error, self.path)}") from None
        self.is_open, self.is_using = True, False
        self.tx_time_per_byte = _BITS * 1e3 / self.baudrate

    def close(self) -> None:
        """Closes the port; a second call does nothing."""
        if self._open is not None:
            self._open.close()
        self._open, self.is_open, self.is_using = None, False, False

    def readPort(self, length: int) -> bytes:
        """Up to ``length`` bytes; waits for the first one until the answer is overdue."""
        if length <= 0:
            return b""
        line = self._line()
        left_ms = self.packet_timeout - self.getTimeSinceStart()
        try:
            if not self.clock.wait_for(line, self.clock.now() + round(1e6 * max(0.0, left_ms))):
                return b""
            data = line.read(length)
        except (OSError, ValueError) as error:
            raise PortError(f"{self.path}: the port is gone ({_strerror(error)})") from None
        if not data:
            raise PortError(f"{self.path}: the port is gone (it was hung up)")
        return data

    def writePort(self, packet: bytes) -> int:
        """Sends all of a packet; how many bytes that were."""
        data, line = bytes(packet), self._line()
        try:
            line.write(data)
        except TimeoutError:
            raise PortError(f"{self.path}: the port takes no bytes") from None
        except (OSError, ValueError) as error:
            raise PortError(f"{self.path}: the port is gone ({_strerror(error)})") from None
        return len(data)

    def clearPort(self) -> None:
        """Drops what has come and was not read."""
        try:
            if self._open is not None:
                self._open.clear()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise PortError(f"{self.path}: the port is gone ({_strerror(error)})") from None

    def setPacketTimeout(self, packet_length: int) -> None:
        """Starts the time in which an answer of so many bytes must have come."""
        self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + self.allowance_ms)

    def getCurrentTime(self) -> float:
        """The clock, ms."""
        return 1e-6 * self.clock.now()

    def _line(self) -> Line:
        if self._open is None:
            raise PortError(f"{self.path}: the port is closed")
        return self._open


def _reason(error: Exception, path: str) -> str:
    """Why a port did not open, in words of this world."""
    number = getattr(error, "errno", None)
    if number == errno.ENOENT or (number is None and not Path(path).exists()):
        return "no such port; `highfive rig scan` lists those that are there"
    if number in (errno.EACCES, errno.EPERM):
        return "no permission; on Linux, add yourself to the group dialout and log in again"
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK) or "lock" in str(error).lower():
        return "busy: another program has it open"
    if number in (errno.ENOTTY, errno.EINVAL, errno.EISDIR) or "configure port" in str(error):
        return "not a serial port"
    return _strerror(error)


def _strerror(error: Exception) -> str:
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else str(error) or type(error).__name__

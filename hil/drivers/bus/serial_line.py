"""The line that a bus is reached by: the system's serial ports, or anything that carries bytes in and out."""

from __future__ import annotations

import contextlib
import os
import select
import termios
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import serial

from highfive.hil.runtime.clock import MACHINE, Clock, Event

_WRITE_S = 0.1


class Line(Event, Protocol):
    """An open line, and the event that something has come. What it raises is an ``OSError``."""

    def read(self, length: int) -> bytes:
        """Up to ``length`` bytes of what has come; nothing where the other end is gone."""
        ...

    def write(self, data: bytes) -> None:
        """Sends all of it."""
        ...

    def clear(self) -> None:
        """Drops what has come and was not read."""
        ...

    def close(self) -> None:
        """Lets go of it."""
        ...


class SerialLine:
    """A serial port of this computer, at low latency, for one owner."""

    due_ns = None

    def __init__(self, path: str, baud: int) -> None:
        """Opens it.

        Raises:
            OSError, ValueError: it cannot be opened.
        """
        try:
            self._port = serial.Serial(path, baud, timeout=0, write_timeout=_WRITE_S, exclusive=True)
            self._port.reset_input_buffer()
        except termios.error as error:
            raise OSError(error.args[0], os.strerror(error.args[0])) from None
        with contextlib.suppress(ValueError, OSError):  # no adapter; whether it helped is read from the system
            self._port.set_low_latency_mode(True)

    def fileno(self) -> int:
        """Readable once something has come."""
        return self._port.fileno()

    def read(self, length: int) -> bytes:
        """Up to ``length`` bytes of what has come; nothing where the other end is gone."""
        return os.read(self._port.fileno(), length)

    def write(self, data: bytes) -> None:
        """Sends all of it.

        Raises:
            OSError: the port is gone, or takes no bytes.
        """
        file, left = self._port.fileno(), memoryview(data)
        while left:
            if not select.select([], [file], [], _WRITE_S)[1]:
                raise TimeoutError("it takes no bytes")
            left = left[os.write(file, left) :]

    def clear(self) -> None:
        """Drops what has come and was not read."""
        try:
            self._port.reset_input_buffer()
        except termios.error as error:
            raise OSError(error.args[0], os.strerror(error.args[0])) from None

    def close(self) -> None:
        """Lets go of it."""
        self._port.close()


@dataclass(frozen=True)
class Wiring:
    """What a bus hangs on: the clock that it goes by, and how a line of some path and baud rate is opened."""

    clock: Clock
    open_line: Callable[[str, int], Line]


MACHINE_WIRING = Wiring(MACHINE, SerialLine)
"""This computer's clock and serial ports."""

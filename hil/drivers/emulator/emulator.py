"""Serves an emulated bus on a pseudo-terminal, in real time: what a host finds there is a serial port with servos.

Bytes go out at absolute deadlines; the last fraction of a millisecond before one is waited for in a busy loop, for the
system's timers are not that exact. The host's baud rate is read from the terminal.
"""

from __future__ import annotations

import fcntl
import os
import re
import select
import struct
import sys
import time
import tty
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Event, Lock

from highfive.hil.drivers.emulator.bus_faults import BusFault, parse_faults
from highfive.hil.drivers.emulator.emulated_bus import EmulatedBus
from highfive.hil.runtime.clock import MACHINE
from highfive.model.errors import HighFiveError

SPIN_NS = 300_000
"""A deadline that is nearer than this is waited for in a busy loop, and so is what the host says after a reply."""

IDLE_S = 0.002
"""With nothing to send, the servos are let move so often."""

_TCGETS2 = 0x802C542A  # Linux: the terminal's settings with its speeds as numbers
_TERMIOS2 = struct.Struct("<4IB19s2I")
_CHUNK = 4096
_PSEUDO = re.compile(r"/dev/(pts/|ttys)\d+")  # Linux, macOS


@dataclass(frozen=True)
class EmulatorSummary:
    """What an emulator has done: as in :class:`~highfive.hil.drivers.emulator.emulated_bus.BusCounts`, and
    ``overruns``, replies that the host did not fetch, and ``late_us``, how late bytes went out at worst."""

    seconds: float
    instructions: dict[str, int]
    damaged: int
    errors: int
    collisions: int
    watchdog_trips: int
    overruns: int
    late_us: float


class Emulator:
    """A bus behind a pseudo-terminal. A context manager; :meth:`run` serves it in the thread that calls it.

    Attributes:
        port: path of the device that a host opens: the link where there is one, otherwise the terminal.
    """

    def __init__(
        self, bus: EmulatedBus, *, link: str | Path | None = None, clock: Callable[[], int] = MACHINE.now
    ) -> None:
        """Opens the terminal, and makes ``link`` a symbolic link to it.

        Raises:
            HighFiveError: there are no pseudo-terminals here, or the link cannot be made.
        """
        self._bus, self._clock = bus, clock
        self._link = Path(link) if link else None
        self._lock = Lock()
        self._requested: tuple[tuple[BusFault, ...], Event] | None = None
        self._master = self._slave = -1
        self._overruns = self._late_ns = self._spoken = 0
        self._zero = clock()
        self._plug()
        self.port = str(self._link or os.ttyname(self._slave))

    def __enter__(self) -> Emulator:
        """Nothing more than is open already."""
        return self

    def __exit__(self, *_: object) -> None:
        """Closes the terminal and removes the link."""
        self._unplug()

    def set_faults(self, faults: str | Iterable[str]) -> Event:
        """From now on only these go wrong, and their times count from now; an empty text ends all. From any thread.

        Returns:
            an event that is set once they are in force, which :meth:`run` sees to.

        Raises:
            HighFiveError: they are spelt otherwise than :func:`~highfive.hil.drivers.emulator.bus_faults.parse_fault`
            wants, or of a servo that is not there.
        """
        parsed = parse_faults([faults] if isinstance(faults, str) else faults, self._bus.ids)
        in_force = Event()
        with self._lock:
            self._requested = parsed, in_force
        return in_force

    def run(self, over: Callable[[], bool], seconds: float | None = None) -> EmulatorSummary:
        """Serves the bus until ``over`` says so, or for so long."""
        end = None if seconds is None else self._now() + round(seconds * 1e9)
        while not over() and (end is None or self._now() < end):
            self._take_faults()
            if self._bus.unplugged(self._now()) != (self._master < 0):
                self._plug() if self._master < 0 else self._unplug()
            self._serve()
        counts = asdict(self._bus.counts)
        return EmulatorSummary(
            seconds=self._now() * 1e-9,
            **counts,
            watchdog_trips=self._bus.watchdog_trips,
            overruns=self._overruns,
            late_us=self._late_ns / 1e3,
        )

    def _now(self) -> int:
        return self._clock() - self._zero

    def _take_faults(self) -> None:
        if self._requested is not None:
            with self._lock:
                (faults, in_force), self._requested = self._requested, None
            self._bus.set_faults(faults, self._now())
            in_force.set()

    def _serve(self) -> None:
        """Waits for the next thing that happens on the line, and lets it happen."""
        bus = self._bus
        now = self._now()
        if bus.pending:
            wait = bus.pending[0].time_ns - now
        else:  # what follows a reply usually follows at once
            wait = 0 if now - self._spoken < SPIN_NS else round(IDLE_S * 1e9)
        if self._master < 0:
            time.sleep(IDLE_S)
        elif select.select([self._master], [], [], max(0, wait - SPIN_NS) * 1e-9)[0]:
            bus.receive(self._read(), self._now(), self._baud())
        now = self._now()
        for piece in bus.due(now):
            self._late_ns, self._spoken = max(self._late_ns, now - piece.time_ns), now
            self._write(piece.data)
        if not bus.pending or bus.pending[0].time_ns - now > SPIN_NS:
            bus.advance(now)

    def _read(self) -> bytes:
        try:
            return os.read(self._master, _CHUNK)
        except BlockingIOError:
            return b""

    def _write(self, data: bytes) -> None:
        if self._master < 0:
            return
        try:
            if os.write(self._master, data) < len(data):
                self._overruns += 1
        except BlockingIOError:
            self._overruns += 1

    def _baud(self) -> int | None:
        """The host's, as the terminal says; None where this system does not say."""
        if not sys.platform.startswith("linux"):
            return None
        settings = fcntl.ioctl(self._slave, _TCGETS2, bytes(_TERMIOS2.size))
        return _TERMIOS2.unpack(settings)[-1]

    def _plug(self) -> None:
        try:
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            if self._link:
                self._make_link(self._link)
        except HighFiveError:
            self._unplug()
            raise
        except OSError as error:
            self._unplug()
            raise HighFiveError(f"cannot make a pseudo-terminal: {error.strerror or error}") from None

    def _make_link(self, link: Path) -> None:
        if link.is_symlink():
            target = os.readlink(link)
            left = _PSEUDO.fullmatch(target) and not os.path.exists(target)  # by an emulator that was killed
            if not left and target != os.ttyname(self._slave):
                raise HighFiveError(
                    f"{link} leads to {target}, which somebody uses; choose another path, or remove the link"
                )
            link.unlink()
        elif os.path.lexists(link):
            raise HighFiveError(f"{link} is there and is no link to a port; choose another path for the port")
        try:
            link.symlink_to(os.ttyname(self._slave))
        except OSError as error:
            raise HighFiveError(f"cannot make {link}: {error.strerror or error}; choose another path") from None

    def _unplug(self) -> None:
        link, own = self._link, os.ttyname(self._slave) if self._slave >= 0 else ""
        if link and link.is_symlink() and os.readlink(link) == own:  # not what somebody else has put in its place
            link.unlink()
        for descriptor in (self._master, self._slave):
            if descriptor >= 0:
                os.close(descriptor)
        self._master = self._slave = -1

"""An emulated arm with its driver in virtual time: driver, line, servos and their body, in one process.

What runs is what runs on the machine, from the servo maker's SDK to the servos' registers; each byte takes its time on
the line.
"""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable

from highfive.hil.drivers.bus.arm_host import ArmHost
from highfive.hil.drivers.bus.cycle_loop import drive_bus
from highfive.hil.drivers.bus.cycle_ring import CycleRing, ring_size
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.serial_line import Wiring
from highfive.hil.drivers.bus.servo_port import ALLOWANCE_MS
from highfive.hil.drivers.emulator.emulated_bus import EmulatedBus
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.values import JointCommand
from highfive.hil.runtime.virtual_clock import VirtualClock

PATH = "virtual"
"""Of the port."""

STEP_NS = 1_000_000
"""Servos and their body move on so often."""


class VirtualRig:
    """A bus in virtual time.

    Attributes:
        bus: the servos and what goes wrong with them.
        wiring: clock and lines, for whoever opens the port at :data:`PATH`.
        arm: the driver that was started last.
    """

    def __init__(self, clock: VirtualClock, bus: EmulatedBus, watch: Callable[[int], None] = lambda now: None) -> None:
        """Switched on now.

        Args:
            clock: what all goes by.
            bus: the servos.
            watch: is called whenever the body has moved on, with the time, ns.
        """
        self.bus, self.clock, self._watch = bus, clock, watch
        self.wiring = Wiring(clock, self._open)
        self.arm: VirtualArm | None = None
        self._zero = clock.now()
        self._lines: list[VirtualLine] = []
        clock.start("servos", self._run)

    def now(self) -> int:
        """The bus's own time, ns."""
        return self.clock.now() - self._zero

    def since_ns(self, bus_ns: int) -> int:
        """A time of the bus as the clock has it, ns."""
        return bus_ns + self._zero

    def start_arm(
        self,
        rig: Rig,
        rate_hz: float = 120.0,
        estop: Latch | None = None,
        allowance_ms: float = ALLOWANCE_MS,
        has_host: Callable[[], bool] = lambda: True,
    ) -> VirtualArm:
        """Starts the driver; see :class:`~highfive.hil.drivers.bus.arm_process.ArmProcess`.

        Args:
            rig: the arm; its servos must be configured.
            rate_hz: cycles a second.
            estop: the emergency stop.
            allowance_ms: how long an answer of a servo may be late.
            has_host: whether the host is alive.
        """
        latch = Latch(self.clock) if estop is None else estop
        self.arm = VirtualArm(self, rig, rate_hz, latch, allowance_ms, has_host)
        return self.arm

    def _open(self, path: str, baud: int) -> VirtualLine:
        if path != PATH or self.bus.unplugged(self.now()):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        if self._lines:
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
        line = VirtualLine(self, baud, self._lines.remove)
        self._lines.append(line)
        return line

    def _run(self) -> None:
        due = self.clock.now()
        while True:
            due += STEP_NS
            self.clock.wait_until(due)
            now = due - self._zero
            if self.bus.unplugged(now):
                for line in self._lines:
                    line.gone = True
            self.bus.advance(now)
            self._watch(due)


class VirtualLine:
    """An open line to the bus; see :class:`~highfive.hil.drivers.bus.serial_line.Line`.

    Attributes:
        gone: the cable was pulled.
    """

    def __init__(self, rig: VirtualRig, baud: int, left: Callable[[VirtualLine], None]) -> None:
        """Open; ``left`` is called once it is closed."""
        self._rig, self._baud, self._left = rig, baud, left
        self._come = b""
        self.gone = False

    def fileno(self) -> int:
        """There is none: only a virtual clock waits for it."""
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))

    @property
    def due_ns(self) -> int | None:
        """When the next byte has come through."""
        if self._come or self.gone:
            return 0
        pending = self._rig.bus.pending
        return self._rig.since_ns(pending[0].time_ns) if pending else None

    def read(self, length: int) -> bytes:
        """Up to ``length`` bytes of what has come; nothing where the cable was pulled."""
        if self.gone:
            return b""
        self._fetch()
        found, self._come = self._come[:length], self._come[length:]
        return found

    def write(self, data: bytes) -> None:
        """Sends all of it."""
        if self.gone:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        self._fetch()
        self._rig.bus.receive(data, self._rig.now(), self._baud)

    def clear(self) -> None:
        """Drops what has come and was not read."""
        self._fetch()
        self._come = b""

    def close(self) -> None:
        """Lets go of it."""
        self._left(self)

    def _fetch(self) -> None:
        self._come += b"".join(piece.data for piece in self._rig.bus.due(self._rig.now()))


class VirtualArm(ArmHost):
    """The host's side of a driver in virtual time, and the driver."""

    def __init__(
        self, rig: VirtualRig, arm: Rig, rate_hz: float, estop: Latch, allowance_ms: float, has_host: Callable[[], bool]
    ) -> None:
        """Starts the driver."""
        joints = len(arm.joints)
        shared = CycleRing(bytearray(ring_size(joints)), joints, threading.RLock())
        held = _Post()
        super().__init__(shared, held, estop, rig.clock)
        self._has_host = has_host
        self.task = rig.clock.start(
            "driver",
            lambda: drive_bus(shared, held, PATH, arm, rate_hz, estop, has_host, allowance_ms, rig.wiring),
        )

    @property
    def alive(self) -> bool:
        """The driver runs."""
        return self.task.alive

    @property
    def trouble(self) -> str:
        """What is wrong, in one line; '' for nothing."""
        if self.task.error is not None:
            return f"the driver ended by itself ({self.task.error!r})"
        said = super().trouble
        return said if said or self.task.alive or self._shared.head["end"][0] else "the driver ended by itself"

    def drive(self, command: JointCommand) -> None:
        """Gives a command; a host that was killed gives none."""
        if self._has_host():
            super().drive(command)

    def close(self, timeout_s: float = 3.0) -> None:
        """Ends the driver; see :meth:`highfive.hil.drivers.bus.arm_host.ArmHost.close`. A host that was killed does
        not."""
        if not self._has_host():
            return
        self._shared.head["end"][0] = 1
        deadline = self._clock.now() + round(1e9 * timeout_s)
        while self.alive and self._clock.now() < deadline:
            self._look_again()
        self.task.kill()


class _Post(list[dict[int, dict[str, int]]]):
    """What was read back, on its way to the host."""

    def send(self, registers: dict[int, dict[str, int]], /) -> None:
        """Puts it in."""
        self.append(registers)

    def poll(self) -> bool:
        """Something is there."""
        return bool(self)

    def recv(self) -> dict[int, dict[str, int]]:
        """Takes it out."""
        return self.pop(0)

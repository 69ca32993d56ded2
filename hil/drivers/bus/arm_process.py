"""The arm's bus in a process of its own: what waits for servos must not hold up whoever answers a person.

The two sides share a block of memory (:mod:`highfive.hil.drivers.bus.cycle_ring`) and never wait for each other. The
newest command is a one-place mailbox; every cycle leaves a row in a ring. This is the host's side; the other is
:mod:`highfive.hil.drivers.bus.cycle_loop`.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import time

from highfive.hil.drivers.bus.cycle_loop import run_cycles
from highfive.hil.drivers.bus.cycle_ring import ROWS, Cycle, CycleRing, Mode, ring_size
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.servo_port import ALLOWANCE_MS
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.values import JointCommand, JointHealth, JointState
from highfive.model.errors import HighFiveError


class ArmProcess:
    """The host's side: gives commands, reads cycles. One owner, one thread."""

    def __init__(
        self,
        port: str,
        rig: Rig,
        rate_hz: float = 120.0,
        estop: Latch | None = None,
        allowance_ms: float = ALLOWANCE_MS,
    ):
        """Starts the process; it opens the port, tells the servos what to show, and reads.

        Args:
            port: path of the serial port.
            rig: the arm on it; its servos must be configured.
            rate_hz: cycles a second.
            estop: once it is pulled the arm is told to stay where it is, and no goal is sent any more.
            allowance_ms: how long an answer of a servo may be late.
        """
        context = multiprocessing.get_context("spawn")
        self._joints = len(rig.joints)
        self._raw = context.RawArray("b", ring_size(self._joints))
        self._shared = CycleRing(self._raw, self._joints)
        self.estop = Latch() if estop is None else estop
        self._read, self._closed = 0, False
        self._held, theirs = context.Pipe(duplex=False)
        arguments = (self._raw, theirs, port, rig, rate_hz, self.estop, os.getpid(), allowance_ms)
        self._process = context.Process(target=run_cycles, args=arguments, name=f"arm {port}", daemon=True)
        self._process.start()
        theirs.close()
        atexit.register(self.close)  # a host that forgot would wait for a process that is told nothing

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid or 0

    @property
    def mode(self) -> Mode:
        """What the process is doing; ENDED when it is gone, whatever took it."""
        return Mode(int(self._shared.head["mode"][0])) if self._process.is_alive() else Mode.ENDED

    @property
    def trouble(self) -> str:
        """What is wrong, in one line; '' for nothing."""
        said = bytes(self._shared.head["trouble"][0]).decode("utf-8", "replace")
        if not (said or self._closed) and not self._process.is_alive() and self._process.exitcode:
            return f"the process of the arm ended by itself (exit code {self._process.exitcode})"
        return said

    def wait_ready(self, timeout_s: float = 10.0) -> None:
        """Returns once the arm has been read.

        Raises:
            HighFiveError: that failed, or took longer.
        """
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if self.trouble:
                raise HighFiveError(self.trouble)
            if self._shared.head["rows"][0] > 0:
                return
            time.sleep(0.002)
        raise HighFiveError(f"the arm did not answer within {timeout_s:g} s")

    def engage(self, timeout_s: float = 10.0) -> dict[int, dict[str, int]]:
        """Switches torque on, where each joint stands, and arms the watchdogs; from then on the arm can be driven.

        An arm that is engaged already only has everything read back.

        Returns:
            what every servo's settings are then, read back one by one: by ID, then by the register's name, raw.

        Raises:
            HighFiveError: a servo is missing or refuses, or it took longer.
        """
        self._shared.head["engage"][0] = 1
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if self._held.poll(0.01):
                try:
                    return self._held.recv()
                except EOFError:
                    break
            if self.mode in (Mode.STOPPED, Mode.PORT_LOST, Mode.ENDED):
                raise HighFiveError(self.trouble or "the arm was stopped before it was switched on")
        raise HighFiveError(self.trouble or f"the arm's servos were not switched on within {timeout_s:g} s")

    def drive(self, command: JointCommand) -> None:
        """Gives a command to an arm that is engaged. It holds until the next one, and has to be followed by one within
        :data:`HOST_SILENT_NS`."""
        head, writing = self._shared.head, self._begin_writing()
        head["positions"][0], head["currents"][0] = command.positions, command.currents
        head["given_ns"][0] = time.monotonic_ns()
        head["drive"][0] = 1
        head["written"][0] = writing + 1

    def _begin_writing(self) -> int:
        """Makes the number odd; it is already where an interrupt cut the last command short."""
        writing = int(self._shared.head["written"][0]) | 1
        self._shared.head["written"][0] = writing
        return writing

    def newest(self) -> Cycle | None:
        """The last cycle; None before the first."""
        count = int(self._shared.head["rows"][0])
        return self._cycle(count - 1) if count else None

    def unread(self) -> list[Cycle]:
        """The cycles since the last call, oldest first; those that the ring no longer holds are left out."""
        count = int(self._shared.head["rows"][0])
        start, self._read = max(self._read, count - ROWS + 2), count
        return [self._cycle(number) for number in range(start, count)]

    def close(self, timeout_s: float = 3.0) -> None:
        """Ends the process. The arm holds where it is, once it stands with the last command's current: torque stays on,
        watchdogs are switched off."""
        atexit.unregister(self.close)
        self._shared.head["end"][0] = 1
        self._process.join(timeout_s)
        self._closed = True
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def _cycle(self, number: int) -> Cycle:
        row = self._shared.rows[number % ROWS].copy()
        sent = JointCommand(row["sent_positions"], row["sent_currents"]) if row["is_sent"] else None
        state = JointState(
            int(row["time_ns"]), row["positions"], row["velocities"], row["currents"], row["errors"],
            row["answered"].astype(bool), row["tripped"].astype(bool), row["apart"],
        )  # fmt: skip
        health = JointHealth(int(row["health_ns"]), row["temperatures"], row["voltages"])
        return Cycle(
            int(row["number"]), Mode(int(row["mode"])), int(row["due_ns"]), int(row["begun_ns"]), int(row["took_ns"]),
            sent, state, health,
        )  # fmt: skip

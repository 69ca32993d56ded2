"""The arm's bus in a process of its own: what waits for servos must not hold up whoever answers a person."""

from __future__ import annotations

import atexit
import multiprocessing
import os

from highfive.hil.drivers.bus.arm_host import ArmHost
from highfive.hil.drivers.bus.cycle_loop import run_cycles
from highfive.hil.drivers.bus.cycle_ring import CycleRing, ring_size
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.servo_port import ALLOWANCE_MS
from highfive.hil.drivers.latch import Latch
from highfive.hil.runtime.clock import MACHINE
from highfive.model.errors import HighFiveError


class ArmProcess(ArmHost):
    """The host's side, and the process."""

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
            estop: once it is pulled the arm is commanded to stay where it is, and no goal is sent any more.
            allowance_ms: how long an answer of a servo may be late.
        """
        context = multiprocessing.get_context("spawn")
        joints = len(rig.joints)
        try:
            lock, raw = context.RLock(), context.RawArray("b", ring_size(joints))
        except OSError as error:
            raise HighFiveError(
                f"no memory to share with the process of the arm: {error.strerror or error}; make room in the folder "
                "for temporary files"
            ) from None
        held, theirs = context.Pipe(duplex=False)
        super().__init__(CycleRing(raw, joints, lock), held, Latch() if estop is None else estop, MACHINE)
        self._closed = False
        arguments = (raw, lock, theirs, port, rig, rate_hz, self.estop, os.getpid(), allowance_ms)
        self._process = context.Process(target=run_cycles, args=arguments, name=f"arm {port}", daemon=True)
        self._process.start()
        theirs.close()
        atexit.register(self.close)  # a host that forgot would wait for a process that is told nothing

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid or 0

    @property
    def alive(self) -> bool:
        """The process runs."""
        return self._process.is_alive()

    @property
    def trouble(self) -> str:
        """What is wrong, in one line; '' for nothing."""
        said = super().trouble
        if not (said or self._closed) and not self._process.is_alive() and self._process.exitcode:
            return f"the process of the arm ended by itself (exit code {self._process.exitcode})"
        return said

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
        self._shared.leave()

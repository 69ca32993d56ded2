"""The host's side of the arm's bus: gives commands, reads cycles, and waits for nothing but the arm to begin.

The other side is :mod:`highfive.hil.drivers.bus.cycle_loop`, in a process of its own
(:class:`highfive.hil.drivers.bus.arm_process.ArmProcess`) or in virtual time
(:class:`highfive.hil.drivers.emulator.virtual_rig.VirtualRig`). The two share a block of memory
(:mod:`highfive.hil.drivers.bus.cycle_ring`): the newest command is a one-place mailbox, and every cycle leaves a row in
a ring.
"""

from __future__ import annotations

from typing import Protocol

from highfive.hil.drivers.bus.cycle_ring import Cycle, CycleRing, Mode
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.values import JointCommand
from highfive.hil.runtime.clock import Clock
from highfive.model.errors import HighFiveError

_LOOK_NS = 2_000_000


class Inbox(Protocol):
    """Where the registers come from that were read back."""

    def poll(self) -> bool:
        """Something is there."""
        ...

    def recv(self) -> dict[int, dict[str, int]]:
        """It."""
        ...


class ArmHost:
    """Gives commands, reads cycles. One owner, one thread."""

    def __init__(self, shared: CycleRing, held: Inbox, estop: Latch, clock: Clock) -> None:
        """Args:
        shared: with the other side.
        held: what it reads back.
        estop: once it is pulled the arm is commanded to stay where it is, and no goal is sent any more.
        clock: of both sides.
        """
        self._shared, self._held, self.estop, self._clock = shared, held, estop, clock
        self._read = 0
        self._newest: Cycle | None = None

    @property
    def alive(self) -> bool:
        """The other side runs."""
        raise NotImplementedError

    @property
    def mode(self) -> Mode:
        """What the other side is doing; ENDED when it is gone, whatever took it."""
        return Mode(int(self._shared.head["mode"][0])) if self.alive else Mode.ENDED

    @property
    def trouble(self) -> str:
        """What is wrong, in one line; '' for nothing."""
        return self._shared.trouble

    def wait_ready(self, timeout_s: float = 10.0) -> None:
        """Returns once the arm has been read.

        Raises:
            HighFiveError: that failed, or took longer.
        """
        deadline = self._clock.now() + round(1e9 * timeout_s)
        while self._clock.now() < deadline:
            if self.trouble:
                raise HighFiveError(self.trouble)
            if self._shared.count:
                return
            self._look_again()
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
        deadline = self._clock.now() + round(1e9 * timeout_s)
        while self._clock.now() < deadline:
            if self._held.poll():
                try:
                    return self._held.recv()
                except EOFError:
                    break
            if self.mode in (Mode.STOPPED, Mode.PORT_LOST, Mode.ENDED):
                raise HighFiveError(
                    self.trouble or f"{self.estop.said or 'the arm was stopped'} before the arm was made ready"
                )
            self._look_again()
        raise HighFiveError(self.trouble or f"the arm's servos were not switched on within {timeout_s:g} s")

    def drive(self, command: JointCommand) -> None:
        """Gives a command to an arm that is engaged. It holds until the next one, and has to be followed by one within
        :data:`highfive.hil.drivers.bus.cycle_loop.HOST_SILENT_NS`."""
        self._shared.give(command, self._clock.now())

    def newest(self) -> Cycle | None:
        """The last cycle; None before the first."""
        if (count := self._shared.count) and (found := self._shared.cycles(count - 1)):
            self._newest = found[-1]
        return self._newest

    def unread(self) -> list[Cycle]:
        """The cycles since the last call, oldest first; those that the ring no longer holds are left out."""
        found = self._shared.cycles(self._read)
        self._read = found[-1].number + 1 if found else self._read
        return found

    def pass_over(self) -> None:
        """What is unread is left out: quickly, where reading some thousand cycles takes a tenth of a second."""
        self._read = self._shared.count

    def cycles(self, start: int) -> list[Cycle]:
        """Those from number ``start`` on that the ring still holds, oldest first; they are not taken for read."""
        return self._shared.cycles(start)

    def close(self, timeout_s: float = 3.0) -> None:
        """Ends the other side. The arm holds where it is, once it stands with the last command's current: torque stays
        on, watchdogs are switched off."""
        raise NotImplementedError

    def _look_again(self) -> None:
        self._clock.wait_until(self._clock.now() + _LOOK_NS)

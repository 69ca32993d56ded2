"""What the arm's process does: a cycle of the bus in every period.

The process goes by the clock, and keeps its phase behind the host's, so that each command goes out once: where two
clocks of one rate run freely, a cycle repeats a command and the next one makes up for two, at twice the speed. Without
a command the cycle goes on, so that the servos hear from it and their watchdogs stay quiet. Once the host falls silent
or is gone, the arm is commanded to stay where it is, then nothing more, and the watchdogs do the rest. An emergency
stop wakes the process at once.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, Protocol

import numpy as np

from highfive.hil.drivers.bus.cycle_ring import CycleRing, Lock, Mode
from highfive.hil.drivers.bus.joint_bus import JointBus
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.rig_setup import read_back
from highfive.hil.drivers.bus.serial_line import MACHINE_WIRING, Wiring
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.bus.servo_port import PortError
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.priority import go_first
from highfive.hil.drivers.values import JointCommand, JointState
from highfive.model.errors import HighFiveError

HOST_SILENT_NS = 50_000_000
"""A host that gives no command for so long is taken for stalled: the arm is commanded to stay where it is, ns."""

STANDS, BRAKING_NS = 0.05, 300_000_000
"""rad/s: slower joints stand; ns: by then they do."""

SAGGED = 0.03
"""rad, as far as a joint stands off its goal by its own load; further off, a hand or a thing may be in its way."""

PATIENCE = 0.4
"""Of a period: so long a cycle waits for a command that is late. From half of one on it counts as missed."""

WAITED_NS, NEARER = 1_000_000, 0.02
"""ns: a command that was there longer before its cycle brings the next cycle nearer, by so much of a period."""

_LOOK_NS = 300_000  # between looks for a command that is late

REOPEN_NS = 200_000_000
"""How often a lost port is tried again, ns."""


class Outbox(Protocol):
    """Where the registers go that were read back."""

    def send(self, registers: dict[int, dict[str, int]], /) -> None:
        """By ID, then by the register's name, raw."""
        ...


def run_cycles(
    raw: Any,
    lock: Lock,
    held: Connection,
    port: str,
    rig: Rig,
    rate_hz: float,
    estop: Latch,
    parent: int,
    allowance_ms: float,
) -> None:
    """The other side, until it has to end or the host is gone."""
    # The host's to handle, which stops the arm in order; SIGTSTP goes to the terminal's whole group.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    go_first()
    shared = CycleRing(raw, len(rig.joints), lock)
    drive_bus(shared, held, port, rig, rate_hz, estop, lambda: os.getppid() == parent, allowance_ms, MACHINE_WIRING)


def drive_bus(
    shared: CycleRing,
    held: Outbox,
    port: str,
    rig: Rig,
    rate_hz: float,
    estop: Latch,
    has_host: Callable[[], bool],
    allowance_ms: float,
    wiring: Wiring,
) -> None:
    """Opens the bus and cycles until it has to end or the host is gone.

    Args:
        shared: with the host.
        held: takes what was read back.
        port: path of the serial port.
        rig: the arm on it.
        rate_hz: cycles a second.
        estop: the emergency stop.
        has_host: whether the host is there.
        allowance_ms: how long an answer of a servo may be late.
        wiring: clock and lines.
    """
    try:
        bus = ServoBus(port, rig.baud_rate, rig.models, allowance_ms, wiring)
        try:
            _CycleLoop(bus, rig, shared, held, estop, has_host, rate_hz).run()
        finally:
            bus.close()
    except HighFiveError as error:
        shared.say(str(error))
    shared.head["mode"][0] = Mode.ENDED


class _CycleLoop:
    """The process's state and its cycle."""

    def __init__(
        self,
        bus: ServoBus,
        rig: Rig,
        shared: CycleRing,
        held: Outbox,
        estop: Latch,
        has_host: Callable[[], bool],
        rate_hz: float,
    ):
        self._bus, self._rig, self._shared, self._held = bus, rig, shared, held
        self._estop, self._has_host, self._clock = estop, has_host, bus.clock
        self._period_ns = round(1e9 / rate_hz)
        self._joints = JointBus(bus, rig)
        self._engaged = False
        self._newest: tuple[JointCommand | None, int] = None, 0
        self._sent_ns = 0  # when the command that was sent last had been given
        self._braking: tuple[JointCommand, int] | None = None  # what holds it with full current, and since when
        self._mode = Mode.STARTING

    def run(self) -> None:
        """Cycles at their time."""
        self._joints.prepare()
        self._mode = Mode.READING
        due = self._clock.now()
        while not self._left and self._has_host():
            self._wait(due)
            due = self._paced(due)
            self._cycle(due)
            due += self._period_ns
            if (late := self._clock.now() - due) > self._period_ns:
                due += late // self._period_ns * self._period_ns
        if self._has_host():
            command, _ = self._newest
            self._joints.disarm_watchdog(None if command is None else command.currents)
        else:
            self._hold()  # then silence: the watchdogs stop the arm

    @property
    def _ending(self) -> bool:
        return bool(self._shared.head["end"][0])

    @property
    def _left(self) -> bool:
        """It has to end, and the arm is held as it is to be held for ever."""
        held = self._braking is None or self._newest[0] is None
        return self._ending and self._mode is not Mode.DRIVING and held

    @property
    def _alone(self) -> bool:
        """No command comes any more."""
        return self._ending or not self._has_host()

    def _wait(self, due: int) -> None:
        if self._mode in (Mode.STOPPED, Mode.READING):
            self._clock.wait_until(due)
        else:
            self._clock.wait_for(self._estop, due)

    def _paced(self, due: int) -> int:
        """When the cycle is due that keeps behind the host's commands: as it was, later for one that is late."""
        given = self._shared.head["given_ns"]
        if self._mode is not Mode.DRIVING:
            return due
        until = due + round(PATIENCE * self._period_ns)
        while int(given[0]) in (0, self._sent_ns) and self._clock.now() < until and not self._alone:
            if self._clock.wait_for(self._estop, self._clock.now() + _LOOK_NS):
                return due
        arrived = int(given[0])
        if arrived in (0, self._sent_ns):
            return min(until, self._clock.now())
        if arrived > due:
            return min(arrived, until)  # later than that is this process's own lateness
        return due - (round(NEARER * self._period_ns) if due - arrived > WAITED_NS else 0)

    def _cycle(self, due: int) -> None:
        begun = self._clock.now()
        try:
            try:
                sent = self._send()
            except PortError:
                raise
            except HighFiveError as error:
                self._stopped(str(error))
                sent = None
            state = self._joints.read()
            if self._engaged and self._mode != Mode.STOPPED and state.tripped.any():
                names = [joint.name for joint, trip in zip(self._rig.joints, state.tripped, strict=True) if trip]
                self._stopped(f"{', '.join(names)}: the watchdog stopped it, the bus was silent for too long")
                sent = self._hold()  # those that were not stopped
        except PortError as error:
            self._lost(error)
            return
        self._note(due, begun, sent, state)

    def _stopped(self, why: str) -> None:
        self._shared.say(why)
        self._mode = Mode.STOPPED

    def _send(self) -> JointCommand | None:
        """What is sent in this cycle, if anything."""
        if self._estop.pulled_ns is not None or self._mode == Mode.STOPPED:
            sent = self._hold() if self._mode != Mode.STOPPED else self._yield_to_hands()
            self._mode = Mode.STOPPED
            return sent
        if self._shared.head["engage"][0]:
            self._engage()
        if not self._engaged:
            return None
        command, given = self._newest_command()
        if command is None or self._ending or self._clock.now() - given > HOST_SILENT_NS:
            sent = self._leave() if self._mode == Mode.DRIVING else self._yield_to_hands()
            self._mode = Mode.HOLDING
            return sent
        self._mode, self._braking, self._sent_ns = Mode.DRIVING, None, given
        return self._joints.write(command)

    def _engage(self) -> None:
        """Torque on, everything read back, then the watchdogs armed: what takes long comes before."""
        first = not self._engaged
        if first:
            self._joints.engage()
            self._engaged, self._mode = True, Mode.HOLDING
        held = read_back(self._bus, self._rig, self._joints.feed)
        if first:
            self._joints.arm_watchdog()
            for servo, registers in held.items():
                self._joints.feed()
                registers["bus_watchdog"] = self._bus.read(servo, "bus_watchdog")
        self._shared.head["engage"][0] = 0
        self._held.send(held)

    def _newest_command(self) -> tuple[JointCommand | None, int]:
        """The newest command, and when it was given; None if there is none. Where a host was killed while it gave one,
        the one before holds."""
        self._newest = self._shared.command() or self._newest
        return self._newest

    def _hold(self) -> JointCommand | None:
        """The goal is where each joint stands; with full current: with less a moving arm goes 0.1 rad too far."""
        if not self._engaged:
            return None
        held = self._joints.hold()
        self._braking = held, self._clock.now()
        return held

    def _leave(self) -> JointCommand | None:
        """No command is followed any more. An arm at its goal keeps that: from where it stands it would sag more."""
        last, _ = self._newest
        if last is None or not self._joints.stands(STANDS, last.positions, SAGGED):
            return self._hold()
        self._braking = None
        return self._joints.write(last)

    def _yield_to_hands(self) -> JointCommand | None:
        """Once a held arm stands, the current of the last command holds it again: little, near a hand."""
        command, _ = self._newest
        if self._braking is None or command is None:
            return None
        held, since = self._braking
        if not self._joints.stands(STANDS) and self._clock.now() - since < BRAKING_NS:
            return None
        self._braking = None
        return self._joints.lower_currents(held, command.currents)

    def _lost(self, error: PortError) -> None:
        """The port is gone: tried again until it is back; then the arm is read, and driven only by a new process."""
        self._shared.say(str(error))
        self._mode = Mode.PORT_LOST
        self._shared.head["mode"][0] = self._mode
        self._braking = None
        while not self._ending and self._has_host():
            self._clock.wait_until(self._clock.now() + REOPEN_NS)
            try:
                self._bus.reopen()
                self._joints.read()
            except PortError:
                continue
            self._mode = Mode.STOPPED
            return

    def _note(self, due: int, begun: int, sent: JointCommand | None, state: JointState) -> None:
        """Leaves the cycle's row in the ring."""
        health = self._joints.health()
        nothing = np.full(len(self._rig.joints), np.nan)
        self._shared.note(
            self._mode, due, begun, state.time_ns - begun, sent is not None,
            nothing if sent is None else sent.positions, nothing if sent is None else sent.currents, state.time_ns,
            state.positions, state.velocities, state.currents, state.errors, state.answered, state.tripped,
            state.apart, health.time_ns, health.temperatures, health.voltages,
        )  # fmt: skip

"""What the arm's process does: a cycle of the bus in every period.

The process goes by the clock, and keeps its phase behind the host's, so that each command goes out once: where two
clocks of one rate run freely, a cycle repeats a command and the next one makes up for two, at twice the speed. Without
a command the cycle goes on, so that the servos hear from it and their watchdogs stay quiet. Once the host falls silent
or is gone, the arm is told to stay where it is, then nothing more, and the watchdogs do the rest. An emergency stop
wakes the process at once.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from highfive.hil.drivers.bus.cycle_ring import ROWS, CycleRing, Mode
from highfive.hil.drivers.bus.joint_bus import JointBus
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.rig_setup import read_back
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.bus.servo_port import PortError
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.priority import go_first
from highfive.hil.drivers.values import JointCommand, JointState
from highfive.model.errors import HighFiveError

HOST_SILENT_NS = 50_000_000
"""A host that gives no command for so long is taken for stalled: the arm is told to stay where it is, ns."""

STANDS, BRAKING_NS = 0.05, 300_000_000
"""rad/s: slower joints stand; ns: by then they do."""

SAGGED = 0.03
"""rad, as far as a joint stands off its goal by its own load; further off, a hand or a thing may be in its way."""

PATIENCE = 0.4
"""Of a period: so long a cycle waits for a command that is late. From half of one on it counts as missed."""

WAITED_NS, NEARER = 1_000_000, 0.02
"""ns: a command that was there longer before its cycle brings the next cycle nearer, by so much of a period."""

_LOOK_S = 3e-4  # between looks for a command that is late

REOPEN_S = 0.2
"""How often a lost port is tried again, s."""

_WRITING_NS = 1_000_000
"""So long a command that is being written is waited for, ns; then the one before holds. A host that was interrupted
may never finish it."""


def run_cycles(
    raw: Any, held: Connection, port: str, rig: Rig, rate_hz: float, estop: Latch, parent: int, allowance_ms: float
) -> None:
    """The other side, until it is told to end or the host is gone."""
    # The host's to handle, which stops the arm in order; SIGTSTP goes to the terminal's whole group.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    go_first()
    shared = CycleRing(raw, len(rig.joints))
    try:
        bus = ServoBus(port, rig.baud_rate, rig.models, allowance_ms)
        try:
            _CycleLoop(bus, rig, shared, held, estop, parent, rate_hz).run()
        finally:
            bus.close()
    except HighFiveError as error:
        shared.say(str(error))
    shared.head["mode"][0] = Mode.ENDED


class _CycleLoop:
    """The process's state and its cycle."""

    def __init__(
        self, bus: ServoBus, rig: Rig, shared: CycleRing, held: Connection, estop: Latch, parent: int, rate_hz: float
    ):
        self._bus, self._rig, self._shared, self._held = bus, rig, shared, held
        self._estop, self._parent = estop, parent
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
        due = time.monotonic_ns()
        while not self._left and os.getppid() == self._parent:
            self._wait(due)
            due = self._paced(due)
            self._cycle(due)
            due += self._period_ns
            if (late := time.monotonic_ns() - due) > self._period_ns:
                due += late // self._period_ns * self._period_ns
        if os.getppid() == self._parent:
            command, _ = self._newest
            self._joints.disarm_watchdog(None if command is None else command.currents)
        else:
            self._hold()  # then silence: the watchdogs stop the arm

    @property
    def _ending(self) -> bool:
        return bool(self._shared.head["end"][0])

    @property
    def _left(self) -> bool:
        """It is told to end, and the arm is held as it is to be held for ever."""
        held = self._braking is None or self._newest[0] is None
        return self._ending and self._mode is not Mode.DRIVING and held

    @property
    def _alone(self) -> bool:
        """No command comes any more."""
        return self._ending or os.getppid() != self._parent

    def _wait(self, due: int) -> None:
        left = 1e-9 * (due - time.monotonic_ns())
        if left <= 0.0:
            return
        if self._mode in (Mode.STOPPED, Mode.READING):
            time.sleep(left)
        else:
            self._estop.wait(left)

    def _paced(self, due: int) -> int:
        """When the cycle is due that keeps behind the host's commands: as it was, later for one that is late."""
        given = self._shared.head["given_ns"]
        if self._mode is not Mode.DRIVING:
            return due
        until = due + round(PATIENCE * self._period_ns)
        while int(given[0]) == self._sent_ns and time.monotonic_ns() < until and not self._alone:
            if self._estop.wait(_LOOK_S):
                return due
        arrived = int(given[0])
        if arrived == self._sent_ns:
            return min(until, time.monotonic_ns())
        if arrived > due:
            return min(arrived, until)  # later than that is this process's own lateness
        return due - (round(NEARER * self._period_ns) if due - arrived > WAITED_NS else 0)

    def _cycle(self, due: int) -> None:
        begun = time.monotonic_ns()
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
        wanted, given = self._wanted()
        if wanted is None or self._ending or time.monotonic_ns() - given > HOST_SILENT_NS:
            sent = self._leave() if self._mode == Mode.DRIVING else self._yield_to_hands()
            self._mode = Mode.HOLDING
            return sent
        self._mode, self._braking, self._sent_ns = Mode.DRIVING, None, given
        return self._joints.write(wanted)

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

    def _wanted(self) -> tuple[JointCommand | None, int]:
        """The newest command that is whole, and when it was given; None if there is none."""
        head = self._shared.head
        end = time.monotonic_ns() + _WRITING_NS
        while time.monotonic_ns() < end:
            before = int(head["written"][0])
            if before % 2 == 0:
                drive, given = bool(head["drive"][0]), int(head["given_ns"][0])
                command = JointCommand(head["positions"][0].copy(), head["currents"][0].copy())
                if int(head["written"][0]) == before:
                    self._newest = (command if drive else None), given
                    break
        return self._newest

    def _hold(self) -> JointCommand | None:
        """The goal is where each joint stands; with full current: with less a moving arm goes 0.1 rad too far."""
        if not self._engaged:
            return None
        held = self._joints.hold()
        self._braking = held, time.monotonic_ns()
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
        if not self._joints.stands(STANDS) and time.monotonic_ns() - since < BRAKING_NS:
            return None
        self._braking = None
        return self._joints.lower_currents(held, command.currents)

    def _lost(self, error: PortError) -> None:
        """The port is gone: tried again until it is back; then the arm is read, and driven only by a new process."""
        self._shared.say(str(error))
        self._mode = Mode.PORT_LOST
        self._shared.head["mode"][0] = self._mode
        self._braking = None
        while not self._ending and os.getppid() == self._parent:
            time.sleep(REOPEN_S)
            try:
                self._bus.reopen()
                self._joints.read()
            except PortError:
                continue
            self._mode = Mode.STOPPED
            return

    def _note(self, due: int, begun: int, sent: JointCommand | None, state: JointState) -> None:
        """Leaves the cycle's row in the ring."""
        head = self._shared.head
        number = int(head["rows"][0])
        row = self._shared.rows[number % ROWS : number % ROWS + 1]
        health = self._joints.health()
        nothing = np.full(len(self._rig.joints), np.nan)
        values: Sequence[Any] = (
            number, self._mode, due, begun, state.time_ns - begun, sent is not None,
            nothing if sent is None else sent.positions, nothing if sent is None else sent.currents, state.time_ns,
            state.positions, state.velocities, state.currents, state.errors, state.answered, state.tripped,
            state.apart, health.time_ns, health.temperatures, health.voltages,
        )  # fmt: skip
        for name, value in zip(row.dtype.names or (), values, strict=True):
            row[name][0] = value
        head["mode"][0] = self._mode
        head["rows"][0] = number + 1

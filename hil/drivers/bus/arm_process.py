"""The arm's bus in a process of its own: what waits for servos must not hold up whoever answers a person.

The two sides share a block of memory and never wait for each other. The newest command is a one-place mailbox; every
cycle leaves a row in a ring. The process goes by the clock, and keeps its phase behind the host's, so that each command
goes out once: where two clocks of one rate run freely, a cycle repeats a command and the next one makes up for two, at
twice the speed. Without a command the cycle goes on, so that the servos hear from it and their watchdogs stay quiet;
once the host falls silent or is gone, the arm is told to stay where it is, then nothing more, and the watchdogs do the
rest. An emergency stop wakes the process at once.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from highfive.hil.drivers.bus.joint_bus import JointBus
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.bus.rig_setup import read_back
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.drivers.bus.servo_port import ALLOWANCE_MS, PortError
from highfive.hil.drivers.latch import Latch
from highfive.hil.drivers.priority import go_first
from highfive.hil.drivers.values import JointCommand, JointHealth, JointState
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

ROWS = 1024
"""Cycles that the ring holds: eight seconds."""

_WRITING_NS = 1_000_000
"""So long a command that is being written is waited for, ns; then the one before holds. A host that was interrupted
may never finish it."""

_TEXT = 200  # bytes of the message about what is wrong


class Mode(IntEnum):
    """What the process is doing."""

    STARTING = 0
    READING = 1
    DRIVING = 2
    HOLDING = 3
    STOPPED = 4
    PORT_LOST = 5
    ENDED = 6


@dataclass(frozen=True)
class Cycle:
    """One cycle of the bus.

    Attributes:
        number: counted from 0.
        mode: of the process in it.
        due_ns, begun_ns: when it should have begun, and when it did, of the monotonic clock.
        took_ns: until all answers were there.
        sent: the goals that went out; None if none did.
        state: what the arm said.
        health: what its servos said of themselves.
    """

    number: int
    mode: Mode
    due_ns: int
    begun_ns: int
    took_ns: int
    sent: JointCommand | None
    state: JointState
    health: JointHealth


def _row_type(joints: int) -> np.dtype[Any]:
    each = (np.float64, (joints,))
    return np.dtype([
        ("number", np.int64), ("mode", np.int64), ("due_ns", np.int64), ("begun_ns", np.int64), ("took_ns", np.int64),
        ("is_sent", np.int64), ("sent_positions", *each), ("sent_currents", *each), ("time_ns", np.int64),
        ("positions", *each), ("velocities", *each), ("currents", *each), ("errors", np.int64, (joints,)),
        ("answered", np.int64, (joints,)), ("tripped", np.int64, (joints,)), ("apart", *each), ("health_ns", np.int64),
        ("temperatures", *each), ("voltages", *each),
    ])  # fmt: skip


def _head_type(joints: int) -> np.dtype[Any]:
    """What there is once: a number that is odd while a command is being written, the command, when it was given, how
    many rows are complete, whether to switch torque on and to end, what is wrong."""
    each = (np.float64, (joints,))
    return np.dtype([
        ("written", np.int64), ("given_ns", np.int64), ("positions", *each), ("currents", *each), ("drive", np.int64),
        ("rows", np.int64), ("mode", np.int64), ("engage", np.int64), ("end", np.int64), ("trouble", f"S{_TEXT}"),
    ])  # fmt: skip


class _Shared:
    """The block of memory that both sides see."""

    def __init__(self, raw: Any, joints: int):
        head = _head_type(joints)
        self.head = np.frombuffer(raw, dtype=head, count=1)
        self.rows = np.frombuffer(raw, dtype=_row_type(joints), count=ROWS, offset=head.itemsize)


def _size(joints: int) -> int:
    return _head_type(joints).itemsize + ROWS * _row_type(joints).itemsize


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
        self._raw = context.RawArray("b", _size(self._joints))
        self._shared = _Shared(self._raw, self._joints)
        self.estop = Latch() if estop is None else estop
        self._read, self._closed = 0, False
        self._held, theirs = context.Pipe(duplex=False)
        arguments = (self._raw, theirs, port, rig, rate_hz, self.estop, os.getpid(), allowance_ms)
        self._process = context.Process(target=_run, args=arguments, name=f"arm {port}", daemon=True)
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


def _run(
    raw: Any, held: Connection, port: str, rig: Rig, rate_hz: float, estop: Latch, parent: int, allowance_ms: float
) -> None:
    """The other side, until it is told to end or the host is gone."""
    # The host's to handle, which stops the arm in order; SIGTSTP goes to the terminal's whole group.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    go_first()
    shared = _Shared(raw, len(rig.joints))
    try:
        bus = ServoBus(port, rig.baud_rate, rig.models, allowance_ms)
        try:
            _Loop(bus, rig, shared, held, estop, parent, rate_hz).run()
        finally:
            bus.close()
    except HighFiveError as error:
        _say(shared, str(error))
    shared.head["mode"][0] = Mode.ENDED


def _say(shared: _Shared, text: str) -> None:
    shared.head["trouble"][0] = text.encode("utf-8")[:_TEXT]


class _Loop:
    """The process's state and its cycle."""

    def __init__(
        self, bus: ServoBus, rig: Rig, shared: _Shared, held: Connection, estop: Latch, parent: int, rate_hz: float
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
        _say(self._shared, why)
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
        _say(self._shared, str(error))
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

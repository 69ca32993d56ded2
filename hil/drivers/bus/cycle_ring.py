"""The memory that the host and the arm's process share: the newest command, and a ring of the last cycles.

What is more than one number is read and written under a lock of the operating system, which also orders memory on
processors that reorder it (ARM). Nobody waits long for it: whoever was killed may hold it for ever. Who was interrupted
may hold it until its next use.
"""

from __future__ import annotations

import threading
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from types import TracebackType
from typing import Any, Protocol

import numpy as np

from highfive.hil.drivers.values import JointCommand, JointHealth, JointState

ROWS = 8192
"""Cycles that the ring holds: a minute. A host that stands still for longer has lost the first of them."""

LOCKED_S = 1e-3
"""So long a side waits for the other to have read or written, s; then it goes on without."""

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


class Lock(Protocol):
    """An ``RLock`` of ``threading``, or of ``multiprocessing`` between processes."""

    def acquire(self, *, timeout: float) -> bool:
        """Whether it was had in time; who has it already, has it once more."""
        ...

    def release(self) -> None:
        """Gives it back once.

        Raises:
            RuntimeError, AssertionError: who calls has it not.
        """
        ...


class _Locked:
    """The lock, in a ``with`` that says whether it was had in time.

    Ctrl-C may be raised as ``acquire`` returns, before anything can note that the lock is had, and as ``release`` is
    called. So it is given back as often as it was had: what an interrupt has left behind, too. Not to be nested.
    """

    def __init__(self, lock: Lock) -> None:
        self._lock = lock

    def __enter__(self) -> bool:
        return self._lock.acquire(timeout=LOCKED_S)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with suppress(RuntimeError, AssertionError):
            while True:
                self._lock.release()


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
    """What there is once: the command, when it was given, the number after the last cycle's, whether to switch torque
    on and to end, what is wrong."""
    each = (np.float64, (joints,))
    return np.dtype([
        ("given_ns", np.int64), ("positions", *each), ("currents", *each), ("drive", np.int64),
        ("rows", np.int64), ("mode", np.int64), ("engage", np.int64), ("end", np.int64), ("trouble", f"S{_TEXT}"),
    ])  # fmt: skip


class CycleRing:
    """The block of memory that both sides see.

    Attributes:
        head: what there is once. Single numbers are read without the lock: each is whole, and none says that another
            is.
    """

    def __init__(self, raw: Any, joints: int, lock: Lock) -> None:
        """Over ``raw`` memory of :func:`ring_size` bytes; ``lock`` is one for both sides."""
        head = _head_type(joints)
        self.head = np.frombuffer(raw, dtype=head, count=1)
        self._rows = np.frombuffer(raw, dtype=_row_type(joints), count=ROWS, offset=head.itemsize)
        self._locked = _Locked(lock)
        self._noted = 0
        self._kept: deque[tuple[int, Mode, tuple[Any, ...]]] = deque(maxlen=ROWS)  # for which the lock was not had

    def leave(self) -> None:
        """The other side is gone: the system's lock is let go of, and one of this process is enough."""
        self._locked = _Locked(threading.RLock())

    def say(self, text: str) -> None:
        """What is wrong, for the host to read; what does not fit is cut off."""
        with self._locked:
            self.head["trouble"][0] = text.encode("utf-8")[:_TEXT]

    @property
    def trouble(self) -> str:
        """What was said last."""
        with self._locked:
            return bytes(self.head["trouble"][0]).decode("utf-8", "replace")

    def give(self, command: JointCommand, given_ns: int) -> bool:
        """Puts a command, given at ``given_ns``, in place of the last one; False where the driver stood in the way."""
        head = self.head
        with self._locked as locked:
            if locked:
                head["given_ns"][0] = 0  # an interrupt may cut this short
                head["positions"][0], head["currents"][0] = command.positions, command.currents
                head["drive"][0] = 1
                head["given_ns"][0] = given_ns
            return locked

    def command(self) -> tuple[JointCommand | None, int] | None:
        """The newest command and when it was given; None in its place before the first. None: there is no whole one."""
        head = self.head
        with self._locked as locked:
            if not locked or (head["drive"][0] and not head["given_ns"][0]):
                return None
            command = JointCommand(head["positions"][0].copy(), head["currents"][0].copy())
            return (command if head["drive"][0] else None), int(head["given_ns"][0])

    @property
    def count(self) -> int:
        """Cycles so far."""
        return int(self.head["rows"][0])

    def note(self, mode: Mode, *values: Any) -> None:
        """Adds a cycle: ``values`` as in the fields of a row from ``due_ns`` on; those that the reader stood in the way
        of go with the next one."""
        self._kept.append((self._noted, mode, values))
        self._noted += 1
        with self._locked as locked:
            while locked and self._kept:
                number, mode, values = self._kept[0]
                row = self._rows[number % ROWS : number % ROWS + 1]
                for name, value in zip(row.dtype.names or (), (number, mode, *values), strict=True):
                    row[name][0] = value
                self.head["mode"][0] = mode
                self.head["rows"][0] = number + 1
                self._kept.popleft()

    def cycles(self, start: int) -> list[Cycle]:
        """Those from number ``start`` on, oldest first; those that the ring no longer holds are left out."""
        with self._locked as locked:
            if not locked:
                return []
            count = self.count
            numbers = np.arange(max(start, count - ROWS), count)
            rows = self._rows[numbers % ROWS]  # at once: the driver waits meanwhile
        return [_cycle(row) for row in rows[rows["number"] == numbers]]


def _cycle(row: Any) -> Cycle:
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


def ring_size(joints: int) -> int:
    """Bytes that the two sides share."""
    return _head_type(joints).itemsize + ROWS * _row_type(joints).itemsize

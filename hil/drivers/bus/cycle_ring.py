"""The memory that the host and the arm's process share: the newest command, and a ring of the last cycles."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from highfive.hil.drivers.values import JointCommand, JointHealth, JointState

ROWS = 1024
"""Cycles that the ring holds: eight seconds."""

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


class CycleRing:
    """The block of memory that both sides see."""

    def __init__(self, raw: Any, joints: int) -> None:
        """Over ``raw`` memory of :func:`ring_size` bytes."""
        head = _head_type(joints)
        self.head = np.frombuffer(raw, dtype=head, count=1)
        self.rows = np.frombuffer(raw, dtype=_row_type(joints), count=ROWS, offset=head.itemsize)

    def say(self, text: str) -> None:
        """What is wrong, for the host to read; what does not fit is cut off."""
        self.head["trouble"][0] = text.encode("utf-8")[:_TEXT]


def ring_size(joints: int) -> int:
    """Bytes that the two sides share."""
    return _head_type(joints).itemsize + ROWS * _row_type(joints).itemsize

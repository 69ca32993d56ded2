"""The memory that host and driver share: a million exchanges between two processes, none of them torn."""

import multiprocessing
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pytest

from highfive.hil.drivers.bus import cycle_ring
from highfive.hil.drivers.bus.cycle_ring import ROWS, CycleRing, Mode, ring_size
from highfive.hil.drivers.values import JointCommand

JOINTS, EXCHANGES, READ_EVERY, INTERRUPTS, FEW = 6, 1_000_000, 64, 2000, 64


def row(number: int) -> tuple[Any, ...]:
    """A cycle of which every value says its number."""
    each = np.full(JOINTS, float(number))
    whole = np.full(JOINTS, number)
    return (number, number, number, True, each, each, number, each, each, each, whole, whole, whole, each, number,
            each, each)  # fmt: skip


def drive(raw: Any, lock: Any, found: Any) -> None:
    """The driver's side: takes commands and notes cycles until it is told to end."""
    ring, newest, strange, taken = CycleRing(raw, JOINTS, lock), 0, 0, 0
    number = 0
    while not ring.head["end"][0]:
        if (got := ring.command()) is not None and got[0] is not None:
            command, given = got
            strange += not ((command.positions == given).all() and (command.currents == -given).all())
            strange += given < newest
            taken += given > newest
            newest = given
        ring.note(Mode.DRIVING, *row(number))
        number += 1
    found.send((strange, taken, newest))


@contextmanager
def held_elsewhere(lock: Any) -> Iterator[None]:
    """The other side has the lock meanwhile."""
    held, done = threading.Event(), threading.Event()

    def hold() -> None:
        with lock:
            held.set()
            done.wait()

    other = threading.Thread(target=hold)
    other.start()
    held.wait()
    try:
        yield
    finally:
        done.set()
        other.join()


def test_cycles_that_the_reader_stood_in_the_way_of_are_not_lost() -> None:
    context = multiprocessing.get_context("spawn")
    raw, lock = context.RawArray("b", ring_size(JOINTS)), context.RLock()
    driver, host = CycleRing(raw, JOINTS, lock), CycleRing(raw, JOINTS, lock)
    driver.note(Mode.DRIVING, *row(0))
    with held_elsewhere(lock):
        for number in (1, 2, 3):
            driver.note(Mode.DRIVING, *row(number))
        assert driver.count == 1 and not host.give(JointCommand(np.zeros(JOINTS), np.zeros(JOINTS)), 5)
    driver.note(Mode.DRIVING, *row(4))
    assert [(cycle.number, cycle.begun_ns) for cycle in host.cycles(0)] == [(n, n) for n in range(5)]


def test_cycles_that_were_never_noted_are_missing_by_their_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cycle_ring, "ROWS", FEW)
    lock = threading.RLock()
    ring = CycleRing(bytearray(ring_size(JOINTS)), JOINTS, lock)
    ring.note(Mode.DRIVING, *row(0))
    with held_elsewhere(lock):
        for number in range(1, FEW + 11):
            ring.note(Mode.DRIVING, *row(number))
    ring.note(Mode.DRIVING, *row(FEW + 11))
    found = [cycle.number for cycle in ring.cycles(0)]
    assert found == list(range(12, FEW + 12))  # as many as are kept
    assert all(cycle.begun_ns == cycle.number for cycle in ring.cycles(FEW))


def test_an_interrupt_at_any_instant_leaves_the_lock_to_the_other_side() -> None:
    lock = multiprocessing.get_context("spawn").RLock()
    ring = CycleRing(bytearray(ring_size(JOINTS)), JOINTS, lock)
    command, left = JointCommand(np.zeros(JOINTS), np.zeros(JOINTS)), 0

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for _ in range(INTERRUPTS):
            with suppress(KeyboardInterrupt):
                signal.setitimer(signal.ITIMER_REAL, 0.0003)
                while True:
                    ring.give(command, 1)
            left += ours(lock)
            assert ring.give(command, 2)
            assert not ours(lock)  # not even what the interrupt had left behind
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert left  # it was met


def ours(lock: Any) -> bool:
    """This side has the lock; it has it as often as before afterwards."""
    try:
        lock.release()
    except AssertionError:
        return False
    return bool(lock.acquire())


@pytest.mark.slow(25)
def test_a_million_exchanges_tear_lose_and_reorder_nothing() -> None:
    context = multiprocessing.get_context("spawn")
    raw, lock = context.RawArray("b", ring_size(JOINTS)), context.RLock()
    ours, theirs = context.Pipe(duplex=False)
    driver = context.Process(target=drive, args=(raw, lock, theirs))
    driver.start()
    ring, start, seen = CycleRing(raw, JOINTS, lock), 0, 0
    try:
        number = gone = 0
        while gone + ring.count < EXCHANGES:  # commands that were given, cycles that were noted
            number += 1
            value = np.full(JOINTS, float(number))
            given = ring.give(JointCommand(value, -value), number)
            gone += given
            if number % READ_EVERY == 0:
                cycles = ring.cycles(start)
                # Only what the ring no longer holds may be missing.
                assert not cycles or cycles[0].number == start or len(cycles) == ROWS
                for cycle in cycles:
                    assert cycle.sent is not None
                    whole = (cycle.sent.positions, cycle.state.velocities, cycle.state.errors, cycle.health.voltages)
                    assert cycle.begun_ns == cycle.took_ns == cycle.health.time_ns == cycle.number
                    assert all((part == cycle.number).all() for part in whole), cycle
                    assert cycle.number == start or cycle is cycles[0]
                    start = cycle.number + 1
                seen += len(cycles)
        while not given:
            given = ring.give(JointCommand(value, -value), number)
        while (last := ring.command()) is None:  # the lock was not had in time
            pass
        assert last[1] == number
    finally:
        ring.head["end"][0] = 1
        driver.join(30.0)
    strange, taken, newest = ours.recv()
    assert strange == 0
    assert newest <= number and taken > 20 and seen > 1000  # of commands only the newest is taken

"""Virtual time: order, determinism, events, kills."""

import signal
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.runtime.virtual_clock import LOOK_NS, START_NS, TaskKilled, VirtualClock

MS = 1_000_000


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


@dataclass
class Bell:
    due_ns: int | None = None

    def fileno(self) -> int:
        raise OSError


@given(periods=st.lists(st.integers(1, 50), min_size=1, max_size=6), seed=st.integers(0, 9))
def test_tasks_run_in_the_order_of_their_times(periods: list[int], seed: int) -> None:
    woken: list[int] = []
    with VirtualClock(seed) as clock:

        def run(period: int) -> None:
            due = START_NS
            for _ in range(5):
                due += period * MS
                clock.wait_until(due)
                woken.append(due)

        for period in periods:
            clock.start(str(period), lambda period=period: run(period))
        clock.wait_until(START_NS + 300 * MS)
    assert len(woken) == 5 * len(periods)
    assert woken == sorted(woken)


def ties(seed: int) -> list[str]:
    order: list[str] = []
    with VirtualClock(seed) as clock:

        def run(name: str) -> None:
            for tick in range(20):
                clock.wait_until(START_NS + tick * MS)
                order.append(name)

        for name in "abc":
            clock.start(name, lambda name=name: run(name))
        clock.wait_until(START_NS + 50 * MS)
    return order


def test_a_seed_decides_who_goes_first_and_decides_it_again() -> None:
    assert ties(3) == ties(3)
    assert len({"".join(ties(seed)) for seed in range(5)}) == 5


def test_an_event_wakes_who_waits_for_it_at_its_time(clock: VirtualClock) -> None:
    bell, heard = Bell(), []
    clock.start("waits", lambda: heard.append((clock.wait_for(bell, START_NS + 100 * MS), clock.now())))
    clock.wait_until(START_NS + 5 * MS)
    bell.due_ns = START_NS + 20 * MS
    clock.wait_until(START_NS + 50 * MS)
    assert heard == [(True, START_NS + 20 * MS + LOOK_NS)]
    assert not clock.wait_for(Bell(), START_NS + 60 * MS)
    assert clock.now() == START_NS + 60 * MS + LOOK_NS


def test_who_polls_gets_on(clock: VirtualClock) -> None:
    end = clock.now() + MS
    looks = 0
    while clock.now() < end:
        looks += 1
    assert looks == MS // LOOK_NS - 1


def test_a_killed_task_does_nothing_that_takes_time(clock: VirtualClock) -> None:
    done: list[str] = []

    def run() -> None:
        try:
            clock.wait_until(START_NS + 1_000 * MS)
            done.append("slept")
        finally:
            with pytest.raises(TaskKilled):
                clock.spend(1)
            done.append("left")

    task = clock.start("killed", run)
    clock.spend(10 * MS)
    task.kill()
    assert not task.alive
    clock.spend(MS)
    assert done == ["left"]
    assert task.error is None


def test_an_interrupt_is_raised_where_a_task_waits_and_what_it_does_then_takes_its_time(clock: VirtualClock) -> None:
    done: list[int] = []

    def run() -> None:
        try:
            clock.wait_until(START_NS + 1_000 * MS)
        except KeyboardInterrupt:
            clock.spend(5 * MS)
            done.append(clock.now())
            raise

    task = clock.start("interrupted", run)
    clock.wait_until(START_NS + 10 * MS)
    task.interrupt(KeyboardInterrupt())
    clock.wait_until(START_NS + 30 * MS)
    assert done == [START_NS + 15 * MS + LOOK_NS]
    assert isinstance(task.error, KeyboardInterrupt) and not task.alive


def test_a_kill_or_an_interrupt_after_so_many_looks_comes_between_two_waits(clock: VirtualClock) -> None:
    for end in ("kill", "interrupt"):
        looks: list[int] = []

        def run(looks: list[int] = looks) -> None:
            clock.wait_until(clock.now() + MS)
            for _ in range(10):
                looks.append(clock.now())
            clock.wait_until(clock.now() + MS)

        task = clock.start("looks", run)
        clock.wait_until(clock.now() + MS // 2)
        error = KeyboardInterrupt()
        task.after_looks(4, task.kill if end == "kill" else lambda task=task, error=error: task.interrupt(error))
        clock.wait_until(clock.now() + 5 * MS)
        assert len(looks) == 3 and not task.alive
        assert task.error is (None if end == "kill" else error)


def test_a_task_that_is_held_sleeps_through_its_time(clock: VirtualClock) -> None:
    woken: list[int] = []

    def run() -> None:
        for due in (10, 20, 30):
            clock.wait_until(START_NS + due * MS)
            woken.append((clock.now() - START_NS) // MS)

    task = clock.start("held", run)
    clock.wait_until(START_NS + 5 * MS)
    task.hold(START_NS + 25 * MS)
    clock.wait_until(START_NS + 50 * MS)
    assert woken == [25, 25, 30]


def test_at_the_end_of_its_context_nothing_runs_any_more() -> None:
    with VirtualClock() as clock:
        task = clock.start("for ever", lambda: clock.wait_until(10**18))
        clock.spend(MS)
    assert not task.alive


def test_what_a_signal_raises_is_raised_in_the_first_task_whichever_it_comes_upon(clock: VirtualClock) -> None:
    other: list[str] = []

    def interrupted() -> None:
        clock.wait_until(START_NS + 5 * MS)
        signal.raise_signal(signal.SIGINT)
        clock.wait_until(START_NS + 9 * MS)
        other.append("went on")

    before = signal.getsignal(signal.SIGINT)
    with clock.signals_to_first([signal.SIGINT]):
        clock.start("other", interrupted)
        with pytest.raises(KeyboardInterrupt):
            clock.wait_until(START_NS + 50 * MS)
        assert clock.now() < START_NS + 6 * MS
        clock.wait_until(START_NS + 20 * MS)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)  # upon the first task itself
    assert other == ["went on"]
    assert signal.getsignal(signal.SIGINT) is before


def test_a_killed_task_gets_no_further_than_its_next_look_at_the_clock(clock: VirtualClock) -> None:
    looks = 0

    def run() -> None:
        nonlocal looks
        try:
            clock.wait_until(clock.now() + 10 * MS)
        finally:
            while True:
                clock.now()
                looks += 1

    task = clock.start("polls on its way out", run)
    clock.spend(MS)
    task.kill()
    clock.spend(MS)
    assert looks == 0 and not task.alive


def test_an_interrupt_that_comes_at_the_end_is_raised_once_nothing_runs_any_more() -> None:
    left = []

    def run(clock: VirtualClock) -> None:
        try:
            clock.wait_until(clock.now() + 1000 * MS)
        finally:
            left.append(clock)

    with pytest.raises(KeyboardInterrupt), VirtualClock() as clock:
        for number in range(3):
            clock.start(str(number), lambda: run(clock))
        clock.spend(MS)
        clock.first.interrupt(KeyboardInterrupt())
    assert len(left) == 3

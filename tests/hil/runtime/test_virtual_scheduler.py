"""Tasks that wake each other, in virtual time."""

import pytest

from highfive.hil.runtime.virtual_clock import LOOK_NS, START_NS, VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler

MS = 1_000_000
LOOKS_NS = 20 * LOOK_NS


def test_who_waits_for_a_condition_goes_on_when_it_holds_and_not_before() -> None:
    woken: list[tuple[bool, int]] = []
    with VirtualClock() as clock:
        scheduler, done = VirtualScheduler(clock), list[int]()
        condition = scheduler.condition()

        def wait() -> None:
            with condition:
                woken.append((condition.wait_for(lambda: len(done) > 1, 0.1), scheduler.now()))

        for name in ("one", "other"):
            scheduler.start(name, wait)
        assert [task.name for task in scheduler.tasks] == ["one", "other"]
        for at in (10, 20):
            clock.wait_until(START_NS + at * MS)
            done.append(at)
            with condition:
                condition.notify_all()
        clock.wait_until(START_NS + 30 * MS)
    assert [found for found, _ in woken] == [True, True]
    assert [when for _, when in woken] == pytest.approx([START_NS + 20 * MS] * 2, abs=LOOKS_NS)


def test_nobody_waits_longer_than_the_time_that_was_given() -> None:
    with VirtualClock() as clock:
        condition = VirtualScheduler(clock).condition()
        assert not condition.wait_for(lambda: False, 0.05)
        assert clock.now() == pytest.approx(START_NS + 50 * MS, abs=LOOKS_NS)
        assert condition.wait_for(lambda: True, 0.0)


def test_the_end_of_a_task_is_waited_for() -> None:
    with VirtualClock() as clock:
        task = VirtualScheduler(clock).start("short", lambda: clock.wait_until(START_NS + 30 * MS))
        task.join(0.01)
        assert clock.now() == pytest.approx(START_NS + 10 * MS, abs=LOOKS_NS)
        task.join(1.0)
        assert clock.now() == pytest.approx(START_NS + 30 * MS, abs=LOOKS_NS)
        task.join(1.0)
        assert clock.now() == pytest.approx(START_NS + 30 * MS, abs=2 * LOOKS_NS)


@pytest.mark.parametrize("begun", [False, True])
def test_a_task_that_is_killed_has_ended(begun: bool) -> None:
    with VirtualClock() as clock:
        scheduler = VirtualScheduler(clock)
        started = scheduler.start("killed", lambda: clock.wait_until(clock.now() + 10**9))
        if begun:
            clock.spend(1000)
        started.task.kill()
        before = clock.now()
        started.join(5.0)
        assert clock.now() - before < 100_000

"""A publisher in its thread: the session never waits, and what it loses is counted."""

import threading
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from recorded_trials import ticks_of
from trial_results import some_results

from highfive.hil.publish import background
from highfive.hil.publish.background import BackgroundPublisher
from highfive.hil.publish.publisher import ArmPosture, SessionEvent, ShownPicture
from highfive.hil.recording.recorded_tick import RecordedTick


@dataclass
class Slow:
    """Waits with each until it may go on; fails with what is to be raised."""

    waiting: int = 3
    name: str = "slow"
    may: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    began: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    heard: list[object] = field(default_factory=list)
    fails: Exception | None = None

    def tick(self, tick: RecordedTick) -> None:
        self._take(tick.at_ns)

    def event(self, event: SessionEvent) -> None:
        self._take(event.name)

    def shown(self, picture: ShownPicture) -> None:
        self._take(picture.shown.frame)

    def arm(self, posture: ArmPosture) -> None:
        self._take(posture.time_ns)

    def close(self) -> None:
        self.heard.append("closed")

    def _take(self, what: object) -> None:
        self.began.release()
        self.may.acquire()
        if self.fails is not None:
            raise self.fails
        self.heard.append(what)


@pytest.fixture(scope="module")
def tick() -> RecordedTick:
    return next(iter(ticks_of(some_results()[1])))


def at(tick: RecordedTick, number: int) -> RecordedTick:
    return replace(tick, at_ns=number)


def test_all_comes_in_order(tick: RecordedTick) -> None:
    slow = Slow(waiting=100)
    publisher = BackgroundPublisher(slow)
    slow.may.release(1000)
    for number in range(50):
        publisher.give(at(tick, number))
        publisher.give(SessionEvent(f"event {number}", number))
    publisher.close()
    publisher.give(at(tick, 99))
    assert slow.heard == [x for number in range(50) for x in (number, f"event {number}")] + ["closed"]
    assert publisher.dropped == 0 and not publisher.trouble


def test_of_too_many_the_oldest_ticks_are_left_out_but_no_event(
    tick: RecordedTick, caplog: pytest.LogCaptureFixture
) -> None:
    slow = Slow(waiting=3)
    publisher = BackgroundPublisher(slow)
    publisher.give(at(tick, 0))
    slow.began.acquire()  # it is busy with the first one
    for number in range(1, 8):
        publisher.give(at(tick, number))
        publisher.give(SessionEvent(f"event {number}", number))
    slow.may.release(1000)
    publisher.close()
    assert [x for x in slow.heard if isinstance(x, int)] == [0, 5, 6, 7]
    assert [x for x in slow.heard if isinstance(x, str)] == [*(f"event {n}" for n in range(1, 8)), "closed"]
    assert slow.heard.index("event 4") < slow.heard.index(5) < slow.heard.index("event 5")
    assert publisher.dropped == 4 and "4 ticks were left out" in caplog.text


def test_an_arm_comes_in_order_and_waits_for_a_publisher_that_hangs_no_longer_than_ticks_do(
    tick: RecordedTick, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background, "MOST", 4)
    slow = Slow(waiting=100)
    publisher = BackgroundPublisher(slow)
    publisher.give(at(tick, 0))
    slow.began.acquire()
    for number in range(1, 20):
        publisher.give(at(tick, 2 * number))
        publisher.give(ArmPosture(2 * number + 1, np.zeros(6)))
    slow.may.release(1000)
    publisher.close()
    assert slow.heard == [0, 2, 3, 4, 5, 6, 7, 8, "closed"]


def test_one_that_fails_is_told_of_once_and_closed(tick: RecordedTick, caplog: pytest.LogCaptureFixture) -> None:
    slow = Slow(fails=RuntimeError("the library\nbroke"))
    publisher = BackgroundPublisher(slow)
    slow.may.release(1000)
    for number in range(20):
        publisher.give(at(tick, number))
    publisher.close()
    assert publisher.trouble == "slow is published no more: the library broke" and slow.heard == ["closed"]
    assert caplog.text.count("published no more") == 1 and "the session goes on" in caplog.text


def test_one_that_hangs_is_left_behind(
    tick: RecordedTick, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(background, "CLOSE_S", 0.05)
    slow = Slow()
    publisher = BackgroundPublisher(slow)
    publisher.give(at(tick, 0))
    publisher.close()
    assert "slow does not end" in caplog.text
    slow.may.release(1000)

"""What a page was not sent is counted, over its sleep too."""

import threading
import time

import numpy as np
import pytest

from highfive.hil.bench.page_clients import Flood, Page, Seen
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.wire import PoseMessage


def seen(*numbers: int, before: int = 0) -> Seen:
    return Seen(numbers, (0.0,) * len(numbers), (0.0,) * len(numbers), before)


def test_dropped_are_those_in_between() -> None:
    assert seen(5, 6, 7).dropped == 0
    assert seen(5, 6, 9).dropped == 2
    assert seen(15, 16, before=4).dropped == 10


@pytest.mark.slow
def test_a_page_that_sleeps_is_sent_the_newest_and_the_others_are_counted() -> None:
    with LivePage({}, port=0) as page:
        shows, none = threading.Event(), np.zeros((1, 7))

        def show() -> None:
            while not shows.wait(0.004):
                now = time.monotonic_ns()
                page.show(PoseMessage(0, now, now, 0, 1.0, 0.0, none, np.zeros((1, 3)), np.ones(1, dtype=bool)))

        thread = threading.Thread(target=show)
        thread.start()
        try:
            woken = Page(page.address, 0.5, 1.0).seen()
        finally:
            shows.set()
            thread.join()
    assert woken.before > 0 and woken.dropped > 20
    assert woken.numbers[-1] - woken.before == len(woken.numbers) + woken.dropped


@pytest.mark.slow
def test_a_flood_sends_until_it_is_ended() -> None:
    with LivePage({"mode": "session"}, port=0) as page:
        flood, asked = Flood(page.address), 0
        end = time.monotonic() + 60.0
        while asked < 300 and time.monotonic() < end:
            asked += len(page.commands())
            time.sleep(0.01)
        sent = flood.end()
        assert page.alive
    assert asked >= 300 and sent.messages > 300

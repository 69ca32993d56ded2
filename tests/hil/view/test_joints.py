"""What a headset tracks on its way through the page's server: one headset at a time, and nothing that is none."""

import json
import time
from collections.abc import Iterator

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect

from highfive.hil.view.live_page import LivePage
from highfive.hil.view.worn import HELD_BACK_NS
from highfive.mocap_bridge.wire.headset import JOINTS, HeadsetPose, decode_headset, encode_headset


def message(number: int) -> bytes:
    nothing = np.zeros((2, JOINTS), dtype=bool)
    viewer = np.array([1.0, 0.0, 1.6, 1.0, 0.0, 0.0, 0.0])
    return encode_headset(
        HeadsetPose(
            number, 0, 1e3 * time.monotonic(), viewer, True, np.zeros((2, JOINTS, 3)), nothing, np.zeros((4, 3)),
            np.zeros(4, dtype=bool),
        )
    )  # fmt: skip


@pytest.fixture
def page() -> Iterator[LivePage]:
    with LivePage({"tracks": True}, port=0, tracks=True) as page:
        yield page


def look_on(page: LivePage) -> ClientConnection:
    return connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None)


def told(link: ClientConnection) -> list[str]:
    """What a page was told of headsets, once the server has taken all that it sent before."""
    link.send('{"kind": "time", "asked": 1}')
    found: list[str] = []
    while (text := json.loads(link.recv(20.0)))["kind"] != "time":
        found += [text["message"]] if text["kind"] == "headset" else []
    return found


def come(page: LivePage) -> list[int]:
    """Numbers of the messages that the server has handed on."""
    assert page.tracked is not None
    return [decode_headset(one).number for one in page.tracked.take()]


@pytest.mark.slow
def test_one_headset_at_a_time_and_the_next_one_after_it_has_left(page: LivePage) -> None:
    with look_on(page) as second:
        with look_on(page) as first:
            for number in range(3):
                first.send(message(number))
            assert told(first) == [] and come(page) == [0, 1, 2]
            for number in range(10, 13):
                second.send(message(number))
            assert told(second) == ["Another headset is tracked already: this one only shows."]
            first.send(message(3))
            assert told(first) == [] and come(page) == [3]
        left, number, taken = time.monotonic(), 20, []
        while not taken and time.monotonic() < left + 60.0:  # no one's hands are followed for a while
            second.send(message(number := number + 1))
            assert told(second) in ([], ["This headset is tracked now, in place of another one."])
            taken = come(page)
            time.sleep(0.05)
        assert taken == [number] and time.monotonic() >= left + 1e-9 * HELD_BACK_NS


@pytest.mark.slow
def test_what_is_no_message_of_a_headset_does_not_reach_the_host(page: LivePage) -> None:
    with look_on(page) as link:
        for other in (b"", message(1)[:-1], message(1) + b"\0", b"\x01" + message(1)[1:]):
            link.send(other)
        link.send(message(7))
        assert told(link) == [] and come(page) == [7]


@pytest.mark.slow
def test_nobody_asks_for_it_where_the_session_does_not() -> None:
    with LivePage({}, port=0) as page, look_on(page) as link:
        link.send(message(1))
        assert page.tracked is None and told(link) == []

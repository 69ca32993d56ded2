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


def come(page: LivePage, seconds: float = 1.0) -> list[int]:
    """Numbers of the messages that the host gets, until there is nothing for that long."""
    assert page.tracked is not None
    found: list[int] = []
    while data := page.tracked.wait(seconds):
        found += [decode_headset(one).number for one in data]
    return found


def told(link: ClientConnection, kind: str, seconds: float = 2.0) -> list[str]:
    found, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            text = json.loads(link.recv(0.3))
        except TimeoutError:
            break
        if text["kind"] == kind:
            found.append(text["message"])
    return found


def test_one_headset_at_a_time_and_the_next_one_after_it_has_left(page: LivePage) -> None:
    with look_on(page) as second:
        with look_on(page) as first:
            for number in range(3):
                first.send(message(number))
                time.sleep(0.02)
            assert come(page) == [0, 1, 2]
            for number in range(10, 13):
                second.send(message(number))
            first.send(message(3))
            assert come(page) == [3]
            assert told(second, "headset") == ["Another headset is tracked already: this one only shows."]
            assert told(first, "headset") == []
        time.sleep(1e-9 * HELD_BACK_NS + 0.3)
        second.send(message(20))
        assert come(page) == [20]


def test_what_is_no_message_of_a_headset_does_not_reach_the_host(page: LivePage) -> None:
    with look_on(page) as link:
        for other in (b"", message(1)[:-1], message(1) + b"\0", b"\x01" + message(1)[1:]):
            link.send(other)
        link.send(message(7))
        assert come(page) == [7]


def test_nobody_asks_for_it_where_the_session_does_not() -> None:
    with LivePage({}, port=0) as page, look_on(page) as link:
        link.send(message(1))
        assert page.tracked is None and told(link, "headset") == []

"""One headset at a time: a second one is refused while the first is there, and takes over, said, when it is gone."""

import json
import logging
import time
from contextlib import ExitStack, suppress

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect

from highfive.hil.session.session import Session
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import simulated_partners
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.session_view import SessionView
from highfive.hil.view.worn import HELD_BACK_NS, KEPT_NS, SILENT_NS, TAKEN, YOURS, Worn
from highfive.mocap_bridge.wire.headset import HeadsetPose, decode_headset, encode_headset
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model

SECOND = 1_000_000_000


def test_however_long_the_first_is_silent_the_second_waits_for_it_to_leave_and_then_a_while() -> None:
    worn = Worn()
    assert worn.takes(1, "hers", 0) == (True, 0, "")
    for now in range(1, 3600):
        worn.hears(1, now * SECOND)  # its page asks for the time: it only tracks nothing
        assert worn.takes(2, "his", now * SECOND) == (False, 0, TAKEN if now == 1 else "")  # told once
    assert worn.takes(1, "hers", 3601 * SECOND) == (True, 0, "")
    left = 3602 * SECOND
    worn.left(2, left)  # a page that was not tracked
    assert worn.takes(3, "", left) == (False, 0, TAKEN)
    worn.left(1, left)
    assert worn.takes(3, "", left + HELD_BACK_NS - 1) == (False, 0, "")
    assert worn.takes(3, "", left + HELD_BACK_NS) == (True, 1, YOURS)
    assert worn.takes(1, "hers", left + 2 * HELD_BACK_NS) == (False, 0, TAKEN)


def test_a_page_that_says_nothing_any_more_is_gone_whatever_its_connection_says() -> None:
    worn = Worn()
    worn.takes(1, "hers", 0)
    worn.hears(1, SECOND)
    worn.hears(2, 4 * SECOND)  # another page's
    assert worn.takes(2, "his", SECOND + SILENT_NS) == (False, 0, TAKEN)
    assert worn.takes(2, "his", SECOND + SILENT_NS + 1) == (False, 0, "")  # her place is kept for a while
    assert worn.takes(2, "his", SECOND + KEPT_NS) == (True, 1, YOURS)


def test_who_takes_the_headset_off_and_puts_it_on_again_goes_on_at_once() -> None:
    worn = Worn()
    worn.takes(1, "hers", 0)
    worn.left(1, SECOND)
    assert worn.takes(1, "hers", SECOND) == (True, 0, "")


@pytest.mark.parametrize("closed", [True, False], ids=["closed", "network gone"])
def test_a_page_that_connects_again_keeps_its_place_before_one_that_waits(closed: bool) -> None:
    worn = Worn()
    worn.takes(1, "hers", 0)
    assert worn.takes(2, "his", SECOND) == (False, 0, TAKEN)
    if closed:  # reloaded: until she has entered again his headset is not tracked
        worn.gone(1, 2 * SECOND)
    for now in range(3, 9):
        assert worn.takes(2, "his", now * SECOND) == (False, 0, "")
    assert worn.takes(3, "hers", 9 * SECOND) == (True, 0, "")
    # What is left of her earlier connection is hers no more.
    assert worn.takes(1, "hers", 10 * SECOND) == (False, 0, TAKEN)
    worn.gone(1, 11 * SECOND)
    assert worn.takes(3, "hers", 12 * SECOND) == (True, 0, "")


def test_pages_without_a_name_are_not_one_page() -> None:
    worn = Worn()
    worn.takes(1, "", 0)
    assert worn.takes(2, "", 1) == (False, 0, TAKEN)
    worn.gone(1, SECOND)
    assert worn.takes(2, "", SECOND + HELD_BACK_NS - 1) == (False, 0, "")
    assert worn.takes(2, "", SECOND + HELD_BACK_NS) == (True, 1, YOURS)


def pose(number: int, side: float) -> bytes:
    """A head at x = ``side``."""
    viewer = np.array([side, 0.0, 1.6, 1.0, 0.0, 0.0, 0.0])
    unseen = np.zeros((2, 25), dtype=bool)
    return encode_headset(
        HeadsetPose(
            number, 1, 1e3 * time.monotonic(), viewer, True, np.zeros((2, 25, 3)), unseen, np.zeros((4, 3)),
            np.zeros(4, dtype=bool),
        )
    )  # fmt: skip


def told(link: ClientConnection, kind: str) -> dict[str, object] | None:
    """The newest text of a kind that has come."""
    found = None
    with suppress(TimeoutError):
        while True:
            text = json.loads(link.recv(0.05))
            found = text if text["kind"] == kind else found
    return found


@pytest.mark.slow(25)
def test_the_session_and_the_page_say_that_another_headset_has_taken_over(caplog: pytest.LogCaptureFixture) -> None:
    scene = build_scene()
    session = Session(
        load_model(DEFAULT_MODEL), {"happy": 1.0}, simulated_partners(1, ("happy",), ("B2",), 0)[0].marker_set, scene
    )
    with LivePage({"mode": "session"}, port=0, tracks=True) as page, ExitStack() as stack:
        address = page.address.replace("http", "ws", 1).replace("/?", "/live?")
        first, second = (stack.enter_context(connect(address, compression=None)) for _ in range(2))
        view, tracked = SessionView(page, session, KinematicPlayOut(scene), scene), page.tracked
        assert tracked is not None
        first.send(pose(0, 0.25))
        came = tracked.wait(20.0)
        second.send(pose(0, 0.5))
        refused = None
        while refused is None:
            refused = told(second, "headset")
        assert refused["message"] == TAKEN and refused["refused"]
        first.send(json.dumps({"kind": "headset", "over": True}))  # out of VR; the page stays open
        number, taken = 1, None
        while taken is None:
            second.send(pose(number, 0.5))
            number, taken = number + 1, told(second, "headset")
            came += tracked.take()
        assert taken["message"] == YOURS and not taken["refused"]
        with caplog.at_level(logging.WARNING):
            view.begin(0, 2, "B2", {"happy": 1.0})
        lines = [record.getMessage() for record in caplog.records]
        assert any("headset of page 2 is tracked now, in place of that of page 1" in line for line in lines), lines
        came += tracked.wait(20.0)
    # Never one after the other's: first hers, then, once she is gone, the other's.
    heads = [float(decode_headset(data).viewer[0]) for data in came]
    assert heads == sorted(heads) and set(heads) == {0.25, 0.5}

"""A page that connects late, or again, has the last contacts; a participant's has none."""

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect

from highfive.hil.view.live_page import LivePage
from highfive.hil.view.server import CONTACTS
from highfive.hil.view.wire import PoseMessage
from highfive.model.errors import HighFiveError


@pytest.mark.slow
@pytest.mark.parametrize("role", ["", "&role=participant"])
def test_a_page_that_connects_is_told_the_last_contacts_in_order(role: str) -> None:
    with LivePage({"mode": "session"}, port=0) as page:
        for number in range(CONTACTS + 3):
            page.tell("contact", met=True, distance_m=1e-3 * number, style="happy", cell="B2")
        address = page.address.replace("http", "ws", 1).replace("/?", "/live?") + role
        for _ in range(2):  # and again
            with connect(address, compression=None) as link:
                texts = [json.loads(link.recv(20.0))]
                link.send('{"kind": "time", "asked": 1}')
                while texts[-1]["kind"] != "time":
                    texts.append(json.loads(link.recv(20.0)))
            told = [text for text in texts if text["kind"] == "contact"]
            assert [round(1e3 * text["distance_m"]) for text in told] == ([] if role else list(range(3, CONTACTS + 3)))
            assert [text["past"] for text in told] == ([] if role else [True] * (CONTACTS - 1) + [False])


@pytest.mark.slow
def test_who_connects_while_nothing_comes_is_told_whether_that_is_between_two_high_fives() -> None:
    still = PoseMessage(0, 1, 2, 0, 1.0, 0.0, np.ones((59, 7)), np.zeros((16, 3)), np.ones(16, dtype=bool))
    with LivePage({"mode": "session"}, port=0) as page, looks_on(page) as first:
        for moves in (False, True, False):  # after the contact
            page.tell("contact", met=True, distance_m=0.001, style="happy", cell="B2")
            while json.loads(first.recv(20.0))["kind"] != "contact":
                pass
            if moves:
                page.show(still)
                while isinstance(first.recv(20.0), str):
                    pass
            with connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None) as link:
                link.send('{"kind": "time", "asked": 1}')
                texts = [json.loads(link.recv(20.0))]
                while texts[-1]["kind"] != "time":
                    message = link.recv(20.0)
                    texts += [json.loads(message)] if isinstance(message, str) else []
            assert [text["past"] for text in texts if text["kind"] == "contact"][-1] is moves


@contextmanager
def looks_on(page: LivePage) -> Iterator[ClientConnection]:
    with connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None) as link:
        assert json.loads(link.recv(20.0))["kind"] == "hello"
        yield link


@pytest.mark.parametrize(
    "error, line",
    [
        (HighFiveError("the source went away"), "It ended early: the source went away."),
        (KeyboardInterrupt(), "It ended early."),
        (RuntimeError("of the inside"), "It ended early."),
    ],
)
@pytest.mark.slow
def test_who_looks_on_is_told_that_it_ended_early(error: BaseException, line: str) -> None:
    with ExitStack() as stack:
        with pytest.raises(type(error)), LivePage({"mode": "session"}, port=0) as page:
            link = stack.enter_context(looks_on(page))
            raise error
        texts = [json.loads(text) for text in link]  # until the server is gone
    assert [(text["kind"], text["message"]) for text in texts] == [("over", line)]


@pytest.mark.slow
def test_who_was_told_the_end_is_not_told_another() -> None:
    with ExitStack() as stack:
        with pytest.raises(HighFiveError), LivePage({"mode": "session"}, port=0) as page:
            link = stack.enter_context(looks_on(page))
            page.tell("over", message="all")
            raise HighFiveError("the report cannot be written")
        assert [json.loads(text)["message"] for text in link] == ["all"]

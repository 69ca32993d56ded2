"""While a person is waited for the page's buttons are heard, and the terminal says what is missing."""

import json
import logging
from collections.abc import Iterator

import pytest
from websockets.sync.client import ClientConnection, connect

from highfive.hil.commands.waiting import SAID_EVERY_S, Waiting
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.view.live_page import LivePage
from highfive.model.errors import HighFiveError


@pytest.fixture(scope="module")
def page() -> Iterator[LivePage]:
    with LivePage({"mode": "session"}, port=0) as opened:
        yield opened


@pytest.fixture
def link(page: LivePage) -> Iterator[ClientConnection]:
    address = page.address.replace("http", "ws", 1).replace("/?", "/live?")
    with connect(address, compression=None) as connection:
        assert json.loads(connection.recv(10.0))["kind"] == "hello"
        yield connection


def command(page: LivePage, link: ClientConnection, name: str, **value: object) -> None:
    """Asks for it, and waits until the host has been told: a time question is answered after what came before it."""
    link.send(json.dumps({"kind": "command", "name": name, **value}))
    link.send(json.dumps({"kind": "time", "asked": 1.0}))
    while True:
        message = link.recv(10.0)
        if isinstance(message, str) and json.loads(message)["kind"] == "time":
            return


def test_a_pause_takes_no_patience_and_other_wishes_are_kept(page: LivePage, link: ClientConnection) -> None:
    clock = VirtualClock()
    waiting = Waiting(page, 60.0, clock)
    command(page, link, "style", value={"angry": 1.0})
    command(page, link, "pause", value=True)
    assert waiting.look("nobody is here") and waiting.paused
    clock.wait_until(clock.now() + 600_000_000_000)
    assert waiting.look("nobody is here")
    command(page, link, "pause", value=False)
    assert waiting.look("nobody is here") and not waiting.paused
    clock.wait_until(clock.now() + 59_000_000_000)
    assert waiting.look("nobody is here")
    clock.wait_until(clock.now() + 2_000_000_000)
    assert not waiting.look("nobody is here")
    assert [kept.name for kept in page.commands()] == ["style"]


@pytest.mark.slow
def test_the_end_button_ends_it(page: LivePage, link: ClientConnection) -> None:
    waiting = Waiting(page, 60.0, VirtualClock())
    assert waiting.look("nobody is here")
    command(page, link, "end")
    with pytest.raises(HighFiveError, match="ended on the page before the first high five"):
        waiting.look("nobody is here")


@pytest.mark.slow
def test_the_terminal_says_now_and_then_what_is_missing(page: LivePage, caplog: pytest.LogCaptureFixture) -> None:
    clock = VirtualClock()
    waiting = Waiting(page, 120.0, clock)
    with caplog.at_level(logging.INFO):
        for _ in range(119 * 2):
            clock.wait_until(clock.now() + 500_000_000)
            assert waiting.look("nobody is here")
    assert len([line for line in caplog.messages if line.startswith("nobody is here (")]) == 119 // SAID_EVERY_S

"""What the page says to people: what a live person is to do, and how the session ended."""

import json
from pathlib import Path

import pytest
from websockets.sync.client import connect

from highfive.hil.commands.page import saying_to
from highfive.hil.commands.play_trials import Played, over_told
from highfive.hil.view.live_page import LivePage


@pytest.mark.parametrize("why", ["the arm was stopped: servo 4 (elbow): no answer", "ended on the page", ""])
def test_the_page_says_why_a_session_ended_early_and_where_its_report_is(why: str) -> None:
    told = over_told(Played(interrupted=bool(why), why=why), Path("out") / "session-1")
    assert why in told["message"] and ("early" in told["message"]) == bool(why) and "\n" not in told["message"]
    assert told["report"] == str(Path.cwd() / "out" / "session-1" / "report.html")


@pytest.mark.slow
def test_what_a_live_person_is_told_is_on_terminal_and_page(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    with LivePage({"mode": "session"}, port=0) as page:
        saying_to(page)("raise the right hand")
        saying_to(None)("for nobody")
        with connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None) as link:
            texts = [json.loads(link.recv(10.0)) for _ in range(2)]
    assert [text["kind"] for text in texts] == ["hello", "say"] and texts[1]["message"] == "Raise the right hand"
    assert caplog.messages == ["raise the right hand", "for nobody"]

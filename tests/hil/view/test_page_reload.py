"""A page that connects late, or again, has the last contacts; a participant's has none."""

import json

import pytest
from websockets.sync.client import connect

from highfive.hil.view.live_page import LivePage
from highfive.hil.view.server import CONTACTS


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
            told = [round(1e3 * text["distance_m"]) for text in texts if text["kind"] == "contact"]
            assert told == ([] if role else list(range(3, CONTACTS + 3)))

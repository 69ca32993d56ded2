"""A session whose page's server is ended goes on, says so, and waits for nobody."""

import json
import logging

import pytest
from websockets.sync.client import connect

from highfive.hil.session.session import Session
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import simulated_partners
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.session_view import SessionView
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model


def test_a_session_whose_server_is_ended_while_it_is_paused_goes_on_and_says_so(
    caplog: pytest.LogCaptureFixture,
) -> None:
    scene = build_scene()
    marker_set = simulated_partners(1, ("happy",), ("B2",), 0)[0].marker_set
    session = Session(load_model(DEFAULT_MODEL), {"happy": 1.0}, marker_set, scene)
    with LivePage({"mode": "session"}, port=0) as page:
        view = SessionView(page, session, KinematicPlayOut(scene), scene)
        with connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None) as link:
            link.send('{"kind": "command", "name": "pause", "value": true}')
            link.send('{"kind": "command", "name": "correct", "value": false}')
            link.send('{"kind": "time", "asked": 1}')
            while "asked" not in str(link.recv(10.0)):
                pass
        page._process.kill()
        page._process.join()
        with caplog.at_level(logging.INFO):
            for number in range(2):
                view.begin(number, 2, "B2", {"happy": 1.0})  # does not wait
        assert [record.getMessage() for record in caplog.records if "goes on without it" in record.getMessage()] != []
        assert sum("goes on without it" in record.getMessage() for record in caplog.records) == 1
        assert not view.corrects  # what was asked before is done


def test_a_session_that_ends_before_it_is_through_says_why_on_the_page() -> None:
    scene = build_scene()
    marker_set = simulated_partners(1, ("happy",), ("B2",), 0)[0].marker_set
    session = Session(load_model(DEFAULT_MODEL), {"happy": 1.0}, marker_set, scene)
    with LivePage({"mode": "session"}, port=0) as page:
        view = SessionView(page, session, KinematicPlayOut(scene), scene)
        view.begin(0, 2, "B2", {"happy": 1.0})
        view.ends("the arm was stopped: tested", stopped=True)
        with connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None) as link:
            while (text := json.loads(link.recv(10.0)))["kind"] != "state":  # also who comes only now is told
                pass
    assert text["message"] == "The arm was stopped: tested" and text["stopped"] and text["trials"] == 2

"""A session whose page's server is ended goes on, says so, and waits for nobody."""

import json
import logging

import numpy as np
import pytest
from websockets.sync.client import connect

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.session.session import Session, Tick
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import simulated_partners
from highfive.hil.trials.trial import run_trial
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.session_view import STATES_EVERY, SessionView
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_page_with_an_arm_has_its_plate_and_why_it_was_stopped_at_once() -> None:
    scene, folder = build_scene(), find_arm(DEFAULT_ARM)
    (partner,) = simulated_partners(1, ("happy",), ("B2",), 0)
    session = Session(load_model(DEFAULT_MODEL), {"happy": 1.0}, partner.marker_set, scene)
    joints, troubles, people = np.array(folder.ready), [""], []
    playout = KinematicPlayOut(scene)
    with LivePage({"mode": "session"}, port=0) as page:
        view = SessionView(
            page, session, playout, scene, arm=lambda: (joints, joints), rig=DEFAULT_ARM, trouble=lambda: troubles[0]
        )
        view.begin(0, 1, "B2", {"happy": 1.0})

        def watch(tick: Tick) -> None:
            troubles[0] = "tested" if len(people) >= 100 else ""
            people.append(tick.person.palm.position)
            view.watch(tick)

        run_trial(0, partner, session, playout, watch=watch)
        with connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None) as link:
            while (text := json.loads(link.recv(10.0)))["kind"] != "state":
                pass
    assert text["stopped"] and text["message"] == "The arm was stopped: tested"
    plate = default_arm().plate_at(joints).position
    distances = [float(np.linalg.norm(plate - palm)) for palm in people]
    assert min(abs(text["plate_m"] - distance) for distance in distances[-2 * STATES_EVERY :]) < 1e-3

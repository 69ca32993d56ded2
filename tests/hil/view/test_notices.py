"""What is amiss is read across the page for as long as it holds, and no word of it hides or outlives another."""

import json
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from highfive.hil.sim.scene import build_scene
from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.recorded import recorded_trials
from highfive.hil.view.wire import PoseMessage

pytestmark = [pytest.mark.slow, pytest.mark.skipif(browser_here() is None, reason="no Chromium here")]
SHOWN = "new Promise(r => {{const t = setInterval(() => {{if ({}) {{clearInterval(t); r(true)}}}}, 50)}})"
STATE = {"trial": 0, "trials": 2, "weights": {"happy": 1.0}, "paused": False, "time_s": 0.0}


@pytest.fixture(scope="module")
def pose() -> PoseMessage:
    trial = recorded_trials(SHIPPED_RECORDING, build_scene())[1]
    return PoseMessage(0, 1, 2, 0, 1.0, 0.0, trial.bodies[60], trial.markers[60], trial.seen[60])


@pytest.fixture
def browser() -> Iterator[Browser]:
    with Browser((800, 600)) as opened:
        yield opened


def until(browser: Browser, condition: str) -> None:
    assert browser.evaluate(SHOWN.format(condition))


def reads(browser: Browser, text: str) -> None:
    until(browser, f"document.getElementById('notice').textContent === {json.dumps(text)}")
    assert browser.evaluate("document.getElementById('notice').hidden") is (text == "")


def opened(browser: Browser, page: LivePage) -> None:
    browser.go(page.address)
    until(browser, "window.highfive?.connection.synchronised")


def test_a_reason_is_read_again_when_a_worse_one_is_over(browser: Browser) -> None:
    about = {"mode": "session", "title": "", "emotions": [], "cells": []}
    lost = "The connection is lost; this page tries again by itself."
    with LivePage(about, port=0) as page:
        opened(browser, page)
        reads(browser, "")
        page.tell("state", **STATE, message="The arm was stopped.")
        reads(browser, "The arm was stopped.")
        port, key = page.port, page.address.rpartition("=")[2]
    reads(browser, lost)
    with LivePage({**about, "cut": True, "mode": "recording"}, port=port, key=key) as page:
        reads(browser, "This recording has no end: it was cut short.")
        page.tell("headset", message="Another headset is tracked already: this one only shows.", refused=True)
        reads(browser, "Another headset is tracked already: this one only shows.")
        page.tell("headset", message="This headset is tracked now, in place of another one.", refused=False)
        reads(browser, "This recording has no end: it was cut short.")
        page.tell("over", message="The session is over.")
        reads(browser, "The session is over.")
    time.sleep(1.0)  # nothing is said of a connection that is meant to be closed
    reads(browser, "The session is over.")


def test_until_people_are_there_the_page_says_that_they_are_loading(browser: Browser, pose: PoseMessage) -> None:
    slow = """const there = fetch;
      window.fetch = (what, ...more) => String(what.url || what).endsWith("skin.glb")
        ? new Promise((go) => { window.arrive = go; }).then(() => there(what, ...more)) : there(what, ...more);"""
    browser.call("Page.addScriptToEvaluateOnNewDocument", source=slow)
    with LivePage({"mode": "session", "title": "", "emotions": [], "cells": []}, port=0) as page:
        page.show(pose)
        opened(browser, page)
        until(browser, "window.arrive && document.getElementById('link').textContent.trim() === 'loading'")
        browser.evaluate("window.arrive()")
        until(browser, "document.getElementById('link').textContent.trim() === 'no new poses'")
        assert browser.evaluate("highfive.stage.ready")


def test_a_recording_whose_next_high_five_is_being_read_waits(browser: Browser, pose: PoseMessage) -> None:
    with LivePage({"mode": "recording", "title": ""}, port=0) as page:
        opened(browser, page)
        page.tell("state", trial=0, trials=2, style="happy", time_s=1.0, length_s=1.0, playing=True, speed=1.0)
        page.show(pose)  # amid a high five nothing comes any more
        until(browser, "document.getElementById('link').textContent.trim() === 'no new poses'")
        page.show(replace(pose, rate=0.0))  # at its end
        until(browser, "document.getElementById('link').textContent.trim() === 'waiting'")


def test_a_page_that_is_reloaded_while_nothing_comes_says_so(browser: Browser, pose: PoseMessage) -> None:
    with LivePage({"mode": "session", "title": "", "emotions": [], "cells": []}, port=0) as page:
        page.tell("contact", met=True, distance_m=0.002, style="happy", cell="B2")
        page.show(pose)  # a high five has begun, and its source has gone silent
        opened(browser, page)
        until(browser, "document.getElementById('link').textContent.trim() === 'no new poses'")
        page.tell("contact", met=True, distance_m=0.002, style="happy", cell="B2")
        until(browser, "document.getElementById('link').textContent.trim() === 'waiting'")
        opened(browser, page)  # again, between two high fives
        until(browser, "document.getElementById('link').textContent.trim() === 'waiting'")


def test_a_recording_of_a_left_hand_is_shown_behind_the_mirror(browser: Browser, pose: PoseMessage) -> None:
    about = {"mode": "recording", "title": "", "emotions": [], "cells": [], "hand": "left"}
    with LivePage(about, port=0) as page:
        opened(browser, page)
        until(browser, "highfive.stage?.ready")
        page.show(pose)
        until(browser, "highfive.motion.newest")
        names = browser.evaluate("highfive.stage.names")
        right, left = names.index("right_wrist"), names.index("left_wrist")
        shown = browser.evaluate(f"Array.from(highfive.motion.newest.bodies.slice({7 * left}, {7 * left + 3}))")
        x, y, z = pose.bodies[right, :3]
        assert shown == pytest.approx([x, -y, z], abs=1e-5)

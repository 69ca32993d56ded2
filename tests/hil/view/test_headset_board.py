"""An experiment in a headset: she reads, answers and rates on a board, by pinch or trigger of an emulated one."""

import json
import time
from typing import Any

import pytest
from test_experiment_page import ABOUT, asked, until
from test_headset import DEVICE, LOADED, emulator, enter

from highfive.hil.view.browser import Browser
from highfive.hil.view.live_page import LivePage

__all__ = ["emulator"]

POINT = """(name => new Promise(done => {
const {board} = highfive.headset, place = board.places.find(one => one.name === name), {width, height} = board.canvas;
const wide = board.geometry.parameters.width, tall = board.geometry.parameters.height;
const at = board.localToWorld(board.position.clone().set(
((place.x + place.wide / 2) / width - 0.5) * wide, (0.5 - (place.y + place.tall / 2) / height) * tall, 0));
const from = board.position.clone().set(0.5, 1.2, 0.1);
const look = highfive.stage.camera.clone();
look.position.copy(from); look.up.set(0, 1, 0); look.lookAt(at);
for (const held of [headset.controllers.right, headset.hands.right]) {
held.position.set(from.x, from.y, from.z);
held.quaternion.set(look.quaternion.x, look.quaternion.y, look.quaternion.z, look.quaternion.w); }
const t = setInterval(() => { if (board.pointed.includes(name)) { clearInterval(t); done(true); } }, 20);
}))(%s)"""
PRESS = {
    "controller": "headset.controllers.right.updateButtonValue('trigger', {})",
    "hand": "headset.hands.right.updatePinchValue({})",
}
NAMES = "highfive.headset.board.places.map(one => one.name)"


def choose(browser: Browser, name: str, by: str) -> None:
    """Points there, and pinches, or pulls the trigger."""
    assert browser.evaluate(POINT % json.dumps(name))
    for value in (1, 0):
        browser.evaluate(PRESS[by].format(value))
        browser.evaluate("new Promise(done => setTimeout(done, 120))")


def check_pages(page: LivePage, browser: Browser, by: str) -> None:
    """What does not fit on the board is turned page by page: nothing lies beyond its edge."""
    many = [{**ABOUT["sliders"][0], "name": f"s{n}"} for n in range(9)]
    page.tell("experiment", **{**ABOUT, "sliders": many, "instructions": "Read this.\n\n" + "- a word\n" * 60})
    page.tell("participant", phase="ready", first=True, practice=False, task="go")
    until(browser, "highfive.headset.board.phase === 'ready '")
    pages = 0
    while browser.evaluate(NAMES) == ["More"]:
        choose(browser, "More", by)
        pages += 1
    assert pages >= 1 and browser.evaluate(NAMES) == ["Go on"]
    page.tell("participant", phase="question", asks="rate", answer="neutral", until_ms=1e9)
    until(browser, "highfive.headset.board.phase === 'question rate'")
    rated = 0
    while "Done" not in (names := browser.evaluate(NAMES)):
        rated += len(names) // 7
        choose(browser, "More", by)
    assert rated + len(names) // 7 == 9
    inside = "highfive.headset.board.places.every(one => one.y + one.tall <= highfive.headset.board.canvas.height)"
    assert browser.evaluate(inside)


@pytest.mark.slow
@pytest.mark.parametrize("by", ["controller", "hand"])
def test_she_begins_answers_and_rates_without_taking_it_off(emulator: str, by: str) -> None:
    about: dict[str, Any] = {"mode": "experiment", "title": "small", "emotions": [], "cells": []}
    with LivePage(about, port=0) as page, Browser((640, 360)) as browser:
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=emulator + DEVICE)
        browser.go(f"{page.address}&role=participant")
        assert browser.evaluate(LOADED)
        browser.evaluate("highfive.stage.renderer.render = () => {}")
        browser.evaluate(f"headset.primaryInputMode = '{by}'")
        until(browser, "window.highfive?.experiment?.participant")
        page.tell("experiment", **ABOUT)
        enter(browser, "immersive-vr")
        page.tell("participant", phase="ready", first=True, practice=False, task="go")
        until(browser, "highfive.headset.board.visible && highfive.headset.board.places.length === 1")
        # Before her: eyes at (0.3, 1.62, 0.2) look along -z.
        assert browser.evaluate("highfive.headset.board.position.toArray()") == pytest.approx(
            [0.3, 1.52, -0.75], abs=0.02
        )
        choose(browser, "Go on", by)
        assert asked(page, 1) == [("ready", None)]
        page.tell("participant", phase="cue", task="go")
        until(browser, "!highfive.headset.board.visible && highfive.headset.spoken.visible")
        assert browser.evaluate("highfive.headset.spoken.text") == "Go"
        page.tell("participant", phase="question", asks="answer", answer="", until_ms=1e9)
        until(browser, "highfive.headset.board.visible && highfive.headset.board.places.length === 2")
        assert browser.evaluate(NAMES) == ["angry", "neutral"]  # by their keys
        before = time.monotonic_ns()
        choose(browser, "neutral", by)
        after = time.monotonic_ns()
        [(name, value)] = asked(page, 1)
        assert name == "answer" and isinstance(value, dict) and value["key"] == "2"
        assert before - 2e7 < 1e6 * value["at_ms"] < after + 2e7
        page.tell("participant", phase="question", asks="rate", answer="neutral", until_ms=1e9)
        until(browser, "highfive.headset.board.places.length === 8")
        choose(browser, "natural 5", by)
        choose(browser, "Done", by)
        assert asked(page, 2) == [("rate", {"name": "natural", "value": 6.0}), ("done", None)]
        check_pages(page, browser, by)
        page.tell("participant", phase="pause")
        until(browser, "highfive.headset.board.visible && highfive.headset.board.places.length === 0")
        assert not browser.console

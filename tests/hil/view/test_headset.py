"""The page in a headset, played by an emulated one (iwer) in Chromium."""

import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_address import page_address

from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.wire import PoseMessage
from highfive.mocap_bridge.wire.headset import HeadsetPose, decode_headset
from highfive.model.geometry import rotations

IWER = "iwer@2.5.0"
DEVICE = """
;window.headset = new IWER.XRDevice(IWER.metaQuest3);
headset.installRuntime({forceInstall: true});
headset.position.set(0.3, 1.62, 0.2);
headset.primaryInputMode = 'hand';
"""
READY = """new Promise(done => {const look = setInterval(() => {
if (window.highfive?.stage?.ready && highfive.counts.poses > 5) {clearInterval(look); done(true)}}, 100)})"""
HIGH_FIVES = """
headset.position.set(0, 1.65, 0);
highfive.stage.renderer.render = () => {};  // drawing is not what is tested, and slow without a graphics card
const ease = s => s * s * s * (10 - 15 * s + 6 * s * s);
const rest = [0.25, 1.05, -0.2], out = [0.14, 1.42, -0.52];
setInterval(() => {
  const t = (performance.now() / 1000) % 4;
  const s = t < 1.5 || t > 3.2 ? 0 : t < 2.2 ? ease((t - 1.5) / 0.7) : t < 2.4 ? 1 : 1 - ease((t - 2.4) / 0.8);
  const at = rest.map((r, i) => r + s * (out[i] - r) + 0.0005 * Math.random());
  headset.hands.right.position.set(...at);
  headset.hands.right.quaternion.set(Math.SQRT1_2, 0, 0, Math.SQRT1_2);  // fingers up, palm to the avatar
}, 4);
"""
LOADED = """new Promise(done => {const look = setInterval(() => {
if (window.highfive?.stage?.ready && highfive.connection.synchronised && document.querySelector('[data-mode]')) {
clearInterval(look); done(true)}}, 100)})"""
WAIT = "new Promise(done => setTimeout(done, {}))"


@pytest.fixture(scope="module")
def emulator(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Source of the emulated headset."""
    if browser_here() is None or shutil.which("npm") is None:
        pytest.skip("no Chromium or no npm here")
    folder = tmp_path_factory.mktemp("iwer")
    install = ["npm", "install", "--no-audit", "--no-fund", "--no-save", "--ignore-scripts", "--prefix", folder, IWER]
    if subprocess.run([str(part) for part in install], capture_output=True, check=False).returncode:
        pytest.skip("npm cannot fetch anything here")
    return (folder / "node_modules" / "iwer" / "build" / "iwer.min.js").read_text(encoding="utf-8")


@pytest.fixture
def worn(emulator: str) -> Iterator[Browser]:
    """The page of the recording that comes along, ready to be entered."""
    command = [sys.executable, "-m", "highfive.hil.cli.main", "view", "--no-open"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process, Browser((1000, 560)) as browser:
        assert process.stderr is not None
        address = next(found[0] for line in process.stderr if (found := re.search(r"http://\S+", line)))
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=emulator + DEVICE)
        browser.go(address)
        assert browser.evaluate(READY)
        yield browser
        process.kill()


class Session:
    """A session that follows a headset, and its page."""

    def __init__(self, emulator: str, *arguments: object) -> None:
        command = [sys.executable, "-m", "highfive.hil.cli.main", "simulate", "--source", *map(str, arguments)]
        self.process = subprocess.Popen(
            [*command, "--no-open", "--no-pictures", "--json"],
            stderr=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.address, self.said = page_address(self.process)
        self.emulator = emulator

    def put_on(self, browser: Browser) -> None:
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=self.emulator + DEVICE)
        browser.go(self.address)
        assert browser.evaluate(LOADED)

    def end(self, seconds: float = 120.0) -> tuple[int, str, str]:
        out, said = self.process.communicate(timeout=seconds)
        return self.process.returncode, out, "".join(self.said) + said


def enter(browser: Browser, mode: str) -> None:
    browser.evaluate(f"document.querySelector('[data-mode={mode}]').click()")
    browser.evaluate(WAIT.format(2500))
    assert browser.evaluate("Boolean(highfive.headset.session)")


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["immersive-vr", "immersive-ar"])
def test_the_avatar_stands_before_her_and_she_leaves(worn: Browser, mode: str) -> None:
    enter(worn, mode)
    seen = json.loads(
        worn.evaluate(
            "(() => {const {stage} = highfive, v = stage.veil.position;"
            "stage.place.updateMatrixWorld(true);"
            "const at = name => { const e = stage.bodies[stage.names.indexOf(name)].matrixWorld.elements;"
            "return [e[12], e[13], e[14]]; };"
            "return JSON.stringify({eyes: [v.x, v.y, v.z], pelvis: at('pelvis'), head: at('head'),"
            "hers: stage.hers.some(m => m.layers.isEnabled(0)), room: stage.room.some(m => m.visible)})})()"
        )
    )
    x, y, z = seen["pelvis"]
    # Before her, at an arm's length, upright on her floor; its head a head's height above its neck.
    assert abs(x - 0.3) < 0.15 and 0.7 < 0.2 - z < 1.3 and 0.75 < y < 1.1
    assert 1.4 < seen["head"][1] < 1.8
    assert not seen["hers"] and seen["room"] is (mode == "immersive-vr")
    floating = "highfive.stage.signs.markers.visible"
    assert worn.evaluate(floating) is False  # they are on her own arm, before her eyes
    # What each eye's own camera lets through, which is less than what the page's camera does.
    eyes_see = worn.evaluate(
        "highfive.stage.renderer.xr.getCamera().cameras.map(eye => ['room', 'hers'].map(kind =>"
        "highfive.stage[kind].filter(m => m.visible && m.layers.test(eye.layers)).length))"
    )
    count = worn.evaluate("highfive.stage.room.length")
    assert eyes_see and all(room == (count if mode == "immersive-vr" else 0) for room, _ in eyes_see), eyes_see
    assert all(hers == 0 for _, hers in eyes_see)
    assert seen["eyes"] == pytest.approx([0.3, 1.62, 0.2], abs=0.01)
    worn.evaluate(f"highfive.headset.session.end().then(() => {WAIT.format(1500)})")
    after = json.loads(
        worn.evaluate(
            "JSON.stringify([Boolean(highfive.headset.session), highfive.stage.immersed,"
            "highfive.stage.place.position.x,"
            "highfive.stage.room.some(m => m.visible), highfive.stage.hers.every(m => m.layers.isEnabled(0)),"
            "highfive.stage.room.filter(m => m.layers.isEnabled(0) && !/pot|leaf/.test(m.name)).length])"
        )
    )
    assert after == [False, False, 0, True, True, 0]
    assert worn.evaluate(floating) is True and worn.evaluate("highfive.stage.signs.markers.count > 0")
    assert not worn.console


@pytest.mark.slow
def test_hands_are_drawn_where_they_are_and_hidden_where_they_are_lost(worn: Browser) -> None:
    worn.evaluate("headset.hands.right.position.set(0.5, 1.4, -0.25)")
    enter(worn, "immersive-vr")
    shown = "highfive.headset.hands.map(hand => hand.visible)"
    assert worn.evaluate(shown) == [True, True]
    wrist = worn.evaluate("Array.from(highfive.headset.hands[1].instanceMatrix.array.slice(12, 15))")
    assert wrist == pytest.approx([0.5, 1.4, -0.25], abs=0.15)
    # The source is there, its joints are not: how a headset says that it does not see the hands.
    worn.evaluate("XRFrame.prototype.getJointPose = () => null")
    worn.evaluate(WAIT.format(1000))
    assert worn.evaluate(shown) == [False, False]
    assert worn.evaluate("Boolean(highfive.headset.session)") and not worn.console


@pytest.mark.slow
def test_recentring_puts_the_avatar_before_her_again(worn: Browser) -> None:
    enter(worn, "immersive-vr")
    before = worn.evaluate("highfive.stage.place.position.toArray()")
    worn.evaluate("headset.position.set(-0.5, 1.6, 1.0); headset.recenter()")
    worn.evaluate(WAIT.format(1500))
    after = worn.evaluate("[highfive.headset.placed, ...highfive.stage.place.position.toArray()]")
    eyes = worn.evaluate("highfive.stage.renderer.xr.getCamera().position.toArray()")
    assert after[0] is True
    distance = ((after[1] - eyes[0]) ** 2 + (after[3] - eyes[2]) ** 2) ** 0.5
    assert distance == pytest.approx(1.0, abs=0.05), (before, after, eyes)


@pytest.mark.slow
def test_a_browser_without_a_headset_offers_none(emulator: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "highfive.hil.cli.main", "view", "--no-open"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process, Browser() as browser:
        assert process.stderr is not None
        browser.go(next(found[0] for line in process.stderr if (found := re.search(r"http://\S+", line))))
        assert browser.evaluate(READY)
        assert browser.evaluate("document.getElementById('headset').hidden") is True
        assert "This browser has WebXR, but finds no headset" in browser.evaluate(
            "document.getElementById('able').textContent"
        )
        process.kill()


@pytest.mark.slow(15)
def test_what_is_said_is_read_before_the_eyes_for_some_seconds_and_the_page_says_how_to_enter(emulator: str) -> None:
    about = {"mode": "session", "title": "", "emotions": [], "cells": [], "tracks": True}
    notice = "document.getElementById('notice').textContent"
    panel = (
        "(() => {const {spoken, stage} = highfive.headset, eyes = highfive.stage.renderer.xr.getCamera();"
        "return [spoken.visible, spoken.position.toArray(), eyes.cameras.every(eye => spoken.layers.test(eye.layers)),"
        "spoken.canvas.getContext('2d').getImageData(512, spoken.canvas.height - 75, 1, 1).data[3]]})()"
    )
    with LivePage(about, port=0, tracks=True) as page, Browser((640, 360)) as browser:
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=emulator + DEVICE)
        browser.go(page.address)
        assert browser.evaluate(LOADED)
        browser.evaluate("highfive.stage.renderer.render = () => {}")
        browser.evaluate(WAIT.format(300))
        assert browser.evaluate(notice) == "Put the headset on, and press Enter VR or Enter AR here."
        enter(browser, "immersive-vr")
        assert browser.evaluate("document.getElementById('notice').hidden") is True
        assert browser.evaluate(panel)[0] is False
        page.tell("say", message="High five 1, neutral: raise the right hand")
        browser.evaluate(WAIT.format(1000))
        visible, place, both_eyes, ink = browser.evaluate(panel)
        # Eyes at (0.3, 1.62, 0.2) look along -z.
        assert visible and both_eyes and ink > 200 and place == pytest.approx([0.3, 1.96, -0.8], abs=0.02)
        assert browser.evaluate("document.getElementById('spoken').textContent").startswith("High five 1")
        browser.evaluate(WAIT.format(7500))
        assert browser.evaluate(panel)[0] is False
        browser.evaluate(f"highfive.headset.session.end().then(() => {WAIT.format(500)})")
        assert browser.evaluate(notice).startswith("Put the headset on")


SIGHT = """(() => {const {stage} = highfive, {standing} = highfive.headset, eyes = stage.renderer.xr.getCamera();
return {text: standing.visible ? standing.text : "", at: standing.position.toArray(),
both: eyes.cameras.every(eye => standing.layers.test(eye.layers)),
dark: stage.veil.visible ? stage.veil.material.opacity : 0}})()"""
INK = "highfive.headset.standing.canvas.getContext('2d').getImageData(512, 300, 1, 1).data[3]"
UNTIL = "new Promise(r => {{const t = setInterval(() => {{if ({}) {{clearInterval(t); r(true)}}}}, 30)}})"


def told(browser: Browser, text: str) -> dict[str, Any]:
    """What she sees once the panel says ``text``, fully there."""
    panel = "highfive.headset.standing"
    assert browser.evaluate(
        UNTIL.format(f"{panel}.visible === {json.dumps(bool(text))} && (!{json.dumps(text)} || "
                     f"{panel}.text === {json.dumps(text)} && {panel}.material.opacity === 1)")
    )  # fmt: skip
    return browser.evaluate(SIGHT)


def still(number: int = 0) -> PoseMessage:
    """A pose of everybody at rest, of now."""
    now, bodies = time.monotonic_ns(), np.zeros((59, 7))
    bodies[:, 3] = 1.0
    return PoseMessage(number, now, now, 0, 1.0, 0.5, bodies, np.zeros((0, 3)), np.zeros(0, dtype=bool))


@pytest.mark.slow(15)
def test_she_is_told_in_the_headset_how_it_stands_and_let_out_of_the_dark_with_the_reason(emulator: str) -> None:
    about = {"mode": "session", "title": "", "emotions": [], "cells": [], "tracks": True}
    with LivePage(about, port=0, tracks=True) as page, Browser((640, 360)) as browser:
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=emulator + DEVICE)
        browser.go(page.address)
        assert browser.evaluate(LOADED)
        browser.evaluate("highfive.stage.renderer.render = () => {}")
        page.show(still())
        enter(browser, "immersive-vr")
        assert browser.evaluate("document.querySelector('[data-mode=immersive-vr]').textContent") == "Leave"
        stale = told(browser, "No new poses come: what you see stands still.")
        # Eyes at (0.3, 1.62, 0.2) look along -z: it stands before her, under her eyes, nearer than the avatar.
        assert stale["both"] and browser.evaluate(INK) > 200 and stale["dark"] == 0
        assert stale["at"] == pytest.approx([0.3, 1.36, -0.55], abs=0.02)
        page.tell("state", trial=0, trials=4, weights={}, paused=True, time_s=0.0)
        told(browser, "Paused.")
        page.tell("state", trial=0, trials=4, weights={}, paused=False, time_s=0.0)
        told(browser, "No new poses come: what you see stands still.")
        # Who turns round has it before her again; who only glances aside does not.
        browser.evaluate("headset.quaternion.set(0, Math.SQRT1_2, 0, Math.SQRT1_2)")  # to the left
        browser.evaluate(UNTIL.format("highfive.headset.standing.position.x < 0"))
        assert told(browser, "No new poses come: what you see stands still.")["at"] == pytest.approx(
            [-0.45, 1.36, 0.2], abs=0.02
        )
        page.tell("over", message="The session ended early.", report="/x/report.html")
        over = told(browser, "The session ended early.")
        assert browser.evaluate(
            UNTIL.format("highfive.stage.veil.material.opacity === 1 && highfive.stage.veil.visible")
        )
        assert over["both"] and browser.evaluate(SIGHT)["text"] == "The session ended early."
        assert browser.evaluate(UNTIL.format("!highfive.headset.session"))
        assert browser.evaluate("[highfive.stage.veil.visible, highfive.headset.standing.visible]") == [False, False]
        assert (
            browser.evaluate("document.querySelector('[data-mode=immersive-vr]').disabled") is True
        )  # nothing is shown
        assert not browser.console


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["immersive-vr", "immersive-ar"])
def test_a_connection_that_is_lost_is_told_in_the_headset_and_who_leaves_by_the_button_goes_through_the_dark(
    emulator: str, mode: str
) -> None:
    about = {"mode": "session", "title": "", "emotions": [], "cells": []}
    with Browser((640, 360)) as browser:
        with LivePage(about, port=0) as page:
            browser.call("Page.addScriptToEvaluateOnNewDocument", source=emulator + DEVICE)
            browser.go(page.address)
            assert browser.evaluate(LOADED)
            browser.evaluate("highfive.stage.renderer.render = () => {}")
            enter(browser, mode)
            port, key = page.port, page.address.rpartition("=")[2]
        told(browser, "The connection is lost; this page tries again by itself.")
        with LivePage(about, port=port, key=key):
            told(browser, "")
            browser.evaluate(
                "window.dark = 0; (look => look(look))(look => {const {veil} = highfive.stage;"
                "window.dark = Math.max(window.dark, veil.visible ? veil.material.opacity : 0);"
                "if (highfive.headset.session) setTimeout(look, 10, look)})"
            )
            browser.evaluate(f"document.querySelector('[data-mode={mode}]').click()")
            assert browser.evaluate(UNTIL.format("!highfive.headset.session"))
            dark = browser.evaluate("window.dark")
            # In her own room, in which she may walk, it never goes dark.
            assert dark > 0.6 if mode == "immersive-vr" else dark == 0
            assert browser.evaluate("document.querySelector('[data-mode=immersive-vr]').textContent") == "Enter VR"


def watch_messages(browser: Browser) -> None:
    """Keeps the newest message of the headset, decoded, as ``window.sent``."""
    browser.evaluate(
        "(() => {const {headset} = highfive, send = headset.send;"
        "headset.send = bytes => {window.sentBytes = Array.from(new Uint8Array(bytes)); send && send(bytes);};})()"
    )


HOST_AND_BOUND = "[highfive.connection.host(performance.now()), highfive.connection.bound]"
"""The host's time as the page has it, and how far that can be off, ms."""


def newest(browser: Browser) -> HeadsetPose:
    browser.evaluate(WAIT.format(600))
    return decode_headset(bytes(browser.evaluate("window.sentBytes")))


@pytest.mark.slow(20)
def test_what_the_page_sends_is_where_head_and_hands_are_before_the_avatar(emulator: str, tmp_path: Path) -> None:
    """Into the world, by the place that the page gave her: lost, seen again, re-centred, reloaded, and left."""
    session = Session(emulator, "headset", "--trials", 40, "--out", tmp_path / "s")
    try:
        with Browser((640, 360)) as browser:
            session.put_on(browser)
            browser.evaluate("highfive.stage.renderer.render = () => {}")
            browser.evaluate("headset.hands.right.position.set(0.5, 1.4, -0.25)")
            enter(browser, "immersive-vr")
            watch_messages(browser)
            seen = newest(browser)
            # Eyes at (0.3, 1.62, 0.2) look along -z: in the world she stands at +x and looks at the avatar.
            away = 0.5 * (1.0 + 1.62 / 1.674)
            assert seen.viewer[:3] == pytest.approx([away, 0.0, 1.62], abs=0.02)
            ahead = rotations.rotate(seen.viewer[3:], [0.0, 0.0, -1.0])
            assert ahead == pytest.approx([-1.0, 0.0, 0.0], abs=0.02) and seen.hands_seen.all()
            # 0.45 m before her and 0.2 m to her right, which is the world's +y.
            wrist = browser.evaluate("Array.from(highfive.headset.hands[1].instanceMatrix.array.slice(12, 15))")
            expected = [away - (0.2 - wrist[2]), wrist[0] - 0.3, wrist[1]]
            assert seen.hands[1, 0] == pytest.approx(expected, abs=0.02)
            assert seen.hands[1, 0, 1] > 0.0 > seen.hands[0, 0, 1] - 0.3
            before = 1e3 * time.monotonic()
            host_ms, bound_ms = browser.evaluate(HOST_AND_BOUND)
            # Asked for between these two; and the page says how far it may be off.
            assert seen.holds_ms < host_ms and bound_ms < 100.0
            assert before - bound_ms < host_ms < 1e3 * time.monotonic() + bound_ms

            browser.evaluate(
                "window.joints = XRFrame.prototype.getJointPose; XRFrame.prototype.getJointPose = () => null"
            )
            lost = newest(browser)
            assert not lost.hands_seen.any() and not lost.hands.any() and lost.viewer_seen
            browser.evaluate("XRFrame.prototype.getJointPose = window.joints")
            assert newest(browser).hands_seen.all()
            browser.evaluate(
                "window.viewer = XRFrame.prototype.getViewerPose; XRFrame.prototype.getViewerPose = () => null"
            )
            blind = newest(browser)
            assert not blind.viewer_seen and not blind.hands_seen.any()
            browser.evaluate("XRFrame.prototype.getViewerPose = window.viewer")

            browser.evaluate("headset.position.set(-0.1, 1.62, 0.5); headset.recenter()")
            browser.evaluate(WAIT.format(1000))
            again = newest(browser)
            assert again.place == seen.place + 1
            assert again.viewer[:3] == pytest.approx([away, 0.0, again.viewer[2]], abs=0.02)

            browser.evaluate(f"highfive.headset.session.end().then(() => {WAIT.format(1000)})")
            count = browser.evaluate("highfive.headset.counts.sent")
            browser.evaluate(WAIT.format(500))
            assert browser.evaluate("highfive.headset.counts.sent") == count
            browser.go(session.address)  # reloaded: she may enter again
            assert browser.evaluate(LOADED)
            browser.evaluate("highfive.stage.renderer.render = () => {}")
            enter(browser, "immersive-vr")
            watch_messages(browser)
            assert newest(browser).viewer_seen and not browser.console
    finally:
        session.process.kill()
        session.process.communicate()


@pytest.mark.slow(30)
def test_high_fives_in_four_emotions_and_a_second_headset_that_only_shows(emulator: str, tmp_path: Path) -> None:
    session = Session(emulator, "headset", "--trials", 4, "--out", tmp_path / "s")
    try:
        with Browser((640, 360)) as browser, Browser((640, 360)) as other:
            session.put_on(browser)
            browser.evaluate(HIGH_FIVES)
            enter(browser, "immersive-vr")
            session.put_on(other)
            other.evaluate("highfive.stage.renderer.render = () => {}")
            enter(other, "immersive-vr")
            other.evaluate(WAIT.format(1000))
            assert "Another headset is tracked already" in other.evaluate(
                "document.getElementById('notice').textContent"
            )
            told(other, "Another headset is tracked already: this one only shows.")
            other.close()
            code, out, said = session.end(300.0)
            assert not browser.console
        summary = json.loads(out)
        assert summary["trials"] == 4 and not summary["interrupted"], said
        assert [row["style"] for row in summary["rows"]] == ["neutral", "happy", "angry", "sad"]
        # How many hands are met is `highfive bench headset`'s to say, in virtual time: here a busy machine moves them.
        missed = [row for row in summary["rows"] if not (row["met"] or row["out_of_reach"])]
        assert code == (1 if missed else 0), said
        assert all(row["markers_seen"] > 0.0 and not row["simulated"] for row in summary["rows"])
        assert "enter VR" in said.replace("press Enter VR", "enter VR")
        streams = {row["stream"]: row for row in summary["streams"]}
        assert set(streams) == {"headset://page", "page 1", "page 2"}, streams  # in the order in which they are heard
        assert all(row["bound_ms"] > 0.0 and row["rate_hz"] > 0.0 for row in streams.values()), streams
        assert all(streams[f"page {n}"]["shown"]["pictures"] > 20 for n in (1, 2)), streams
    finally:
        session.process.kill()


@pytest.mark.slow(25)
def test_a_headset_that_sleeps_ends_the_session_with_a_line(emulator: str, tmp_path: Path) -> None:
    session = Session(emulator, "headset", "--trials", 40, "--out", tmp_path / "s")
    try:
        with Browser((640, 360)) as browser:
            session.put_on(browser)
            browser.evaluate(HIGH_FIVES)
            enter(browser, "immersive-vr")
            judged = "new Promise(r => setInterval(() => highfive.state().trial >= 1 && r(true), 50))"
            assert browser.evaluate(judged)  # the first high five is over: it stays, whatever becomes of the second
            browser.evaluate("highfive.headset.send = null")
            code, out, said = session.end(120.0)
        summary = json.loads(out)
        assert code == 1 and summary["interrupted"] and summary["trials"] >= 1
        assert "the headset sends nothing" in said
        assert "Traceback" not in said
    finally:
        session.process.kill()


@pytest.mark.slow
@pytest.mark.parametrize("registered", [False, True])
def test_beside_a_labs_system_it_sends_its_own_space_or_that_where_it_was_registered(
    emulator: str, registered: bool
) -> None:
    """The place of the eyes and of the avatar's world in the headset is that of the registration, for any heading."""
    turn, place = rotations.from_rotation_vector([0.02, -0.03, 2.2]), np.array([0.7, -0.4, 0.05])
    space = {"rotation": turn.tolist(), "translation": place.tolist()} if registered else "own"
    about = {"mode": "session", "title": "", "emotions": [], "cells": [], "tracks": True, "space": space}
    with LivePage(about, port=0, tracks=True) as page, Browser((640, 360)) as browser:
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=emulator + DEVICE)
        browser.go(page.address)
        assert browser.evaluate(LOADED)
        browser.evaluate("highfive.stage.renderer.render = () => {}")
        enter(browser, "immersive-vr")
        watch_messages(browser)
        seen = newest(browser)
        # The device's space has y up, the message's z: eyes at (0.3, 1.62, 0.2) look along -z, which is +y there.
        eyes, ahead = np.array([0.3, -0.2, 1.62]), np.array([0.0, 1.0, 0.0])
        if registered:
            eyes, ahead = rotations.rotate(turn, eyes) + place, rotations.rotate(turn, ahead)
        assert seen.viewer[:3] == pytest.approx(eyes, abs=0.02)
        assert rotations.rotate(seen.viewer[3:], [0.0, 0.0, -1.0]) == pytest.approx(ahead, abs=0.02)
        # The world's own origin is drawn where the inverse says.
        drawn = browser.evaluate("highfive.stage.world.matrixWorld.elements.slice(12, 15)")
        origin = rotations.rotate(rotations.conjugate(turn), -place) if registered else np.zeros(3)
        assert [drawn[0], -drawn[2], drawn[1]] == pytest.approx(origin, abs=1e-3)
        assert browser.evaluate("document.getElementById('notice').hidden") is True
        browser.evaluate("headset.recenter()")
        browser.evaluate(WAIT.format(1000))
        assert newest(browser).place == seen.place + 1 and not browser.console

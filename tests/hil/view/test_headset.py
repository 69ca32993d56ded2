"""The page in a headset, played by an emulated one (iwer) in Chromium."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from highfive.hil.view.browser import Browser, browser_here

IWER = "iwer@2.5.0"
DEVICE = """
;window.headset = new IWER.XRDevice(IWER.metaQuest3);
headset.installRuntime({forceInstall: true});
headset.position.set(0.3, 1.62, 0.2);
headset.primaryInputMode = 'hand';
"""
READY = """new Promise(done => {const look = setInterval(() => {
if (window.highfive?.stage?.ready && highfive.counts.poses > 5) {clearInterval(look); done(true)}}, 100)})"""
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
    assert seen["eyes"] == pytest.approx([0.3, 1.62, 0.2], abs=0.01)
    worn.evaluate(f"highfive.headset.session.end().then(() => {WAIT.format(1500)})")
    after = json.loads(
        worn.evaluate(
            "JSON.stringify([Boolean(highfive.headset.session), highfive.stage.immersed,"
            "highfive.stage.place.position.x,"
            "highfive.stage.room.every(m => m.visible), highfive.stage.hers.every(m => m.layers.isEnabled(0))])"
        )
    )
    assert after == [False, False, 0, True, True]
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
        process.kill()

"""The page itself in Chromium, before a real server: what it asks for, and what it says where something is amiss."""

import json
import time
from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import pytest

from highfive.hil.session.stream import StreamState
from highfive.hil.sim.scene import build_scene
from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.page_shown import PageShown
from highfive.hil.view.recorded import RecordedTrial, recorded_trials
from highfive.hil.view.wire import PoseMessage

pytestmark = [pytest.mark.slow, pytest.mark.skipif(browser_here() is None, reason="no Chromium here")]
ABOUT = {"mode": "session", "title": "tested", "emotions": ["angry", "happy", "sad"], "cells": ["B2", "B3"]}
STATE = {
    "trial": 1, "trials": 9, "cell": "B2", "weights": {"happy": 1.0}, "paused": False, "corrected": True,
    "stopped": False, "time_s": 0.5, "correction": 0.25, "time_to_contact_s": 0.4, "palms_m": 0.31,
    "tracked": 15, "markers": 16,
    "forecast": {"point": [0.48, 0.0, 1.4], "axes": [[0.05, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.04]]},
}  # fmt: skip
RECORDED = {
    "trial": 0, "trials": 1, "style": "happy 0.5 + neutral 0.5", "cell": "", "time_s": 0.5, "length_s": 2.0,
    "contact_s": 1.0, "playing": True, "speed": 1.0, "palms_m": 0.3, "correction": 0.5, "time_to_contact_s": 0.5,
    "forecast": None,
}  # fmt: skip
SHOWN = "new Promise(r => {{const t = setInterval(() => {{if ({}) {{clearInterval(t); r(true)}}}}, 50)}})"


@pytest.fixture(scope="module")
def trial() -> RecordedTrial:
    return recorded_trials(SHIPPED_RECORDING, build_scene())[1]


@pytest.fixture(scope="module")
def page() -> Iterator[LivePage]:
    with LivePage({**ABOUT, "arm": True}, port=0) as opened:
        yield opened


def show(page: LivePage, trial: RecordedTrial, tick: int) -> int:
    """For now, which it gives back, ns."""
    now = time.monotonic_ns()
    page.show(
        PoseMessage(0, now, now - 20_000_000, 0, 0.0, 0.5, trial.bodies[tick], trial.markers[tick], trial.seen[tick])
    )
    return now


def until(browser: Browser, condition: str) -> None:
    assert browser.evaluate(SHOWN.format(condition))


def text(browser: Browser, name: str) -> str:
    return browser.evaluate(f"document.getElementById('{name}').textContent")


def asked(page: LivePage, count: int) -> list[tuple[str, object]]:
    found, end = [], time.monotonic() + 20.0
    while len(found) < count and time.monotonic() < end:
        found += [(one.name, one.value) for one in page.commands()]
        time.sleep(0.02)
    return found


def test_the_hosts_time_does_not_leap_as_answers_come_and_follows_a_clock_that_is_set(page: LivePage) -> None:
    run = """(() => {
      const one = Object.create(highfive.connection.constructor.prototype);
      Object.assign(one, { answers: [{ trip: 30, offset: 1012 }], offset: 0, moved: 0 });
      const told = [one.host(0)];
      one.answers = Array(9).fill({ trip: 4, offset: 1000 });
      told.push(one.host(8));
      one.answers = [...one.answers, { trip: 1, offset: OFFSET }];
      for (let t = 16; t <= 8016; t += 8) told.push(one.host(t));
      return told;
    })()"""
    with Browser((400, 300)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection")
        better = browser.evaluate(run.replace("OFFSET", "998.5"))
        was_set = browser.evaluate(run.replace("OFFSET", "5000"))
    assert better[:2] == [1012.0, 1008.0]
    steps = np.diff(better[1:])
    assert np.all(np.abs(steps - 8.0) <= 0.0005 * 8.0 + 1e-6)
    assert better[-1] == pytest.approx(8016 + 998.5)
    assert was_set[2] == pytest.approx(16 + 5000)


def test_the_page_says_what_it_has_shown_and_when(page: LivePage, trial: RecordedTrial) -> None:
    with Browser((400, 300)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.stage?.ready && highfive.connection.synchronised")
        told, holds, end = list[PageShown](), list[int](), time.monotonic() + 15.0
        page.shown()
        while len(told) < 8 and time.monotonic() < end:
            holds.append(show(page, trial, 30))
            time.sleep(0.02)
            told += page.shown()
        now = time.monotonic_ns()
    numbers = [one.shown.frame for one in told]
    assert numbers == sorted(set(numbers)) and len(numbers) >= 8
    # How well the page knows the host's clock: at its worst, and what it lets its own be from the best answer.
    off = max(one.bound_ns for one in told) + 20_000_000
    for one in told[2:]:
        # the pose is one of those that were sent (they stand still: at a standstill the newest is shown as it is)
        assert min(abs(one.shown.pose_ns - sent) for sent in holds) < 10_000
        # and it is seen after that, and at the latest one picture (of 50 ms at the most) after it was told of
        assert one.shown.pose_ns - off < one.shown.display_ns < now + 50_000_000 + off
        assert 0 <= one.bound_ns < now - holds[0]


def test_figures_controls_and_the_picture_are_those_of_the_session(page: LivePage, trial: RecordedTrial) -> None:
    with Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.stage?.ready && highfive.connection.synchronised")
        page.commands()
        page.tell("state", **STATE)
        show(page, trial, 30)
        until(browser, "highfive.stage.values && highfive.state().trials === 9")
        assert [text(browser, name) for name in ("palms", "contact", "markers")] == ["31 cm", "0.40 s", "15 of 16"]
        assert text(browser, "mood") == "happy" and text(browser, "about").startswith("High five 2 of 9")
        cloud = browser.evaluate("[highfive.stage.signs.cloud.visible, ...highfive.stage.signs.cloud.matrix.elements]")
        assert cloud[0] and np.allclose(np.reshape(cloud[1:], (4, 4))[:, :3], [
            [0.05, 0, 0], [0, 0.03, 0], [0, 0, 0.04], [0.48, 0, 1.4],
        ])  # fmt: skip
        assert browser.evaluate("highfive.stage.signs.markers.count") == trial.seen[30].sum()
        # The room stands still: it is kept behind the picture, and no longer drawn, unless a graphics card draws.
        until(browser, "highfive.stage.fine || (highfive.stage.still.kept.length && !highfive.stage.scene.background)")
        page.tell("contact", met=True, distance_m=0.0012, style="happy", cell="B2")
        browser.evaluate("document.querySelector('#moods button').click()")
        browser.evaluate(
            "(() => {const s = document.querySelectorAll('#moods input')[1]; s.value = 0.25; s.oninput();})()"
        )
        for press in ("correct", "pause", "again", "next", "end", "estop"):
            browser.evaluate(f"document.getElementById('{press}').click()")
        browser.evaluate("(c => {c.value = 'B3'; c.onchange({target: c})})(document.getElementById('cell'))")
        wishes = asked(page, 9)
        assert wishes == [
            ("style", {"angry": 1.0}), ("style", {"happy": 0.25, "angry": 0.75}), ("correct", False), ("pause", True),
            ("again", None), ("next", None), ("end", None), ("estop", None), ("cell", "B3"),
        ]  # fmt: skip
        page.tell("state", **{**STATE, "stopped": True})
        until(browser, "document.getElementById('estop').textContent.includes('let go at the host')")
        assert not browser.console


def test_how_the_streams_stand_is_a_panel_that_opens(page: LivePage, trial: RecordedTrial) -> None:
    rows = [
        StreamState("vicon://lab:801", 119.98, 1234.5, 3.25, 0.0417, 4.2, True, 1),
        StreamState("lsl/EEG", None, 0.0, 0.0, None, 1200.0, False, 0),
    ]
    with Browser((1100, 800)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised")
        assert browser.evaluate("document.querySelector('.streams').hidden")
        page.tell("streams", streams=[asdict(row) for row in rows])
        until(browser, "!document.querySelector('.streams').hidden")
        browser.evaluate("document.querySelector('.streams summary').click()")
        of_one = "r => [r.className, ...[...r.children].map(c => c.textContent)]"
        items = f"[...document.querySelectorAll('.streams li')].map({of_one})"
        assert browser.evaluate(items) == [
            ["", "vicon://lab:801", "120.0 Hz · ± 0.04 ms · age 4 ms · drift 3.3 ppm · 1 reset"],
            ["gone", "lsl/EEG", "– · ± – · age 1200 ms · drift 0.0 ppm · 0 resets"],
        ]
        # Whatever stands beside it stays in reach.
        names = "['.streams', '#figures', '#controls', '#views']"
        boxes = f"{names}.map(n => document.querySelector(n).getBoundingClientRect().toJSON())"
        streams, *others = browser.evaluate(boxes)
        for other in others:
            apart = other["width"] == 0 or (
                streams["right"] <= other["left"] or other["right"] <= streams["left"]
                or streams["bottom"] <= other["top"] or other["bottom"] <= streams["top"]
            )  # fmt: skip
            assert apart, (streams, other)
        assert not browser.console


def press(browser: Browser, key: str, code: str) -> None:
    """As by a finger: with what a focused control does of its own accord."""
    stroke = {
        "key": key,
        "code": code,
        "text": " " if key == " " else "",
        "windowsVirtualKeyCode": 32 if key == " " else 0,
    }
    browser.call("Input.dispatchKeyEvent", type="keyDown", **stroke)
    browser.call("Input.dispatchKeyEvent", type="keyUp", **stroke)


def click(browser: Browser, selector: str) -> None:
    """As by a mouse: the focus goes there."""
    x, y = browser.evaluate(
        f"(() => {{const box = document.querySelector('{selector}').getBoundingClientRect();"
        "return [box.x + box.width / 2, box.y + box.height / 2]})()"
    )
    for kind in ("mousePressed", "mouseReleased"):
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)


CONTROLS = ("#moods button", "#moods input", "#correct", "#pause", "#next", "#mix", "[data-view=side]")


@pytest.mark.parametrize("control", CONTROLS)
def test_space_stops_the_arm_and_does_nothing_else_whatever_has_the_focus(page: LivePage, control: str) -> None:
    with Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised && !document.getElementById('estop').disabled")
        page.tell("state", **STATE)
        until(browser, "highfive.state().trials === 9")
        page.commands()
        click(browser, control)
        until(browser, "!document.activeElement || document.activeElement === document.body")
        browser.evaluate(f"document.querySelector('{control}').focus()")  # as by Tab
        page.commands()
        press(browser, " ", "Space")
        assert asked(page, 1) == [("estop", None)]
        until(browser, "document.getElementById('estop').textContent.startsWith('STOP ASKED')")
        assert not page.commands()
        page.tell("state", **{**STATE, "stopped": True})
        until(browser, "document.getElementById('estop').textContent.includes('let go at the host')")
        page.tell("state", **STATE)
        until(browser, "document.getElementById('estop').textContent === 'EMERGENCY STOP'")


def test_space_pauses_a_session_without_an_arm_and_plays_a_recording_after_controls_were_clicked() -> None:
    with LivePage(ABOUT, port=0) as page, Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised && !document.getElementById('controls').hidden")
        click(browser, "#correct")
        assert asked(page, 1) == [("correct", False)]
        press(browser, " ", "Space")
        press(browser, "n", "KeyN")
        assert asked(page, 2) == [("pause", True), ("next", None)]
    line = {"style": "happy", "cell": "", "contact_s": 1.0, "met": True, "where": [0.4, 0, 1.4], "distance_m": 0.001}
    with LivePage({"mode": "recording", "title": ""}, port=0) as page, Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised && !document.getElementById('timeline').hidden")
        page.tell("contacts", trials=[{**line, "title": ""}])
        page.tell("state", **RECORDED)
        until(browser, "highfive.state().playing")
        click(browser, "#seek")
        assert [name for name, _ in asked(page, 1)] == ["seek"]
        for key, code in ((" ", "Space"), ("ArrowLeft", "ArrowLeft"), ("ArrowRight", "ArrowRight")):
            press(browser, key, code)
        assert asked(page, 3) == [("pause", True), ("step", -1), ("step", 1)]


def test_a_stop_that_cannot_be_asked_for_does_not_look_as_if_it_could() -> None:
    """Where the host's server is gone, or stands still with its connection open."""
    stop = "(b => [b.disabled, b.textContent])(document.getElementById('estop'))"
    with LivePage({**ABOUT, "arm": True}, port=0) as page, Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised && !document.getElementById('estop').disabled")
        browser.evaluate("highfive.connection.ask = () => {}")  # no answer comes
        until(browser, "document.getElementById('estop').disabled")
        assert browser.evaluate(stop) == [True, "NOT CONNECTED: stop at the host"]
        browser.evaluate("delete highfive.connection.ask")
        until(browser, "!document.getElementById('estop').disabled")
        page.close()
        until(browser, "document.getElementById('estop').disabled")
        assert browser.evaluate(stop) == [True, "NOT CONNECTED: stop at the host"]


def test_the_end_says_why_and_leaves_no_control_that_does_nothing() -> None:
    with LivePage({**ABOUT, "arm": True}, port=0) as page, Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised && !document.getElementById('estop').disabled")
        page.tell("state", **{**STATE, "stopped": True, "message": "The arm was stopped: tested"})
        page.tell("over", message="The session is over: report.html")
        until(browser, "document.getElementById('link').textContent.trim() === 'over'")
        assert text(browser, "notice").split("\n") == [
            "The arm was stopped: tested",
            "The session is over: report.html",
        ]
        assert text(browser, "estop") == "NOT CONNECTED: stop at the host"
        live = "[...document.querySelectorAll('#controls :is(button, input, select)')].filter(c => !c.disabled)"
        assert browser.evaluate(f"{live}.map(c => c.id)") == ["mix"]
        assert browser.evaluate("[...document.querySelectorAll('#views button')].every(b => !b.disabled)")


@pytest.mark.parametrize("told", ["", "The head departs from where it was registered by 18 mm and 1.2°: do it again"])
@pytest.mark.parametrize(("width", "height"), [(1280, 720), (900, 700), (390, 844), (844, 390)])
def test_whom_it_is_about_stands_clear_of_the_panels(
    page: LivePage, trial: RecordedTrial, width: int, height: int, told: str
) -> None:
    """Heads and feet, projected by the page's own camera, lie in the window and under no panel."""
    with Browser((width, height)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.stage?.ready && highfive.connection.synchronised")
        page.tell("state", **STATE, message=told)
        show(page, trial, 60)
        until(browser, f"highfive.stage.values && document.getElementById('notice').textContent === {json.dumps(told)}")
        until(browser, "highfive.stage.free.top > 0" if told else "highfive.stage.free")
        overlaps = (
            "(() => {const all = ['told', 'views', 'figures', 'controls', 'caption'].map(id => [id, document"
            ".getElementById(id).getBoundingClientRect()]).filter(([, b]) => b.width && b.height);"
            "return all.flatMap(([a, p], i) => all.slice(i + 1).filter(([, q]) => p.left < q.right - 1 && q.left <"
            "p.right - 1 && p.top < q.bottom - 1 && q.top < p.bottom - 1).map(([b]) => [a, b]))})()"
        )
        until(browser, f"{overlaps}.length === 0")  # what is said is made room for in the frame after
        places = browser.evaluate(
            "(() => {const {stage} = highfive; stage.draw(performance.now()); stage.scene.updateMatrixWorld(true);"
            "const [w, h] = stage.eye.size; return ['head', 'person_head', 'left_ankle', 'right_ankle'].map(name => {"
            "const body = stage.bodies[stage.names.indexOf(name)]; if (!body) return null;"
            "const p = stage.camera.position.clone().setFromMatrixPosition(body.matrixWorld).project(stage.camera);"
            "const x = (p.x + 1) / 2 * w, y = (1 - p.y) / 2 * h; const top = document.elementFromPoint(x, y);"
            "return [x, y, top && top.id]})})()"
        )
        found = [place for place in places if place]
        assert len(found) == 4
        assert all(0 < x < width and 0 < y < height and name == "stage" for x, y, name in found), found
        page.tell("state", **STATE, message="")  # pages that come later are told the newest


def test_poses_that_a_busy_page_was_not_sent_are_counted_on_it(page: LivePage, trial: RecordedTrial) -> None:
    """Every pose that the host has shown since the page's first was either drawn or is counted as dropped."""
    with Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.stage?.ready && highfive.connection.synchronised")
        show(page, trial, 30)
        until(browser, "highfive.counts.poses > 0")
        first = browser.evaluate("highfive.connection.last - highfive.counts.poses - highfive.counts.lost")
        browser.evaluate("setTimeout(() => {const t = performance.now(); while (performance.now() < t + 2500);}, 0)")
        for _ in range(60):
            show(page, trial, 31)
            time.sleep(0.02)
        until(browser, "/^[0-9]+ of [0-9]+$/.test(document.getElementById('dropped').textContent)")
        show(page, trial, 32)
        until(browser, f"highfive.connection.last >= {first} + 62")
        lost, poses, last = browser.evaluate("[highfive.counts.lost, highfive.counts.poses, highfive.connection.last]")
        assert lost > 10 and lost + poses == last - first
        until(browser, f"document.getElementById('dropped').textContent === '{lost} of {lost + poses}'")


def test_without_webgl_there_are_figures_and_controls(page: LivePage) -> None:
    with Browser((900, 700), ("--disable-3d-apis",)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised")
        page.commands()
        page.tell("state", **STATE)
        until(browser, "highfive.state().trials === 9")
        assert text(browser, "notice").startswith("This browser has no WebGL") and text(browser, "palms") == "31 cm"
        assert browser.evaluate("document.getElementById('notice').hidden") is False
        browser.evaluate("document.getElementById('pause').click()")
        assert asked(page, 1) == [("pause", True)]


def test_without_webgl_no_headset_is_entered_and_it_is_said() -> None:
    with LivePage({**ABOUT, "tracks": True}, port=0) as page, Browser((900, 700), ("--disable-3d-apis",)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised")
        until(browser, "document.getElementById('notice').textContent.includes('no headset can be entered here')")
        assert browser.evaluate("document.getElementById('headset').hidden")
        page.tell("over", message="It ended.")
        until(browser, "document.getElementById('notice').textContent === 'It ended.'")


def test_an_old_page_is_told_to_reload_and_one_with_another_key_where_to_go(page: LivePage) -> None:
    with Browser((900, 700)) as browser:
        older = (
            "const parse = JSON.parse; JSON.parse = t => {const m = parse(t); if (m.version) m.version = 99; return m}"
        )
        made = browser.call("Page.addScriptToEvaluateOnNewDocument", source=older)
        browser.go(page.address)
        until(browser, "document.getElementById('notice').textContent.includes('reload it')")
        assert text(browser, "link").strip() == "old page"
        browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=made["identifier"])
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised")
        browser.evaluate("history.replaceState(null, '', '/?key=wrong'); highfive.connection.socket.close()")
        until(browser, "document.getElementById('notice').textContent.includes('another run')")
        browser.evaluate(f"history.replaceState(null, '', {json.dumps(page.address.split('/')[-1])})")
        until(browser, "document.getElementById('link').textContent.trim() !== 'not let in'")


def test_quality_goes_down_where_pictures_are_slow_and_up_once_where_they_are_not(page: LivePage) -> None:
    with Browser((400, 300)) as browser:
        browser.go(page.address)
        levels = browser.evaluate(
            "import('/quality.js').then(({Quality}) => {"
            "const judge = (quality, rates) => rates.map(rate => (quality.judge(rate), quality.level));"
            "const card = new Quality(false, 2), plain = new Quality(false, 1), slow = new Quality(true, 1);"
            "return [judge(card, [60, 20, 20, 60, 60, 60, 60]), judge(plain, [10, 10, 10, 10]),"
            "judge(slow, [60, 60, 60, 35, 60, 60, 60, 60]), judge(new Quality(true, 1), [30, 20, 40, 40, 40])];})"
        )
        assert levels == [
            [0, 1, 2, 2, 2, 2, 2],  # never up again to where it was too slow
            [2, 3, 4, 4],  # more pixels are none on such a screen
            [3, 3, 2, 3, 3, 3, 3, 3],  # tries finer meshes once
            [3, 4, 4, 4, 4],
        ]


def test_from_marker_to_picture_counts_what_is_measured_anew_and_says_nothing_of_what_stands_still(
    page: LivePage, trial: RecordedTrial
) -> None:
    told, known = "document.getElementById('latency').textContent", "highfive.connection.bound"
    with Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.stage?.ready && highfive.connection.synchronised")
        page.tell("state", **STATE)

        def show_until(wanted: str, captured_ns: int | None) -> tuple[list[float], float]:
            """Shows poses, measured 30 ms ago or all at one time, until the page says so.

            What it counted then, and how well it knew the host's clock, ms, when it did so worst: it learns that by and
            by, and what it counted before it knew better stays counted.
            """
            rate, bound = 1.0 if captured_ns is None else 0.0, float(browser.evaluate(known))
            for _ in range(1200):
                now = time.monotonic_ns()
                captured = now - 30_000_000 if captured_ns is None else captured_ns
                bodies, markers, seen = trial.bodies[30], trial.markers[30], trial.seen[30]
                page.show(PoseMessage(0, now, captured, 0, rate, 0.5, bodies, markers, seen))
                said, now_known, *ages = browser.evaluate(f"[{told}, {known}, ...highfive.ages]")
                bound = max(bound, now_known)
                if said.endswith(wanted):
                    return ages, bound
                time.sleep(0.05)
            raise AssertionError(f"the page never says {wanted}")

        ages, bound = show_until("ms", None)
        # No picture is older than what is on it, but for how well the page knows the host's clock.
        assert ages and min(ages) >= 30.0 - bound - 1.0
        measured = time.monotonic_ns() - 30_000_000
        assert show_until("–", measured)[0] == []  # the same measurement again and again, as in a pause
        assert browser.evaluate("document.getElementById('latency').parentElement.hidden") is False


def test_the_link_says_paused_waiting_or_that_nothing_comes_and_a_pause_keeps_the_figures(
    trial: RecordedTrial,
) -> None:
    link = "document.getElementById('link').textContent.trim() === '{}'"
    with LivePage(ABOUT, port=0) as page, Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.stage?.ready && highfive.connection.synchronised")
        until(browser, link.format("waiting"))
        page.tell("state", **STATE)
        show(page, trial, 30)
        until(browser, link.format("no new poses"))
        paused = {key: STATE[key] for key in ("trial", "trials", "cell", "weights", "corrected", "stopped")}
        page.tell("state", **paused, paused=True, time_s=0.0)
        until(browser, link.format("paused"))
        assert [text(browser, name) for name in ("palms", "contact", "markers")] == ["31 cm", "0.40 s", "15 of 16"]
        page.tell("state", **STATE)
        show(page, trial, 31)
        page.tell("contact", met=True, distance_m=0.0012, style="happy", cell="B2")
        until(browser, link.format("waiting"))


def test_a_recording_says_that_it_was_cut_short_and_names_mixtures_as_sessions_do() -> None:
    with LivePage({"mode": "recording", "title": "", "cut": True}, port=0) as page, Browser((900, 700)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised")
        page.tell("state", **RECORDED)
        until(browser, "highfive.state().playing")
        assert text(browser, "notice") == "This recording has no end: it was cut short."
        assert text(browser, "mood") == "happy\u00a050\u00a0% + neutral\u00a050\u00a0%"


def test_a_chart_keeps_what_was_before_a_seek(page: LivePage) -> None:
    with Browser((400, 300)) as browser:
        browser.go(page.address)
        kept = browser.evaluate(
            "import('/strip.js').then(({Strip}) => {const s = new Strip(document.createElement('canvas'), {});"
            "for (const t of [1, 1.1, 1.2, 1.3]) s.add(t, t); s.add(1.15, 7); const back = [...s.points];"
            "s.add(3, 8); return [back, s.points.slice(-2)];})"
        )
    assert kept == [[[1, 1], [1.1, 1.1], [1.15, 7]], [[3, None], [3, 8]]]

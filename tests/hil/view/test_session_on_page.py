"""A session that somebody looks on: by the real command and a page's own messages."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from page_address import page_address
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from highfive.hil.commands.simulate import PREPARING
from highfive.hil.recording.exports.export_file import trial_names
from highfive.hil.recording.session_reader import read_session
from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.wire import PoseMessage, decode_poses

COMMAND = [sys.executable, "-m", "highfive.hil.cli.main"]


class Watched:
    """A command with a page, and what its page got."""

    def __init__(self, *arguments: object) -> None:
        self.process = subprocess.Popen(
            [*COMMAND, *map(str, arguments), "--no-open"], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.address, self.said = page_address(self.process)

    def connect(self):
        return connect(self.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None)

    def end(self) -> tuple[int, str]:
        out, _ = self.process.communicate(timeout=120)
        return self.process.returncode, out


def check_recorded(folder: Path, changed: str) -> None:
    """Recording, names of what is exported and report have the style that the second high five was changed to; what
    happened before, the one that it began in."""
    recording = read_session(folder / "session.mcap")
    spans = [span for span in recording.spans if span.number == 1]
    events = [event.data for span in spans for event in recording.read(span, {"/event"}).of("/event")]
    assert [span.text("style") for span in spans] == [changed]
    assert trial_names("s", spans, ".bvh") == ["s_trial02_angry-0.75-sad-0.25.bvh"]
    said = {event["event"]: event["style"] for event in events if "style" in event}
    assert said["trial_start"] != changed and said["answer_changed"] == said["trial_end"] == changed, said
    assert said["hand_raised"] == changed
    page = (folder / "report.html").read_text("utf-8")
    assert "each answered in the emotion of the person" not in page and "bit for bit" not in page


@pytest.mark.slow(20)
def test_a_session_is_shown_and_does_what_the_page_asks(tmp_path: Path) -> None:
    cells = ("--cell", "B2", "--cell", "B3")
    watched = Watched("simulate", "--view", "--trials", 4, *cells, "--no-pictures", "--json", "--out", tmp_path / "s")
    poses: list[PoseMessage] = []
    contacts, touches, states, over = [], 0, [], ""
    asked: set[str] = set()

    def ask(name: str, value: object = None) -> None:
        if name not in asked:
            asked.add(name)
            link.send(json.dumps({"kind": "command", "name": name, "value": value}))

    with watched.connect() as link:
        try:
            while True:
                message = link.recv(60.0)
                if isinstance(message, bytes):
                    link.send(message[4:8])
                    poses.append(decode_poses(message))
                    continue
                text = json.loads(message)
                if text["kind"] == "state":
                    states.append(text)
                    if text["trial"] == 1 and text["time_s"] > 0.3:
                        ask("style", {"angry": 0.6, "sad": 0.2})
                        ask("correct", False)
                    if text["trial"] == 2:
                        ask("end" if "next" in asked and len(contacts) == 2 and text["time_s"] > 1.0 else "next")
                contacts += [text] if text["kind"] == "contact" else []
                touches += text["kind"] == "touch"
                over = text.get("report", over) if text["kind"] == "over" else over
        except ConnectionClosed:
            pass
    code, out = watched.end()
    summary = json.loads(out)
    assert code == 1 and summary["interrupted"], summary
    assert PREPARING in watched.said[0]  # before anything is waited for
    assert [contact["met"] for contact in contacts] == [row["met"] for row in summary["rows"]] == [True, False]
    assert touches == 1 and over.endswith("report.html")
    assert contacts[1]["style"] == "angry 0.75 + sad 0.25"
    check_recorded(tmp_path / "s", "angry 0.75 + sad 0.25")
    assert states[-1]["weights"] == {"angry": 0.75, "sad": 0.25} and not states[-1]["corrected"]
    numbers = [one.number for one in poses]
    assert numbers == sorted(set(numbers))
    assert all(one.bodies.shape == (59, 7) and np.isfinite(one.bodies).all() for one in poses)
    assert {len(one.markers) for one in poses} == {16}
    assert all(one.holds_ns >= one.captured_ns > 0 for one in poses)
    forecasts = [state["forecast"] for state in states if state.get("forecast")]
    assert forecasts and all(len(one["axes"]) == 3 for one in forecasts)
    # What is drawn of the contact is told, too: never a place where its time is not sure.
    assert all(state["time_to_contact_s"] is not None for state in states if state.get("forecast"))


@pytest.mark.slow
def test_the_page_draws_a_recording_and_says_no_error(tmp_path: Path) -> None:
    if browser_here() is None:
        pytest.skip("no Chromium here")
    watched = Watched("view")
    with Browser() as browser:
        browser.go(watched.address)
        ready = "new Promise(r => {const t = setInterval(() => {if (window.highfive?.stage?.ready && \
highfive.counts.poses > 100 && highfive.fps > 1) {clearInterval(t); r(true)}}, 100)})"
        assert browser.evaluate(ready)
        drawn = browser.evaluate("highfive.stage.renderer.info.render.triangles")
        assert drawn > 10_000
        browser.evaluate("document.getElementById('trials').onchange({target: {value: '2'}})")
        browser.evaluate("document.getElementById('play').click()")
        browser.evaluate("document.getElementById('seek').oninput({target: {value: '1.5'}})")
        settled = "new Promise(r => setTimeout(() => r(highfive.state()), 1500))"
        state = browser.evaluate(settled)
        assert (state["trial"], state["playing"], state["time_s"]) == (2, False, 1.5)
        # What is drawn is what was sent, and the hand's place on the screen is inside the picture.
        off = browser.evaluate(
            "(() => {const s = highfive.stage, v = highfive.motion.newest.bodies; let most = 0;"
            "s.bodies.forEach((b, i) => { for (let k = 0; k < 3; k++)"
            "most = Math.max(most, Math.abs(b.matrix.elements[12 + k] - v[7 * i + k])); }); return most;})()"
        )
        assert off < 1e-5
        picture = tmp_path / "page.png"
        browser.picture(picture)
        assert picture.stat().st_size > 50_000
        errors = [line for line in browser.console if "error" in line.lower() and "favicon" not in line]
        assert not errors
    watched.process.send_signal(2)
    assert watched.end()[0] == 1  # as of any command that is interrupted

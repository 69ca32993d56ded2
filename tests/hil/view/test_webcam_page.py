"""The page with a webcam: who may send landmarks, what may run in it, and the nets themselves on a rendered person."""

import hashlib
import importlib.util
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from paths import ROOT
from websockets.sync.client import ClientConnection, connect

from highfive.hil.bench.webcam_film import Film, FilmCamera, filmed_pair, truth
from highfive.hil.bench.webcam_recorded import load_clips
from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.pages import POLICY
from highfive.hil.view.webcam_files import net_files, net_folder
from highfive.hil.view.webcam_source import WebcamSource
from highfive.mocap_bridge.sources.camera_person import TO_ROOM, CameraPerson
from highfive.mocap_bridge.sources.camera_settings import LEFT_SHOULDER, SHOULDER, WRIST
from highfive.mocap_bridge.wire.landmarks import encode_landmarks
from highfive.model.errors import HighFiveError

ABOUT = {"mode": "session", "title": "webcam", "emotions": ["neutral"], "webcam": True}
FETCH = ROOT / "packaging" / "webcam" / "fetch.py"


def packed(folder: Path, listed: bytes) -> None:
    """A package of nets that are none, with the digest of what is ``listed``."""
    package = folder / "high_five_webcam"
    (package / "pose").mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "pose" / "pose.js").write_bytes(b"let net;")
    (package / "files.json").write_text(json.dumps({"pose/pose.js": hashlib.sha256(listed).hexdigest()}))


@pytest.fixture
def forget_package() -> Iterator[None]:
    sys.modules.pop("high_five_webcam", None)
    importlib.invalidate_caches()
    yield
    sys.modules.pop("high_five_webcam", None)
    importlib.invalidate_caches()


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forget_package: None) -> Iterator[LivePage]:
    packed(tmp_path, b"let net;")
    monkeypatch.syspath_prepend(tmp_path)
    with LivePage(ABOUT, port=0, tracks=True) as opened:
        yield opened


def live(page: LivePage) -> ClientConnection:
    return connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None)


def claim(link: ClientConnection) -> bool:
    link.send(json.dumps({"kind": "camera"}))
    while True:
        text = json.loads(link.recv(10.0))
        if text["kind"] == "camera":
            return text["granted"]


def test_nets_that_are_not_there_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(HighFiveError, match="make webcam") as error:
        net_folder()
    assert "\n" not in str(error.value)


def test_nets_that_are_others_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forget_package: None
) -> None:
    packed(tmp_path, b"another")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(HighFiveError, match="not the file that was packed"):
        net_files()


@pytest.mark.slow
def test_compiled_code_may_run_there_and_nothing_more(page: LivePage) -> None:
    def get(path: str) -> tuple[int, dict[str, str], bytes]:
        link = HTTPConnection("127.0.0.1", page.port, timeout=30)
        link.request("GET", path)
        answer = link.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()

    parts = urlsplit(page.address)
    for path in (f"/?{parts.query}", "/nets.js", "/nets/pose/pose.js"):
        status, headers, _ = get(path)
        rules = headers["Content-Security-Policy"]
        assert status == 200 and rules.startswith(POLICY)
        assert rules.removeprefix(POLICY) == "; script-src 'self' 'wasm-unsafe-eval'"
    assert get("/nets/pose/pose.js")[2] == b"let net;"
    assert get("/nets/../files.json")[0] == 404


@pytest.mark.skipif(browser_here() is None, reason="no Chromium here")
@pytest.mark.parametrize("hand", ["left", "right"])
@pytest.mark.slow
def test_the_whole_picture_is_turned_round_for_a_left_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forget_package: None, hand: str
) -> None:
    packed(tmp_path, b"let net;")
    monkeypatch.syspath_prepend(tmp_path)
    with LivePage({**ABOUT, "hand": hand}, port=0, tracks=True) as opened, Browser((800, 450)) as browser:
        browser.go(opened.address)
        turned = browser.evaluate(
            "new Promise((done) => setInterval(() => { if (window.highfive?.webcam)"
            "done(getComputedStyle(document.getElementById('stage')).transform); }, 50))"
        )
    assert turned == ("matrix(-1, 0, 0, 1, 0, 0)" if hand == "left" else "none")


@pytest.mark.slow
def test_landmarks_of_one_page_reach_the_source_and_no_others(page: LivePage) -> None:
    found = load_clips()[0].landmarks[0]
    source = WebcamSource(page, CameraPerson())
    try:
        with live(page) as one, live(page) as other:
            one.send(encode_landmarks(found))  # nobody has asked yet
            assert claim(one) and not claim(other)
            other.send(encode_landmarks(replace(found, number=90, captured_ms=1.0)))
            one.send(encode_landmarks(replace(found, number=7, captured_ms=5000.0)))
            frame = source.first(10.0)
            assert frame.number == 7 and frame.valid.all()
            assert source.captured(frame) == 5_000_000_000
            one.send(b"\3" + bytes(40))  # no landmarks: the source says so, and goes on
            one.send(encode_landmarks(replace(found, number=8, captured_ms=5100.0)))
        assert source.wait(frame, 5.0) is not None
        with live(page) as third:
            assert claim(third)  # the one that had the camera has gone
    finally:
        source.close()


@pytest.mark.slow
def test_what_is_shown_says_whether_the_person_comes_through_that_page(page: LivePage) -> None:
    def shows(link: ClientConnection, number: int) -> None:
        link.send(json.dumps({"kind": "shown", "bound_ms": number, "pictures": [[number, 1.0, 2.0, 0]]}))

    with live(page) as one, live(page) as other:
        assert claim(one) and not claim(other)
        shows(one, 1)
        shows(other, 2)
        told, end = [], time.monotonic() + 30.0
        while len(told) < 2:
            assert time.monotonic() < end
            told += page.shown()
    assert {one.shown.frame: one.tracks for one in told} == {1: True, 2: False}


@pytest.mark.slow
def test_a_page_without_a_webcam_gives_no_camera() -> None:
    with LivePage({"mode": "session"}, port=0) as plain, live(plain) as link:
        link.send(json.dumps({"kind": "camera"}))
        link.send(json.dumps({"kind": "time", "asked": 1.0}))
        while True:
            text = json.loads(link.recv(10.0))
            assert text["kind"] != "camera"
            if text["kind"] == "time":
                break


@pytest.fixture(scope="module")
def nets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The real nets, fetched once; CI has npm and Chromium, and who has not is told what is missing."""
    assert browser_here() is not None, "this test needs Chromium (Debian: apt install chromium)"
    assert shutil.which("npm") is not None, "this test needs npm (Debian: apt install npm)"
    folder = tmp_path_factory.mktemp("nets") / "high_five_webcam"
    done = subprocess.run([sys.executable, FETCH, folder], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"the nets cannot be fetched: {done.stderr}"
    return folder.parent


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first moment of a high five, over and over: its truth is the same whatever the nets' speed."""
    path = tmp_path_factory.mktemp("film") / "still.mjpeg"
    with Film(FilmCamera(size=(640, 360))) as film:
        _, picture = next(film.pictures(filmed_pair("neutral", "B2"), 4, np.random.default_rng(0)))
    path.write_bytes(30 * picture)
    return path


@pytest.mark.slow(15)
def test_the_nets_find_a_rendered_person_where_she_is(
    nets: Path, video: Path, monkeypatch: pytest.MonkeyPatch, forget_package: None
) -> None:
    monkeypatch.syspath_prepend(nets)
    joints, _ = truth(filmed_pair("neutral", "B2"), FilmCamera())
    with LivePage(ABOUT, port=0, tracks=True) as page, Browser((800, 450), camera=video) as browser:
        source = WebcamSource(page, CameraPerson())
        try:
            browser.go(page.address)
            frame = source.first(240.0)
            for _ in range(3):
                frame = source.wait(frame, 60.0) or frame
            camera = source.person.camera_in_room
        finally:
            source.close()
        said = browser.evaluate("highfive.webcam.line.textContent")
        broken = [line for line in browser.console if "Content Security Policy" in line or "exceptionThrown" in line]
    assert not broken
    assert "A step" not in said and "Nobody" not in said and "Two people" not in said
    assert frame.valid.all()
    gaps = (frame.positions[[SHOULDER, WRIST, LEFT_SHOULDER]] - camera) @ TO_ROOM - joints[
        0, [SHOULDER, WRIST, LEFT_SHOULDER]
    ]
    assert np.linalg.norm(gaps[:, :2], axis=1).max() < 0.06
    assert np.abs(gaps[:, 2]).max() < 0.3


@pytest.mark.slow
def test_a_browser_without_a_camera_says_so(nets: Path, monkeypatch: pytest.MonkeyPatch, forget_package: None) -> None:
    monkeypatch.syspath_prepend(nets)
    with LivePage(ABOUT, port=0, tracks=True) as page, Browser((800, 450)) as browser:
        browser.go(page.address)
        said = browser.evaluate(
            "new Promise((done) => setInterval(() => { const line = window.highfive?.webcam?.line.textContent;"
            "if (line && !line.endsWith('…')) done(line); }, 100))"
        )
        assert "camera" in said.lower() and ("There is no camera" in said or "refused" in said)
        assert not browser.evaluate("document.getElementById('controls').hidden")

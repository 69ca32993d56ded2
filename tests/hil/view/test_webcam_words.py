"""What the webcam's panel says and draws, in Chromium, without the nets: where to stand, what is unsure or missing."""

import json
from collections.abc import Iterator

import pytest

from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.live_page import LivePage

pytestmark = pytest.mark.skipif(browser_here() is None, reason="no Chromium here")

WIDTH, HEIGHT = 1280, 720
STANDING = {
    0: (0.50, 0.30), 11: (0.56, 0.42), 12: (0.44, 0.42), 13: (0.58, 0.55), 14: (0.42, 0.55), 15: (0.58, 0.66),
    16: (0.42, 0.66), 23: (0.53, 0.70), 24: (0.47, 0.70),
}  # fmt: skip
"""Landmarks of who stands two metres before the camera: shares of width and height."""
OPEN = """(async () => {
const { Webcam, guidance } = await import('/webcam.js');
window.guidance = guidance;
window.panel = new Webcam({ send() {} }, document.createElement('section'), { processor: true });
})()"""
STARTED = "panel.start().then(() => panel.line.textContent)"


def body(sure: float = 0.9, **moved: tuple[float, float]) -> dict[str, object]:
    """As the net answers; landmarks called ``at12`` and so on are elsewhere."""
    places = STANDING | {int(name.removeprefix("at")): place for name, place in moved.items()}
    return {"picture": [[*places.get(i, (0.5, 0.5)), sure if i != 14 else 0.2] for i in range(25)]}


@pytest.fixture(scope="module")
def page() -> Iterator[LivePage]:
    with LivePage({"mode": "session"}, port=0) as opened:
        yield opened


@pytest.fixture(scope="module")
def browser(page: LivePage) -> Iterator[Browser]:
    with Browser((800, 450)) as opened:
        opened.go(page.address)
        opened.evaluate(OPEN)
        yield opened


def said(browser: Browser, seen: dict[str, object] | None) -> str:
    return browser.evaluate(f"guidance({json.dumps(seen)}, {WIDTH}, {HEIGHT})")


def test_who_stands_well_is_told_nothing_and_others_what_to_do(browser: Browser) -> None:
    assert said(browser, body()) == ""
    assert said(browser, None).startswith("Nobody is seen")
    assert said(browser, body(at23=(0.53, 1.05), at24=(0.47, 1.05))).startswith("A step back: your hips")
    assert "no room over your head" in said(browser, body(at0=(0.5, 0.12)))
    assert said(browser, body(at11=(1.01, 0.42))).startswith("To the middle")
    assert said(browser, body(at11=(0.44, 0.42), at12=(0.56, 0.42))) == "Face the camera."
    far = {f"at{i}": (0.5 + 0.25 * (x - 0.5), 0.5 + 0.25 * (y - 0.5)) for i, (x, y) in STANDING.items()}
    assert said(browser, body(**far)) == "A step nearer."


def test_what_a_net_is_unsure_of_is_drawn_pale(browser: Browser) -> None:
    """The upper arm goes to an elbow that the net is unsure of; the shoulders it is sure of."""
    alphas = browser.evaluate(
        f"(() => {{ const seen = {json.dumps(body())}; panel.draw(seen, [], {WIDTH}, {HEIGHT});"
        "const pen = panel.canvas.getContext('2d'), { width, height } = panel.canvas;"
        "const least = ([x, y]) => Math.max(...pen.getImageData("
        "Math.round((1 - x) * width) - 2, Math.round(y * height) - 2, 5, 5).data.filter((_, i) => i % 4 === 3));"
        "return [least([0.5, 0.42]), least([0.43, 0.485])]; })()"
    )
    assert alphas[0] > 200 and 20 < alphas[1] < 100


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("NotAllowedError", "The camera was refused"),
        ("NotReadableError", "taken by another program"),
        ("NotFoundError", "There is no camera here"),
        ("OverconstrainedError", "The camera cannot be used"),
    ],
)
def test_what_keeps_the_camera_away_is_said(browser: Browser, name: str, expected: str) -> None:
    browser.evaluate(f"navigator.mediaDevices.getUserMedia = () => Promise.reject(new DOMException('no', '{name}')), 0")
    assert expected in browser.evaluate(STARTED)
    browser.evaluate("window.sent = [], panel.connection = { send: (text) => sent.push(text) }, panel.claim(), 0")
    assert browser.evaluate("sent") == []  # after a reconnection, too: it keeps no other page's from counting


@pytest.mark.slow
def test_at_the_end_the_camera_goes_off(page: LivePage) -> None:
    """Also one that is allowed only then."""
    with Browser((800, 450), ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"]) as allowing:
        allowing.go(page.address)
        allowing.evaluate(OPEN)
        allowing.evaluate(
            "panel.load = async () => {}; panel.look = async () => { window.looked = (window.looked || 0) + 1; }; 0"
        )
        allowing.evaluate(STARTED)
        allowing.evaluate("window.tracks = panel.video.srcObject.getTracks(); 0")
        looks = "new Promise(done => setTimeout(() => done(window.looked || 0), 400))"
        assert allowing.evaluate(looks) > 0
        allowing.evaluate("panel.end()")
        ended = allowing.evaluate(looks)
        assert allowing.evaluate("tracks.map(track => track.readyState)") == ["ended"]
        assert allowing.evaluate(looks) == ended
        late = "(async () => {const given = panel.start(); await given; return panel.video.srcObject === null})()"
        assert allowing.evaluate(late)
        assert allowing.evaluate("panel.line.textContent") == "The camera is off."


@pytest.mark.slow
def test_a_camera_that_the_browser_refuses_is_called_so(page: LivePage) -> None:
    """The browser's own refusal, nobody asked."""
    with Browser((800, 450), ["--use-fake-device-for-media-stream", "--deny-permission-prompts"]) as refusing:
        refusing.go(page.address)
        refusing.evaluate(OPEN)
        assert "The camera was refused" in refusing.evaluate(STARTED)


@pytest.mark.slow
def test_a_browser_that_lacks_things_says_which_and_the_rest_works(page: LivePage) -> None:
    with Browser((800, 450), ["--disable-3d-apis"]) as plain:
        plain.go(page.address)
        plain.evaluate(OPEN)
        plain.evaluate("Object.defineProperty(navigator, 'mediaDevices', { value: undefined }), 0")
        assert "gives no camera here" in plain.evaluate(STARTED)
        notice = "new Promise((done) => setInterval(() => { const text = document.getElementById('notice').textContent;"
        assert "no WebGL" in plain.evaluate(notice + " if (text) done(text); }, 50))")
        # The notice is there before the host has been heard: controls come with its first word.
        heard = "new Promise((done) => setInterval(() => { if (!document.getElementById('controls').hidden) done(true);"
        assert plain.evaluate(heard + " }, 50))")

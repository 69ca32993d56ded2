"""No panel lies over another one, in any mode, on small windows too."""

from collections.abc import Iterator

import pytest

from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.live_page import LivePage

pytestmark = [pytest.mark.slow, pytest.mark.skipif(browser_here() is None, reason="no Chromium here")]
SIZES = ((1366, 650), (1280, 720), (1024, 600), (900, 700), (390, 844), (844, 390))
SESSION = {
    "mode": "session", "title": "tested", "emotions": ["angry", "happy", "neutral", "sad"],
    "cells": ["B2", "B3"],
}  # fmt: skip
ABOUT = {
    "live": SESSION,
    "arm": {**SESSION, "arm": True, "rig": True},
    "played": {"mode": "played", "title": "tested", "arm": True, "rig": True},
    "recording": {"mode": "recording", "title": ""},
    "webcam": {**SESSION, "cells": []},
    "experiment": SESSION,
}
STATE = {
    "trial": 1, "trials": 9, "cell": "B2", "weights": {"happy": 0.5, "neutral": 0.3, "sad": 0.2}, "paused": False,
    "corrected": True, "stopped": False, "time_s": 0.5, "correction": 0.25, "time_to_contact_s": 0.4, "palms_m": 0.31,
    "tracked": 15, "markers": 16, "forecast": None, "style": "happy 0.5 + neutral 0.5", "length_s": 2.0,
    "contact_s": 1.0, "playing": True, "speed": 1.0,
}  # fmt: skip
TOLD = "The head departs from where it was registered by 18 mm and 1.2°: register it again."
WEBCAM = """Promise.all([import('/webcam.js'), import('/main.js')]).then(([{Webcam}, main]) => {
  const panel = document.createElement('section');
  main.addPanel(panel, 'tested', () => {});
  window.shown = new Webcam({send() {}}, panel, {processor: true});
  shown.say('A step back, or tilt the camera up: there is no room over your head for the hand. '
    + 'Two people are in view: the nearer one counts. Only 3.2 pictures a second are looked at here: raise the hand '
    + 'slowly, and hold it.');
  const mirror = Object.assign(document.createElement('button'), {textContent: 'Mirror'});
  document.getElementById('views').prepend(mirror);
})"""
EXPERIMENT = """import('/main.js').then(({addPanel}) => {
  const panel = document.createElement('section');
  panel.innerHTML = '<p>How much did it feel like meeting somebody?</p><input type="range"><div class="row">'
    + '<button>1</button><button>2</button><button>3</button><button>4</button></div><button>Next</button>';
  addPanel(panel, 'tested', () => {});
})"""
BOXES = """(() => {
  const all = ['.told > p', 'header > *', '#views', '#partners', '#caption', '#figures', '#controls', '#timeline',
    '#panels'].flatMap(name => [...document.querySelectorAll(name)].map((one, i) =>
      [`${name} ${i}`, one.getBoundingClientRect()]))
    .filter(([, box]) => box.width && box.height);
  const across = all.flatMap(([a, p], i) => all.slice(i + 1).filter(([, q]) =>
    p.left < q.right - 1 && q.left < p.right - 1 && p.top < q.bottom - 1 && q.top < p.bottom - 1)
    .map(([b]) => `${a} × ${b}`));
  const outside = all.filter(([, b]) =>
    b.left < -1 || b.top < -1 || b.right > innerWidth + 1 || b.bottom > innerHeight + 1).map(([a]) => a);
  return {across, outside, shown: all.map(([a]) => a)};
})()"""


@pytest.fixture(scope="module", params=list(ABOUT))
def opened(request: pytest.FixtureRequest) -> Iterator[tuple[str, LivePage, Browser]]:
    """The page in a mode, with everything on it that there is."""
    mode = request.param
    with LivePage(ABOUT[mode], port=0) as page, Browser((1280, 720), ("--disable-3d-apis",)) as browser:
        browser.go(page.address)
        until(browser, "window.highfive?.connection.synchronised")
        page.tell("state", **STATE)
        until(browser, "highfive.state().trials === 9")
        if mode in ("webcam", "experiment"):
            browser.evaluate(WEBCAM if mode == "webcam" else EXPERIMENT)
        else:
            page.tell("streams", streams=[])
        yield mode, page, browser


def until(browser: Browser, condition: str) -> None:
    look = "new Promise(r => {{const t = setInterval(() => {{if ({}) {{clearInterval(t); r(true)}}}}, 20)}})"
    assert browser.evaluate(look.format(condition))


@pytest.mark.parametrize("told", ["", TOLD])
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_no_panel_lies_over_another_one(
    opened: tuple[str, LivePage, Browser], width: int, height: int, told: str
) -> None:
    mode, page, browser = opened
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < height
    )
    page.tell("state", **STATE, message=told)
    page.tell("say", message="High five 2, happy: raise the right hand" if told and mode == "webcam" else "")
    until(browser, f"innerWidth === {width} && document.getElementById('notice').textContent.includes({told[:20]!r})")
    browser.evaluate("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")
    found = browser.evaluate(BOXES)
    assert found["across"] == [] and found["outside"] == [], found
    assert ("#timeline 0" if mode == "recording" else "#controls 0") in found["shown"]
    if mode in ("webcam", "experiment"):
        assert "#panels 0" in found["shown"]

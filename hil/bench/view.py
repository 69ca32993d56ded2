"""The live page: poses at a page, where hands are drawn, what pages that sleep get and what pages cost the tick, how
many pictures a second there are, and how long it takes to the first one.
"""

from __future__ import annotations

import multiprocessing
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from websockets.sync.client import connect

from highfive.hil.bench.drawn import Motions, drawn_mm, simulated_motions
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.runtime.console import Bar
from highfive.hil.session.session import RATE_HZ, Session, Tick
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.hil.trials.trial import as_captured, run_trial
from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.player import AHEAD_S, play
from highfive.hil.view.recorded import RecordedTrials, recorded_trials
from highfive.hil.view.session_view import SessionView
from highfive.hil.view.wire import decode_poses
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model

BLOCKS_S = (3.0, 20.0)
STALE_MS = 100.0
"""A pose that is older when it comes is of no use."""
_DRAW = """(() => {
  const {stage} = highfive, gl = stage.renderer.getContext(), pixel = new Uint8Array(4), took = [];
  stage.renderer.setAnimationLoop(null);
  for (let i = 0; i < 40; i++) {
    const start = performance.now();
    stage.pose(stage.values);
    stage.draw(start);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);  // waits until it is drawn
    took.push(performance.now() - start);
  }
  return Math.min(...took);
})()"""
_SHOWN = """new Promise(done => {const look = setInterval(() => {
  if (document.body.classList.contains('shown')) {clearInterval(look); done(true)}}, 20)})"""
PAGES, PAIRS = 4, 8
"""Pages that look on, and pairs of high fives with and without them."""


@dataclass(frozen=True)
class ViewBenchOptions:
    """How long poses are counted, s, and the seed of the simulated person."""

    seconds: float = 60.0
    seed: int = 0


@dataclass(frozen=True)
class Seen:
    """What a page of a recording got: numbers of the poses, and ms until they came, from being sent and from being due.

    ``before`` is the number of the last pose before it slept; 0 where it did not.
    """

    numbers: tuple[int, ...]
    sent_ms: tuple[float, ...]
    age_ms: tuple[float, ...]
    before: int = 0

    @property
    def dropped(self) -> int:
        """Poses that it was not sent, from the last one before it slept on, or else from the first."""
        first = self.before + 1 if self.before else self.numbers[0]
        return self.numbers[-1] - first + 1 - len(self.numbers)


def look_on(address: str, seconds: float, blocked_s: float, said: Connection) -> None:
    """A page without a picture, in a process of its own.

    Args:
        address: of the page.
        seconds: for so long.
        blocked_s: it first sleeps so long with the connection open, and counts only what comes then.
        said: takes ``ready``, then what was :class:`Seen`.
    """
    numbers: list[int] = []
    sent_ms: list[float] = []
    age_ms: list[float] = []
    before = [0]
    with connect(address.replace("http", "ws", 1).replace("/?", "/live?", 1), max_queue=None, compression=None) as link:
        said.send("ready")
        if blocked_s:
            _take(link, 1.0, lambda now, poses: before.append(poses.number))
            time.sleep(blocked_s)

        def note(now: int, poses: Any) -> None:
            numbers.append(poses.number)
            sent_ms.append(1e-6 * (now - poses.sent_ns))
            age_ms.append(1e-6 * (now - poses.holds_ns) + (1e3 * AHEAD_S if poses.rate else 0.0))

        _take(link, seconds, note)
    said.send(Seen(tuple(numbers), tuple(sent_ms), tuple(age_ms), before[-1]))


def _take(link: Any, seconds: float, note: Any) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        try:
            message = link.recv(left)
        except TimeoutError:
            return
        if isinstance(message, bytes):
            link.send(message[4:8])
            note(time.monotonic_ns(), decode_poses(message))


class _Page:
    """Somebody who looks on."""

    def __init__(self, address: str, seconds: float, blocked_s: float = 0.0) -> None:
        context = multiprocessing.get_context("spawn")
        self._heard, said = context.Pipe(duplex=False)
        self._process = context.Process(target=look_on, args=(address, seconds, blocked_s, said), daemon=True)
        self._process.start()
        said.close()
        self._heard.recv()

    def seen(self) -> Seen:
        found = self._heard.recv()
        self._process.join()
        return found


def bench_view(options: ViewBenchOptions, bar: Bar) -> dict[str, Any]:
    """All of it; pictures a second are None where there is no browser.

    Raises:
        HighFiveError: the page cannot be served.
    """
    advance = bar("live page", 5 + len(BLOCKS_S))
    first_s = first_picture_s()
    advance()
    scene = build_scene()
    trials = recorded_trials(SHIPPED_RECORDING, scene)
    with LivePage({"mode": "recording"}, port=None) as page:

        def shown_to(seconds: float, blocked_s: float = 0.0) -> Seen:
            one = _Page(page.address, seconds, blocked_s)
            play(page, trials, until_ns=MACHINE.now() + round(1e9 * (seconds + blocked_s + 2.0)))
            return one.seen()

        one = shown_to(options.seconds)
        advance()
        stale, dropped = [], []
        for blocked in BLOCKS_S:
            woken = shown_to(2.0, blocked)
            stale.append(sum(age > STALE_MS for age in woken.age_ms))
            dropped.append(woken.dropped)
            advance()
        fps, draw_ms = _pictures(page, trials)
        advance()
        drawn = _drawn(page, trials, scene, options.seed)
        advance()
    tick = _ticks(options.seed)
    advance()
    return {
        "poses_hz": round(len(one.numbers) / options.seconds, 2),
        "lost": one.dropped,
        "latency_ms": {"p50": _part(one.sent_ms, 50), "p99": _part(one.sent_ms, 99)},
        "host_to_page_ms": {"p50": _part(one.age_ms, 50), "p99": _part(one.age_ms, 99)},
        "stale_after_block": {f"{blocked:g}": count for blocked, count in zip(BLOCKS_S, stale, strict=True)},
        "dropped_in_block": {f"{blocked:g}": count for blocked, count in zip(BLOCKS_S, dropped, strict=True)},
        **tick,
        "fps": fps,
        "draw_ms": draw_ms,
        "drawn_mm": drawn,
        "first_picture_s": first_s,
    }


def first_picture_s() -> float | None:
    """From starting ``highfive view`` to people drawn with their skins in a browser that starts then, s; None where
    there is no browser.
    """
    if browser_here() is None:
        return None
    start = time.perf_counter()
    command = [sys.executable, "-m", "highfive.hil.cli.main", "view", "--no-open"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            address = next(found[0] for line in process.stderr if (found := re.search(r"http://\S+", line)))
            with Browser() as browser:
                browser.go(address)
                browser.evaluate(_SHOWN)
                return round(time.perf_counter() - start, 1)
        finally:
            process.kill()


def _drawn(
    page: LivePage, trials: RecordedTrials, scene: Scene, seed: int
) -> dict[str, dict[str, dict[str, float]]] | None:
    """By what is shown, and by style: see :func:`drawn_mm`; None where there is no browser."""
    if browser_here() is None:
        return None
    simulated = simulated_motions(scene, seed)
    shipped = [Motions(trial.style, trial.times, trial.bodies) for trial in trials]
    with Browser((400, 300)) as browser:
        browser.go(page.address)
        return {
            "session": drawn_mm(browser, scene, simulated, recorded=False),
            "recording": drawn_mm(browser, scene, simulated, recorded=True),
            "shipped": drawn_mm(browser, scene, shipped, recorded=True),
        }


def _part(values: Sequence[float], percent: float) -> float:
    return round(float(np.percentile(values, percent)), 2)


def _pictures(page: LivePage, trials: Any) -> tuple[dict[str, float] | None, dict[str, float] | None]:
    """Pictures a second of both people, and ms that one takes at least, by the size of the window."""
    if browser_here() is None:
        return None, None
    rates, drawn = {}, {}
    for width, height in ((1280, 720), (640, 360)):
        with Browser((width, height)) as browser:
            browser.go(page.address)
            play(page, trials, until_ns=MACHINE.now() + round(18e9))
            rates[f"{width}x{height}"] = round(float(browser.evaluate("highfive.fps")), 1)
            drawn[f"{width}x{height}"] = round(float(browser.evaluate(_DRAW)), 1)
    return rates, drawn


def _ticks(seed: int) -> dict[str, Any]:
    """p99 of whole ticks, markers in to poses handed over, with pages and without, in turns."""
    scene, model = build_scene(), load_model(DEFAULT_MODEL)
    emotion = next(iter(EMOTIONS))
    partner = simulated_partners(1, (emotion,), ("B2",), seed)[0]
    session, playout = Session(model, {emotion: 1.0}, partner.marker_set, scene), KinematicPlayOut(scene)
    took: dict[bool, list[float]] = {True: [], False: []}
    over: dict[bool, list[float]] = {True: [], False: []}
    with LivePage({"mode": "session"}) as page:
        for turn in range(2 * PAIRS):
            watched = turn % 2 == 0
            pages = [_Page(page.address, _length_s(partner) + 1.0) for _ in range(PAGES if watched else 0)]
            view = SessionView(page, session, playout, scene)
            view.begin(turn, 2 * PAIRS, partner.cell, {emotion: 1.0})
            inputs = view.inputs(as_captured(view.in_time(C3DSource(partner.recording, RATE_HZ))))
            handed: list[float] = []

            def watch(tick: Tick, view: SessionView = view, handed: list[float] = handed) -> None:
                start = time.perf_counter_ns()
                view.watch(tick)
                handed.append(1e-6 * (time.perf_counter_ns() - start))

            result = run_trial(turn, partner, session, playout, inputs, watch)
            took[watched] += (result.tick_ms + handed)[1:].tolist()
            over[watched] += handed[1:]
            for one in pages:
                one.seen()
    with_pages, without = (float(np.percentile(took[watched], 99)) for watched in (True, False))
    return {
        "tick_p99_ms": round(without, 2),
        "tick_ratio": round(with_pages / without, 3),
        "handing_over_ms": {"p50": _part(over[True], 50), "p99": _part(over[True], 99)},
    }


def _length_s(partner: Partner) -> float:
    return len(C3DSource(partner.recording, RATE_HZ)) / RATE_HZ


def print_view(result: dict[str, Any]) -> None:
    """The figures, for people."""
    latency, host = result["latency_ms"], result["host_to_page_ms"]
    print(f"poses at a page         {result['poses_hz']:.1f} Hz, {result['lost']} lost")
    print(f"server to page          median {latency['p50']:.2f} ms, p99 {latency['p99']:.2f} ms")
    print(f"host to page            median {host['p50']:.2f} ms, p99 {host['p99']:.2f} ms")
    for blocked, count in result["stale_after_block"].items():
        print(f"stale after {blocked:>2} s asleep  {count}; {result['dropped_in_block'][blocked]} dropped meanwhile")
    print(f"tick p99                {result['tick_p99_ms']:.2f} ms; with {PAGES} pages × {result['tick_ratio']:.2f}")
    over = result["handing_over_ms"]
    print(f"of it handing over      median {over['p50']:.2f} ms, p99 {over['p99']:.2f} ms")
    if result["fps"] is None:
        print("pictures a second       no browser here: install chromium")
        return
    for shown, styles in result["drawn_mm"].items():
        off = ", ".join(f"{style} {palms['avatar']:.1f} / {palms['person']:.1f}" for style, palms in styles.items())
        print(f"drawn to true, {shown:<9} {off} mm (95 %, avatar's / person's palm)")
    print(f"first picture           {result['first_picture_s']:.1f} s after highfive view is started")
    for size, rate in result["fps"].items():
        print(f"pictures a second       {rate:.1f} at {size}; one takes {result['draw_ms'][size]:.1f} ms at least")

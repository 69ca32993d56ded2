"""The live page: poses at a page, where hands are drawn, what pages that sleep get and what pages cost the tick, how
many pictures a second there are, and how long it takes to the first one.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from highfive.hil.bench.drawn import Motions, drawn_mm, simulated_motions
from highfive.hil.bench.page_clients import Page, Seen
from highfive.hil.bench.page_ticks import PAGES, ticks_under_load
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.runtime.console import Bar
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.browser import Browser, browser_here
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.player import play
from highfive.hil.view.recorded import RecordedTrials, recorded_trials

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


@dataclass(frozen=True)
class ViewBenchOptions:
    """How long poses are counted, s, and the seed of the simulated person."""

    seconds: float = 60.0
    seed: int = 0


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
            one = Page(page.address, seconds, blocked_s)
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
    tick = ticks_under_load(options.seed)
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


def print_view(result: dict[str, Any]) -> None:
    """The figures, for people."""
    latency, host = result["latency_ms"], result["host_to_page_ms"]
    print(f"poses at a page         {result['poses_hz']:.1f} Hz, {result['lost']} lost")
    print(f"server to page          median {latency['p50']:.2f} ms, p99 {latency['p99']:.2f} ms")
    print(f"host to page            median {host['p50']:.2f} ms, p99 {host['p99']:.2f} ms")
    for blocked, count in result["stale_after_block"].items():
        print(f"stale after {blocked:>2} s asleep  {count}; {result['dropped_in_block'][blocked]} dropped meanwhile")
    print(f"tick p99                {result['tick_p99_ms']:.2f} ms; with {PAGES} pages × {result['tick_ratio']:.2f}")
    flood = result["flood"]
    late = ", ".join(f"{count} {situation}" for situation, count in flood["late"].items())
    print(f"flooded                 {flood['messages_a_second']} messages/s, let go {flood['let_go']} times")
    print(f"tick then               median × {flood['tick_median_ratio']:.2f}, p99 × {flood['tick_ratio']:.2f}")
    print(f"late of {flood['ticks']:<15} {late}")
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

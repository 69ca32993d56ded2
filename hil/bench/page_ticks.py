"""What pages that look on, and one that floods the server, cost the tick: high fives with and without, in turns."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from highfive.hil.bench.page_clients import Flood, Page, Sent
from highfive.hil.session.session import RATE_HZ, Session, Tick
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.hil.trials.trial import as_captured, run_trial
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.session_view import SessionView
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model

PAGES, TURNS = 4, 8
"""Pages that look on, and high fives in each of the three situations."""
ALONE, WATCHED, FLOODED = "alone", "watched", "flooded"
PERIOD_MS = 1e3 / RATE_HZ


def ticks_under_load(seed: int) -> dict[str, Any]:
    """Whole ticks, markers in to poses handed over, with nobody, with pages, and with a flood, in turns."""
    scene, model = build_scene(), load_model(DEFAULT_MODEL)
    emotion = next(iter(EMOTIONS))
    partner = simulated_partners(1, (emotion,), ("B2",), seed)[0]
    session, playout = Session(model, {emotion: 1.0}, partner.marker_set, scene), KinematicPlayOut(scene)
    took: dict[str, list[float]] = {ALONE: [], WATCHED: [], FLOODED: []}
    over: dict[str, list[float]] = {ALONE: [], WATCHED: [], FLOODED: []}
    floods: list[Sent] = []
    with LivePage({"mode": "session"}) as page:
        for turn in range(TURNS * len(took)):
            situation = (WATCHED, ALONE, FLOODED)[turn % len(took)]
            pages = [Page(page.address, _length_s(partner) + 1.0) for _ in range(PAGES if situation is WATCHED else 0)]
            flood = Flood(page.address) if situation is FLOODED else None
            view = SessionView(page, session, playout, scene)
            view.begin(turn, TURNS * len(took), partner.cell, {emotion: 1.0})
            inputs = view.inputs(as_captured(view.in_time(C3DSource(partner.recording, RATE_HZ))))
            handed: list[float] = []

            def watch(tick: Tick, view: SessionView = view, handed: list[float] = handed) -> None:
                start = time.perf_counter_ns()
                view.watch(tick)
                handed.append(1e-6 * (time.perf_counter_ns() - start))

            result = run_trial(turn, partner, session, playout, inputs, watch)
            took[situation] += (result.tick_ms + handed)[1:].tolist()
            over[situation] += handed[1:]
            for one in pages:
                one.seen()
            if flood is not None:
                floods.append(flood.end())
            session.set_style({emotion: 1.0})
    return {
        "tick_p99_ms": _part(took[ALONE], 99),
        "tick_ratio": _ratio(took, WATCHED, 99),
        "handing_over_ms": {"p50": _part(over[WATCHED], 50), "p99": _part(over[WATCHED], 99)},
        "flood": {
            "messages_a_second": round(sum(one.messages for one in floods) / sum(one.seconds for one in floods)),
            "let_go": sum(one.let_go for one in floods),
            "tick_median_ratio": _ratio(took, FLOODED, 50),
            "tick_ratio": _ratio(took, FLOODED, 99),
            "late": {situation: _late(took[situation]) for situation in took},
            "ticks": len(took[FLOODED]),
        },
    }


def _late(took: Sequence[float]) -> int:
    """Ticks that took longer than their period."""
    return int(np.sum(np.array(took) > PERIOD_MS))


def _ratio(took: dict[str, list[float]], situation: str, percent: float) -> float:
    return round(float(np.percentile(took[situation], percent) / np.percentile(took[ALONE], percent)), 3)


def _part(values: Sequence[float], percent: float) -> float:
    return round(float(np.percentile(values, percent)), 3)


def _length_s(partner: Partner) -> float:
    return len(C3DSource(partner.recording, RATE_HZ)) / RATE_HZ

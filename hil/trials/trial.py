"""Runs one trial and keeps what happened."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from highfive.hil.session.session import RATE_HZ, Session, Tick
from highfive.hil.session.synchroniser import Synchroniser
from highfive.hil.sim.playout import PlayOut, PlayState
from highfive.hil.trials.judging import judged
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.trial_result import TrialResult
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.source import C3DSource


def run_trial(
    number: int,
    partner: Partner,
    session: Session,
    playout: PlayOut,
    frames: Iterable[MarkerFrame] | None = None,
    watch: Callable[[Tick], None] = lambda tick: None,
) -> TrialResult:
    """One trial. The partner's recording goes as fast as it can; its figures are the same every time, timings apart.

    The result's style is the partner's emotion; who has set another one puts it in.

    Args:
        number: of the trial.
        partner: who raises the hand.
        session: reset before the first frame.
        playout: plays the poses.
        frames: of a live partner, at their time; by default those of the partner's recording.
        watch: is shown each tick.
    """
    session.reset()
    synchroniser = Synchroniser()
    ticks: list[Tick] = []
    states: list[PlayState] = []
    tick_ms: list[float] = []
    for frame in C3DSource(partner.recording, RATE_HZ) if frames is None else frames:
        start = time.perf_counter_ns()
        tick = session.step(frame)
        tick_ms.append(1e-6 * (time.perf_counter_ns() - start))
        synchroniser.add(frame.source_time_ns, tick.pose)
        synchroniser.add_person(tick.person)
        moment = synchroniser.at(frame.source_time_ns)
        play = playout.step if states else playout.reset
        states.append(play(moment.pose, moment.person, moment.time_ns))
        ticks.append(tick)
        watch(tick)
    return judged(number, partner, ticks, states, np.array(tick_ms))


def style_name(weights: Mapping[str, float]) -> str:
    """``{'angry': 0.5, 'neutral': 0.5}`` as ``'angry 0.5 + neutral 0.5'``; a pure style by its emotion alone."""
    parts = {emotion: weight for emotion, weight in weights.items() if weight > 0.0}
    if len(parts) == 1:
        return next(iter(parts))
    return " + ".join(f"{emotion} {weight:g}" for emotion, weight in parts.items())

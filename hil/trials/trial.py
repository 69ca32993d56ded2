"""Runs one trial and keeps what happened."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Protocol, runtime_checkable

import numpy as np

from highfive.hil.runtime.interrupts import WholeTick, interrupted_between_ticks
from highfive.hil.session.kinds import PEOPLE, POSES
from highfive.hil.session.session import RATE_HZ, Tick, TickInput
from highfive.hil.session.synchroniser import Synchroniser
from highfive.hil.sim.playout import PlayOut, PlayState
from highfive.hil.trials.judging import judged
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.trial_result import TrialResult
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.source import C3DSource


@runtime_checkable
class Chain(Protocol):
    """What makes ticks of inputs: a :class:`~highfive.hil.session.session.Session`, or what shows one again."""

    def reset(self) -> None:
        """A new trial."""
        ...

    def step(self, frame: MarkerFrame | None, time_ns: int | None = None) -> Tick:
        """One tick."""
        ...


def run_trial(
    number: int,
    partner: Partner,
    session: Chain,
    playout: PlayOut,
    inputs: Iterable[TickInput] | None = None,
    watch: Callable[[Tick], None] = lambda tick: None,
    keep: Callable[[TickInput, Tick, PlayState, float], None] = lambda begins, tick, state, tick_ms: None,
) -> TrialResult:
    """One trial. The partner's recording goes as fast as it can; its figures are the same every time, timings apart.

    Ctrl-C waits for the end of a tick: interrupted compiled code crashes, and a recording holds whole ticks.
    The result's style is the partner's emotion; who has set another one puts it in.

    Args:
        number: of the trial.
        partner: who raises the hand.
        session: reset before the first frame.
        playout: plays the poses.
        inputs: of a live partner, at their time; by default the frames of the partner's recording.
        watch: is shown each tick.
        keep: is given with what each began, what was played, and what it took, ms; after ``watch``.
    """
    synchroniser = Synchroniser()
    avatar, person = synchroniser.open("avatar", POSES), synchroniser.open("person", PEOPLE)
    ticks: list[Tick] = []
    states: list[PlayState] = []
    tick_ms: list[float] = []
    whole = WholeTick()  # compiled code runs in no other place
    with interrupted_between_ticks():
        with whole:
            session.reset()
        for begins in as_captured(C3DSource(partner.recording, RATE_HZ)) if inputs is None else inputs:
            with whole:
                start = time.perf_counter_ns()
                tick = session.step(begins.frame, begins.time_ns)
                tick_ms.append(1e-6 * (time.perf_counter_ns() - start))
                avatar.add(tick.time_ns, tick.pose)
                person.add(tick.person.time_ns, tick.person)
                moment = synchroniser.at(tick.time_ns)
                play = playout.step if states else playout.reset
                states.append(play(moment.of(avatar).value, moment.of(person).value, moment.time_ns))
                ticks.append(tick)
                watch(tick)
                keep(begins, tick, states[-1], tick_ms[-1])
    return judged(number, partner, ticks, states, np.array(tick_ms))


def as_captured(frames: Iterable[MarkerFrame]) -> Iterator[TickInput]:
    """A tick for each frame, for the time at which the person was seen."""
    return (TickInput(frame, frame.source_time_ns, frame.arrival_time_ns) for frame in frames)


def style_name(weights: Mapping[str, float]) -> str:
    """``{'angry': 0.5, 'neutral': 0.5}`` as ``'angry 0.5 + neutral 0.5'``; a pure style by its emotion alone."""
    parts = {emotion: weight for emotion, weight in weights.items() if weight > 0.0}
    if len(parts) == 1:
        return next(iter(parts))
    return " + ".join(f"{emotion} {weight:g}" for emotion, weight in parts.items())

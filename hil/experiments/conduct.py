"""A participant is taken through her plan: cue, avatar, answer, a row of the log, and the next trial."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.experiments.analysis.adaptive import AdaptiveSettings, answered, begin_run, next_weight
from highfive.hil.experiments.balance import PRACTICE
from highfive.hil.experiments.desk import Desk
from highfive.hil.experiments.plan import Plan, PlannedTrial
from highfive.hil.experiments.protocol import ADAPTIVE, CERTAINTY, Mode, Motion, Protocol
from highfive.hil.experiments.question import Question, Sheet, question_of, why_excluded
from highfive.hil.experiments.stage import (
    Asked,
    Played,
    RunFailedError,
    RunStoppedError,
    Stage,
    TrialBrokenOffError,
)  # fmt: skip
from highfive.hil.experiments.trial_log import TrialLog, source_row
from highfive.hil.experiments.trial_row import Outcome, TrialRow
from highfive.hil.experiments.words import page_words
from highfive.hil.runtime.clock import Clock

CUES = {
    Mode.INTERACTIVE.value: "go",
    Mode.NO_CONTINGENCY.value: "go",
    Mode.OWN_REPLAY.value: "watch",
    Mode.OTHER_REPLAY.value: "watch",
}
"""What the participant is to do in a block's trials: act, or only watch."""
S = 1_000_000_000


@dataclass(frozen=True)
class Conducted:
    """How a run ended.

    Attributes:
        asked: trials of this run.
        broken_off, excluded: of them.
        left: trials of the plan that are still to be asked.
        sourceless: trials of the plan that are not asked: what they would show again was broken off, or is no more.
        why: it ended before the plan did; empty where it did not.
    """

    asked: int
    broken_off: int
    excluded: int
    left: int
    sourceless: int = 0
    why: str = ""


@dataclass
class _Run:
    study: Path
    log: TrialLog
    protocol: Protocol
    desk: Desk
    stage: Stage
    clock: Clock
    question: Question
    asked: int = 0
    broken_off: int = 0
    excluded: int = 0


def conduct(
    study: Path, log: TrialLog, protocol: Protocol, desk: Desk, stage: Stage, clock: Clock, *,
    language: str = "en", advance: Callable[[], None] = lambda: None,
) -> Conducted:  # fmt: skip
    """Asks what is left of a participant's plan; every row is on the disk before the next trial begins.

    Args:
        study: its folder.
        log: of her session, open.
        protocol: the experiment.
        desk: what she and the experimenter are told and want.
        stage: plays the trials.
        clock: of all of it.
        language: of the instructions, one of the experiment's.
        advance: is called after each trial.

    Raises:
        RunFailedError: nothing tracks her any more; the trial is in the log as broken off.
        HighFiveError: a row cannot be written, or a trial that is shown again is not there.
    """
    run = _Run(study, log, protocol, desk, stage, clock, question_of(protocol, log.plan.keys))
    desk.open(**about(protocol, log.plan, run.question, language))
    for line in log.told:
        desk.tell(message=line)
    block, why = None, ""
    try:
        while (trial := log.following) is not None:
            _tell_progress(run, trial)
            if trial.block != block:
                desk.show(
                    "ready", block=trial.block, first=block is None, practice=trial.block == PRACTICE,
                    task=CUES[trial.mode],
                )  # fmt: skip
                desk.wait_ready()
                block = trial.block
            desk.show("wait", task=CUES[trial.mode])
            desk.wait(protocol.timing.between_s)
            if (after := log.begin()) is None:
                break
            block = after.block
            _trial(run, after)
            advance()
    except RunStoppedError as stopped:
        why = str(stopped)
    left, over = len(log.left), {row.trial for row in log.content.standing}
    desk.tell(message=why or "the session is over", left=left)
    desk.close(finished=not left)
    sourceless = sum(trial.name not in over for trial in log.plan.trials) - left
    return Conducted(run.asked, run.broken_off, run.excluded, left, sourceless, why)


def _trial(run: _Run, trial: PlannedTrial) -> None:
    """A trial that has begun is over, and in the log, however it ends."""
    run.asked += 1
    source = source_row(run.study, run.log, trial.source) if trial.source else None
    weights = dict(source.weights) if source is not None else _weights(run, trial)
    cue_ns: int | None = None

    def cued() -> None:
        nonlocal cue_ns
        cue_ns = run.clock.now()
        run.desk.show("cue", task=CUES[trial.mode])

    outcome = Outcome(weights=weights, broken_off="interrupted")
    after = next((_told(one) for one in run.log.left if one.name != trial.name), None)
    try:
        run.desk.begin_trial()
        run.desk.tell(
            trial=trial.name, ask=run.log.ask, style=trial.style, weights=weights, cell=trial.cell,
            condition=trial.mode, expected=trial.answer, answer="", asks="", message="", next=after,
        )  # fmt: skip
        played = run.stage.play(Asked(trial, run.log.ask, weights, source), cued)
        outcome = _answered(run, weights, cue_ns, played)
    except (TrialBrokenOffError, RunStoppedError, RunFailedError) as error:
        outcome = Outcome(weights=weights, broken_off=str(error), cue_ns=cue_ns)
        if not isinstance(error, TrialBrokenOffError):
            raise
    finally:
        row = run.log.finish(replace(outcome, notes=run.desk.notes()))
        run.broken_off += bool(row.broken_off)
        run.excluded += bool(row.excluded_why and not row.broken_off)
        run.desk.tell(last=_last(row))


def _answered(run: _Run, weights: Mapping[str, float], cue_ns: int | None, played: Played) -> Outcome:
    """What was answered to a trial that was played."""
    run.desk.tell(asks="answer")
    sheet = run.desk.ask(Sheet(run.question, run.clock.now()))
    if run.desk.breaks_off:
        raise TrialBrokenOffError("broken off by the experimenter")
    return Outcome(
        weights=weights, answer=sheet.answer, key=sheet.key, rt_s=_seconds(sheet.opened_ns, sheet.answer_ns),
        rt_contact_s=_seconds(played.contact_ns, sheet.answer_ns), certainty=sheet.values.get(CERTAINTY),
        ratings={name: value for name, value in sheet.values.items() if name != CERTAINTY},
        peak_speed=played.peak_speed, motion_s=_seconds(cue_ns, played.ended_ns), longest_gap_s=played.longest_gap_s,
        stalled_s=played.stalled_s,
        cue_ns=cue_ns, contact_ns=played.contact_ns, ended_ns=played.ended_ns,
        asked_ns=sheet.opened_ns, answer_ns=sheet.answer_ns, source_ns=played.source_ns,
        arrival_ns=played.arrival_ns, tick_ns=played.tick_ns, shown_ns=run.stage.shown_ns(), frame=played.frame,
        recording=played.recording, excluded_why=why_excluded(sheet),
    )  # fmt: skip


def _weights(run: _Run, trial: PlannedTrial) -> Mapping[str, float]:
    """The plan's; of an adaptive trial those that the answers before it make the next."""
    morph = run.protocol.morph
    if trial.style != ADAPTIVE or morph is None:
        return trial.weights
    share = next_weight(_adaptive_run(run, morph.end))
    return {morph.start: 1.0 - share, morph.end: share}


def _adaptive_run(run: _Run, second: str) -> Any:
    """All answers that she gave in interaction; pure styles are trials of the plan, so that none are drawn here."""
    seed = int(np.random.default_rng([run.log.plan.seed, run.log.plan.number]).integers(2**31))
    found = begin_run(seed, settings=AdaptiveSettings(easy=0.0))
    for row in run.log.content.standing:
        if row.condition == Mode.INTERACTIVE.value and row.answer and not row.excluded_why:
            found = answered(found, row.weights.get(second, 0.0), row.answer == second)
    return found


def _seconds(start_ns: int | None, end_ns: int | None) -> float | None:
    return None if start_ns is None or end_ns is None else round((end_ns - start_ns) / S, 6)


def _last(row: TrialRow) -> dict[str, Any]:
    """A row as the experimenter sees it."""
    return {
        "trial": row.trial, "style": row.style, "answer": row.answer, "expected": row.expected, "rt_s": row.rt_s,
        "why": row.broken_off or row.excluded_why, "notes": row.notes,
    }  # fmt: skip


def about(protocol: Protocol, plan: Plan, question: Question, language: str) -> dict[str, Any]:
    """What pages need to know once."""
    words = protocol.words.get(language, {})
    return {
        "name": protocol.name,
        "participant": plan.participant,
        "keys": dict(question.keys),
        "sliders": [
            {
                "name": one.name,
                "text": one.text,
                "low": one.low,
                "high": one.high,
                **words.get(f"sliders.{one.name}", {}),
                "points": one.points,
            }
            for one in question.sliders
        ],
        "limit_s": question.limit_s,
        "taps": protocol.motion is Motion.CLIPS,
        "language": language,
        "instructions": protocol.instructions[language],
        "words": page_words(words),
        "shown": {label: words.get("answers", {}).get(label, label) for label in question.keys},
    }


def _tell_progress(run: _Run, trial: PlannedTrial) -> None:
    """Blocks with how much of each is done, and what comes next."""
    done = {row.trial for row in run.log.content.standing}
    blocks = [_block(name, list(trials), done) for name, trials in groupby(run.log.plan.trials, lambda one: one.block)]
    run.desk.tell(blocks=blocks, next=_told(trial), left=len(run.log.left), asks="", trial="")


def _told(trial: PlannedTrial) -> dict[str, Any]:
    """A trial as the experimenter is told that it comes."""
    return {"trial": trial.name, "style": trial.style, "cell": trial.cell, "condition": trial.mode}


def _block(name: str, trials: Sequence[PlannedTrial], done: set[str]) -> dict[str, Any]:
    over = sum(trial.name in done for trial in trials)
    return {"name": name, "mode": trials[0].mode, "trials": len(trials), "done": over}

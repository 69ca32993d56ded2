"""How often the avatar reaches for a hand that is no high five, and whether it reaches late for one that is.

Sessions as they are played, without the last correction of the hand: markers, tracker, model, reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from highfive.hil.runtime.threads import parallel_map
from highfive.hil.session.doubt import DOUBT
from highfive.hil.session.reach import Phase
from highfive.hil.session.session import RATE_HZ, Session, Tick
from highfive.hil.sim.people.capture import PERSON_SET
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.distractors import (
    JUDGE_SEED,
    Drawn,
    Progress,
    distractor_partner,
    judging_gestures,
    judging_high_five,
)
from highfive.hil.trials.partners import Partner
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.reaction import probability_of_contact

LED = 0.05
"""A palm that is led with more than this weight is on its way to be seen."""
RAISED = 0.15
"""m, by which the avatar's palm has moved where it was raised."""
LATE_S = 0.05
"""A reach that begins by more than this after the one without a doubt is late."""
SOON_S = 0.2
"""From the hand's rise within which it should be decided."""
HIGH_FIVES = 36
_EACH = 12  # gestures, or high fives, of one job


@dataclass(frozen=True)
class GestureOutcome:
    """What came of a gesture.

    Attributes:
        gesture: its name.
        started: a reach began.
        led: the largest weight with which the palm was led.
        moved: m, how far the avatar's palm went from where it was.
        decided_s: from the hand's rise until no contact was expected any more: the last tick in which a reach could
            have begun, or was under way; 0 where there is none.
    """

    gesture: str
    started: bool
    led: float
    moved: float
    decided_s: float


@dataclass(frozen=True)
class HighFiveOutcome:
    """When a reach for a true high five began and met, s from the contact of the actors; None where it did not.

    Attributes:
        began, met: with the model as it is.
        began_before: where the model does not say whether a contact is coming.
    """

    began: float | None
    met: float | None
    began_before: float | None


@dataclass(frozen=True)
class _Job:
    model: HGPDM
    gestures: Sequence[Drawn]
    high_fives: Sequence[int]


def false_starts(
    model: HGPDM, progress: Progress = lambda total: lambda: None, rounds: int = 3, high_fives: int = HIGH_FIVES
) -> dict[str, Any]:
    """Judges a model on gestures and high fives of people on whom nothing is chosen; simulated ones.

    Args:
        model: the model.
        progress: called with the number of parts; what comes back is called after each.
        rounds: of each gesture in each emotion.
        high_fives: at most; those in which nobody can meet are left out.

    Returns:
        Shares, seconds and milliseconds; docs/evaluation.md says what each is.
    """
    gestures = judging_gestures(rounds)
    jobs = [_Job(model, gestures[n : n + _EACH], ()) for n in range(0, len(gestures), _EACH)]
    numbers = range(high_fives)
    jobs += [_Job(model, (), numbers[n : n + _EACH]) for n in range(0, high_fives, _EACH)]
    outcomes: list[GestureOutcome] = []
    met: list[HighFiveOutcome] = []
    for of_gestures, of_high_fives in parallel_map(_outcomes, jobs, progress):
        outcomes += of_gestures
        met += of_high_fives
    return {"simulated": True, "seed": JUDGE_SEED, **_of_gestures(outcomes), **_of_high_fives(met)}


def _outcomes(job: _Job) -> tuple[list[GestureOutcome], list[HighFiveOutcome]]:
    session = _session(job.model)
    gestures = [gesture_outcome(session, *distractor_partner(drawn), drawn.gesture) for drawn in job.gestures]
    known = [partner for partner in map(judging_high_five, job.high_fives) if partner is not None]
    if not known:
        return gestures, []
    before = _session(replace(job.model, intent=None))
    return gestures, [high_five_outcome(session, before, partner) for partner in known]


def _session(model: HGPDM) -> Session:
    style = {"neutral" if "neutral" in model.emotions else model.emotions[0]: 1.0}
    return Session(model, style, load_marker_set(PERSON_SET), build_scene(), correct=False)


def gesture_outcome(session: Session, partner: Partner, rise_s: float, gesture: str) -> GestureOutcome:
    """Plays a gesture whose hand rises at ``rise_s``."""
    ticks = _played(session, partner)
    reaching = np.array([tick.target.phase is not Phase.IDLE for tick in ticks])
    palm = np.array([tick.generated_palm.position for tick in ticks])
    rise = round(rise_s * RATE_HZ)
    open_ = reaching | np.array([_may_come(tick) for tick in ticks])
    last = np.flatnonzero(open_[rise:])
    return GestureOutcome(
        gesture,
        bool(reaching.any()),
        max(tick.target.weight for tick in ticks),
        float(np.linalg.norm(palm - palm[rise], axis=1).max()),
        float(last[-1] + 1) / RATE_HZ if len(last) else 0.0,
    )


def high_five_outcome(session: Session, before: Session, partner: Partner) -> HighFiveOutcome:
    """Plays a true high five in both sessions."""
    ticks = _played(session, partner)
    began, met = (_first(ticks, phase, partner) for phase in (Phase.APPROACH, Phase.TOUCH))
    return HighFiveOutcome(began, met, _first(_played(before, partner), Phase.APPROACH, partner))


def _played(session: Session, partner: Partner) -> list[Tick]:
    session.reset()
    return [session.step(frame) for frame in partner.frames()]


def _first(ticks: Sequence[Tick], phase: Phase, partner: Partner) -> float | None:
    found = (number for number, tick in enumerate(ticks) if tick.target.phase is phase)
    number = next(found, None)
    return None if number is None else (number - partner.contact_frame) / RATE_HZ


def _may_come(tick: Tick) -> bool:
    """A reach could begin, as far as the model's word goes."""
    probability = probability_of_contact(tick.response)
    return probability is not None and probability >= DOUBT.enough(tick.response.in_distribution)


def _of_gestures(outcomes: Sequence[GestureOutcome]) -> dict[str, Any]:
    names = dict.fromkeys(outcome.gesture for outcome in outcomes)
    by = {name: _shares([outcome for outcome in outcomes if outcome.gesture == name]) for name in names}
    return {**_shares(outcomes), "by_gesture": by}


def _shares(outcomes: Sequence[GestureOutcome]) -> dict[str, Any]:
    decided = np.array([outcome.decided_s for outcome in outcomes])
    return {
        "gestures": len(outcomes),
        "started": float(np.mean([outcome.started for outcome in outcomes])),
        "led": float(np.mean([outcome.led > LED for outcome in outcomes])),
        "raised": float(np.mean([outcome.moved > RAISED for outcome in outcomes])),
        "decided_s_median": float(np.median(decided)),
        "decided_s_p90": float(np.quantile(decided, 0.9)),
        "decided_soon": float(np.mean(decided <= SOON_S)),
    }


def _of_high_fives(outcomes: Sequence[HighFiveOutcome]) -> dict[str, Any]:
    both = [(o.began, o.began_before) for o in outcomes if o.began is not None and o.began_before is not None]
    delays = np.array([began - before for began, before in both])
    lost = [outcome.began is None and outcome.began_before is not None for outcome in outcomes]
    return {
        "high_fives": len(outcomes),
        "not_started": float(np.mean([outcome.began is None for outcome in outcomes])),
        "not_met": float(np.mean([outcome.met is None for outcome in outcomes])),
        "lost": float(np.mean(lost)),
        "late": float(np.mean(delays > LATE_S)) if len(delays) else 0.0,
        "delay_ms_median": 1e3 * float(np.median(delays)) if len(delays) else 0.0,
        "delay_ms_largest": 1e3 * float(delays.max()) if len(delays) else 0.0,
    }

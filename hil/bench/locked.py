"""How far the played palm is from a person's true palm, on the locked set (:mod:`highfive.hil.trials.locked_set`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.runtime.threads import parallel_map
from highfive.hil.session.session import Session
from highfive.hil.sim.people.actors import MOST_DRAWS
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.locked_set import NUMBER, SEED, LockedTrial, locked_partner, locked_trials
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.trial import run_trial
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.hgpdm.store import load_model

if TYPE_CHECKING:
    from highfive.hil.runtime.console import Bar

_MM = 1e3


def _correction_speed(result: TrialResult) -> float:
    """Largest speed, rad/s, that the correction adds to any hinge, or takes from it."""
    work = np.array([played.hinges - made.hinges for played, made in zip(result.poses, result.generated, strict=True)])
    return float(np.abs(np.diff(work, axis=0) / np.diff(result.times)[:, None, None]).max())


_FIGURES = {
    "true_error_mm": lambda r: _MM * r.touch_error,
    "true_error_at_contact_mm": lambda r: _MM * r.true_error,
    "closing_speed_m_s": lambda r: r.touch_speed,
    "before_correction_mm": lambda r: _MM * r.uncorrected_error,
    "correction_rad_s": _correction_speed,
    "tracked_error_mm": lambda r: _MM * r.error,
    "late_ms": lambda r: _MM * abs(r.time_error),
}
"""Name of a figure, with its unit, and how a trial gives it."""


def bench_locked(model: Path, bar: Bar, trials: Sequence[LockedTrial] | None = None) -> dict[str, Any]:
    """Plays the locked set and gives its figures; with one model they are the same every time.

    Args:
        model: the model's file.
        bar: shows progress.
        trials: a part of the set; None for all of it.

    Returns:
        ``trials``; ``missed``, those in which the palms did not touch; and figures of ``median``, ``p95`` and ``max``.
        Of first touch, which missed trials have not: ``true_error_mm``, between the played palm and the true one in
        that tick, and ``closing_speed_m_s``, of these two along their common normal. Of all trials:
        ``true_error_at_contact_mm``, the same distance where the played palm is nearest to the tracked one;
        ``before_correction_mm``, of the motion as generated at its nearest to the tracked one; ``correction_rad_s``,
        the largest speed that the correction adds to any hinge or takes from it; ``tracked_error_mm``, what it leaves
        of the distance. ``late_ms``: of the touch, either way. Then the same ``by_emotion`` and
        ``by_subject``; ``pairs_drawn``, to have pairs that can meet; ``never_met``, trials of the set that are not
        played because no pair could meet; and ``rows``.

    Raises:
        HighFiveError: the model cannot be read or is for another avatar.
    """
    loaded = load_model(model)
    asked = locked_trials() if trials is None else list(trials)
    chosen, partners = locked_partners(asked, bar)
    never = [trial for trial in asked if trial not in chosen]
    scene = build_scene()
    session = Session(loaded, {partners[0].emotion: 1.0}, partners[0].marker_set, scene)
    playout, results, advance = KinematicPlayOut(scene), [], bar("high fives", len(partners))
    for number, partner in enumerate(partners):
        session.set_style({partner.emotion: 1.0})
        results.append(run_trial(number, partner, session, playout))
        advance()
    names = [trial.name for trial in chosen]
    return {
        "locked_set": NUMBER,
        "seed": SEED,
        "model": model.name,
        "simulated": True,
        **_figures(results),
        "unwanted_contacts": sum(bool(r.contact.unwanted) for r in results),
        "pairs_drawn": sum(partner.draws for partner in partners) + MOST_DRAWS * len(never),
        "never_met": [f"{trial.name} {trial.emotion} {trial.cell}" for trial in never],
        "by_emotion": _grouped(results, [r.emotion for r in results]),
        "by_subject": _grouped(results, names),
        "rows": [_row(name, result) for name, result in zip(names, results, strict=True)],
    }


def locked_partners(trials: Sequence[LockedTrial], bar: Bar) -> tuple[list[LockedTrial], list[Partner]]:
    """Trials in which a pair could meet, and the person of each."""
    drawn = parallel_map(locked_partner, trials, lambda total: bar("people", total))
    met = [(trial, partner) for trial, partner in zip(trials, drawn, strict=True) if partner is not None]
    return [trial for trial, _ in met], [partner for _, partner in met]


def _figures(results: Sequence[TrialResult]) -> dict[str, Any]:
    missed = sum(not r.contact.met for r in results)
    return {
        "trials": len(results),
        "missed": missed,
        **{name: _extent(value(r) for r in results) for name, value in _FIGURES.items()},
    }


def _grouped(results: Sequence[TrialResult], names: Sequence[str]) -> dict[str, Any]:
    return {
        name: _figures([r for r, own in zip(results, names, strict=True) if own == name])
        for name in dict.fromkeys(names)
    }


def _extent(values: Iterable[float]) -> dict[str, float | None]:
    known = np.array([value for value in values if np.isfinite(value)])
    if not len(known):
        return {"median": None, "p95": None, "max": None}
    median, p95 = np.percentile(known, [50, 95])
    return {"median": round(float(median), 3), "p95": round(float(p95), 3), "max": round(float(known.max()), 3)}


def _row(subject: str, result: TrialResult) -> dict[str, Any]:
    figures = {name: float(value(result)) for name, value in _FIGURES.items()}
    known = {name: round(value, 3) if np.isfinite(value) else None for name, value in figures.items()}
    place = {"subject": subject, "emotion": result.emotion, "cell": result.cell}
    return {**place, "met": result.contact.met, "out_of_reach": result.out_of_reach, **known}


def print_locked(result: Mapping[str, Any]) -> None:
    """The figures for people."""
    of, trials, people = result["locked_set"], result["trials"], len(result["by_subject"])
    print(f"Locked set {of}: {trials} high fives of {people} simulated people")
    print(f"{result['pairs_drawn']} pairs were drawn to have {trials} that can meet", end="")
    print(f"; none could: {', '.join(result['never_met'])}" if result["never_met"] else "")
    heads = ("true palm, first touch, mm", "closing speed, m/s", "before correction, mm")
    print(f"{'':10}" + "".join(f"{head:>30}" for head in heads) + f"{'missed':>9}")
    print(f"{'':10}" + f"{'median / 95 % / worst':>30}" * len(heads))
    rows = {"all": result, **result["by_emotion"], **result["by_subject"]}
    for name, row in rows.items():
        shown = (
            _shown(row["true_error_mm"], 1),
            _shown(row["closing_speed_m_s"], 2),
            _shown(row["before_correction_mm"], 0),
        )
        print(f"{name:10}" + "".join(f"{text:>30}" for text in shown) + f"{row['missed']:>9}")
    print(f"at contact, from the true palm: {_shown(result['true_error_at_contact_mm'], 1)} mm; ", end="")
    print(f"from the palm as tracked: {_shown(result['tracked_error_mm'], 2)} mm")
    print(f"correction: up to {_shown(result['correction_rad_s'], 1)} rad/s of a joint, over the trials")


def _shown(extent: Mapping[str, float | None], digits: int) -> str:
    return " / ".join("–" if value is None else f"{value:.{digits}f}" for value in extent.values())

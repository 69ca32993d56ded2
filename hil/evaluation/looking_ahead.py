"""How early it is said where the palms will meet, over trainings and by emotion, as ``--json`` has it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from highfive.hil.evaluation.cross_validation import Run
from highfive.model.evaluation import forecast_errors as horizons
from highfive.model.evaluation.predictions import Prediction
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trials import Trial

KNOWN = 0.05
"""m; a contact point that is said so well, and from then on, is known."""


def looking_ahead(runs: Sequence[Run]) -> dict[str, Any]:
    """Median errors of the contact point so long before contact, m, the share of contacts in the 90 % regions, and
    since when before contact it is known; of several trainings the median, and the smallest and the largest."""
    errors = [horizons.contact_point_errors(run.trials, run.answers) for run in runs]
    coverage = [horizons.contact_point_coverage(run.trials, run.answers) for run in runs]
    result: dict[str, Any] = {
        "before_s": horizons.BEFORE.round(2).tolist(),
        "contact_point": _over_runs(errors),
        "contact_time": _over_runs([horizons.contact_time_errors(run.trials, run.answers) for run in runs]),
        "contact_point_within_90": _over_runs(coverage),
        "by_emotion": {
            emotion: {
                "contact_point": _over_runs([horizons.contact_point_errors(*_of(run, emotion)) for run in runs]),
                "known_to_5_cm_s": _known([_of(run, emotion) for run in runs]),
            }
            for emotion in dict.fromkeys(trial.emotion for trial in runs[0].trials)
        },
    }
    if len(runs) > 1:
        for name, pick in (("smallest", np.min), ("largest", np.max)):
            result[f"contact_point_{name}"] = _over_runs(errors, pick)
    return result


def _of(run: Run, emotion: str) -> tuple[list[Trial], dict[str, list[Prediction]]]:
    """Trials of one emotion, and what each method answered."""
    which = [number for number, trial in enumerate(run.trials) if trial.emotion == emotion]
    answers = {name: [given[number] for number in which] for name, given in run.answers.items()}
    return [run.trials[number] for number in which], answers


def _known(runs: Sequence[tuple[list[Trial], dict[str, list[Prediction]]]]) -> dict[str, float]:
    """Since when before contact it is known by each method, s: the median of trials, and of trainings."""
    since = [
        {name: np.median(horizons.known_since(trials, given, KNOWN)) for name, given in answers.items()}
        for trials, answers in runs
    ]
    return {name: round(float(np.median([run[name] for run in since])), 3) for name in since[0]}


def _over_runs(
    tables: Sequence[Mapping[str, Array]], summary: Callable[..., Any] = np.median
) -> dict[str, list[float | None]]:
    """The ``summary``, over trainings, of each entry of tables of the same names; None where one has none."""
    return {
        name: [
            round(v, 4) if np.isfinite(v) else None for v in summary([table[name] for table in tables], axis=0).tolist()
        ]
        for name in tables[0]
    }

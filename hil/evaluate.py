"""Scores of the model beside plain regressions: on held-out trials of a data folder, or on a windows file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hil.avatar import PALM_IN_RIGHT_WRIST, avatar_skeleton
from hil.console import Bar, training_bars
from hil.training_data import load_trials
from model import evaluation, training, windows
from model.errors import HighFiveError
from model.hgpdm import HGPDM
from model.hierarchy import problem
from model.optimise import ProgressCallback
from model.presets import Preset, preset_named
from model.store import load_model
from model.trials import Trial

Scored = dict[str, dict[str, float]]
"""Method → action or metric → value."""

MAKES_NO_CHOICE = ("knn", "ridge", "mean")  # the same whatever the seed


@dataclass(frozen=True)
class EvaluateOptions:
    """What to score and how; see ``highfive evaluate --help``."""

    data: Path | None
    windows: Path | None
    model: Path | None
    preset: str
    inducing: int
    seeds: int
    human: str
    avatar: str
    human_set: str | None
    avatar_set: str | None


def evaluate(options: EvaluateOptions, bar: Bar) -> dict[str, Any]:
    """Scores by method: the median over the seeds, and the smallest and largest.

    Raises:
        HighFiveError: nothing or too much to score, broken files, no held-out trials.
    """
    if (options.data is None) == (options.windows is None):
        raise HighFiveError("give either a data folder or --windows FILE.npz")
    preset = preset_named(options.preset)
    if options.windows is not None:
        if options.model is not None:
            raise HighFiveError("a windows file brings its own training part; leave the model out")
        runs, about = _on_windows(options.windows, preset, options, bar)
    else:
        assert options.data is not None
        runs, about = _on_trials(options.data, preset, options, bar)
    return {"scores": _over(runs, np.median), "smallest": _over(runs, np.min), "largest": _over(runs, np.max), **about}


def _over(runs: list[Scored], summary: Callable[[list[float]], Any]) -> Scored:
    """One value for each method and metric out of those of all seeds."""
    return {
        method: {name: float(summary([run[method][name] for run in runs])) for name in values}
        for method, values in runs[0].items()
    }


def _on_windows(path: Path, preset: Preset, options: EvaluateOptions, bar: Bar) -> tuple[list[Scored], dict[str, Any]]:
    learn, test = windows.read_windows(path)
    chosen = windows.window_preset(preset)
    task = problem(windows.window_set(learn), chosen)
    runs: list[Scored] = []
    for seed in range(options.seeds):
        step = training_bars(bar, f"seed {seed}, ")
        model = training.train_on(windows.window_set(learn), chosen, options.inducing, seed, progress=step)
        scores = {"hgpdm": windows.window_scores(windows.respond(model, test), test)}
        for name, predictor in evaluation.baseline_predictors(task, options.inducing, seed, step).items():
            scores[name] = windows.window_scores(windows.predicted(predictor, task.feature_map, test), test)
        runs.append(scores)
    unit = "m" if windows.is_person(test) else "rad²"
    return runs, {"windows": str(path), "unit": unit, "seeds": options.seeds, "points": len(learn.target)}


def _on_trials(folder: Path, preset: Preset, options: EvaluateOptions, bar: Bar) -> tuple[list[Scored], dict[str, Any]]:
    model = None if options.model is None else load_model(options.model, avatar_skeleton().hash)
    pairs = load_trials(
        folder,
        options.human,
        options.avatar,
        options.human_set,
        options.avatar_set,
        lambda total: bar("solving markers", total),
    )
    trials = [pair.trial for pair in pairs]
    if not any(trial.test for trial in trials):
        raise HighFiveError(f"{folder} has no held-out trial; mark some with split test in trials.csv")
    runs: list[Scored] = []
    for seed in range(options.seeds):
        step = training_bars(bar, f"seed {seed}, ")
        fitted = model or _train(trials, preset, options.inducing, seed, step)
        scores = evaluation.evaluate(fitted, trials, avatar_skeleton(), PALM_IN_RIGHT_WRIST, seed, step)
        runs.append({name: asdict(score) for name, score in scores.items()})
    held = sum(trial.test for trial in trials)
    about = {"data": str(folder), "model": None if options.model is None else str(options.model)}
    return runs, {**about, "seeds": options.seeds, "trials": len(trials) - held, "held_out_trials": held}


def _train(trials: list[Trial], preset: Preset, inducing: int, seed: int, progress: ProgressCallback) -> HGPDM:
    return training.train(trials, preset, None, inducing, seed, avatar_skeleton().hash, progress)

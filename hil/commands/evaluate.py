"""Scores of the model beside plain regressions: on held-out trials of a data folder, or on a windows file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from highfive.hil.commands.train import model_to_adapt
from highfive.hil.commands.training_memory import checked_memory
from highfive.hil.datasets.training_data import load_trials
from highfive.hil.evaluation.cross_validation import Run, run_protocol, trainings
from highfive.hil.evaluation.curves import learning_curve
from highfive.hil.evaluation.looking_ahead import looking_ahead
from highfive.hil.evaluation.model_cache import fit_windows, is_kept
from highfive.hil.evaluation.reaction_models import learner
from highfive.hil.evaluation.score_table import Scored
from highfive.hil.evaluation.shared_work import Training, in_processes
from highfive.hil.evaluation.training_progress import TrainingCount
from highfive.hil.report.terminal_tables import print_scores  # noqa: F401 (for the command line)
from highfive.hil.runtime.console import Bar, say_aside
from highfive.hil.runtime.folders import results_folder
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.trials.false_starts import false_starts
from highfive.hil.trials.locked_recordings import write_locked
from highfive.hil.trials.locked_set import NUMBER
from highfive.mocap_bridge.files.trial_table import read_table
from highfive.model.errors import HighFiveError
from highfive.model.evaluation import baselines
from highfive.model.evaluation import forecast_errors as horizons
from highfive.model.evaluation import nuisi_windows as windows
from highfive.model.evaluation import scores as evaluation
from highfive.model.evaluation.learning_curve import draws
from highfive.model.evaluation.mixture_reach import MixtureReach, mixture_forecasts
from highfive.model.evaluation.splits import Fold, leave_out, left_out_in_turn, own_split
from highfive.model.files import UNFINISHED
from highfive.model.gp.optimise import ProgressCallback
from highfive.model.hgpdm.dataset import MINIMUM_POINTS
from highfive.model.hgpdm.memory import points_of
from highfive.model.hgpdm.presets import Preset, preset_named
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trials import Trial

MODELS = "models"
"""Folder of a report's trainings, from which an interrupted run goes on."""


@dataclass(frozen=True)
class EvaluateOptions:
    """What to score and how; see ``highfive evaluate --help``."""

    data: Path | None = None
    windows: Path | None = None
    model: Path | None = None
    preset: str = "default"
    inducing: int = 200
    seeds: int = 3
    human: str = "human"
    avatar: str = "avatar"
    human_set: str | None = None
    avatar_set: str | None = None
    leave_out: str | None = None
    out: Path | None = None
    overwrite: bool = False
    also: tuple[str, ...] = ()
    locked: bool = False
    gestures: bool = True
    learning_curve: tuple[int, ...] = ()
    start: str | None = None
    jobs: int = 1
    models: Path | None = None

    @property
    def kept(self) -> Path | None:
        """The folder in which trainings are kept, if any."""
        return self.models or (None if self.out is None else self.out / MODELS)


def evaluate(options: EvaluateOptions, bar: Bar) -> dict[str, Any]:
    """Scores by method: the median over the seeds, and the smallest and largest; with ``out`` also a report.

    Raises:
        HighFiveError: nothing or too much to score, broken files, no held-out trials, or a folder that holds something
            else than an evaluation that was not finished.
    """
    if options.out is None:
        return _evaluate(options, bar)
    with results_folder(options.out, options.overwrite, resumed=_trainings):
        return _evaluate(options, bar)


def _evaluate(options: EvaluateOptions, bar: Bar) -> dict[str, Any]:
    if (options.data is None) == (options.windows is None):
        alone = f"{options.model} alone cannot be scored; " if options.model and not options.data else ""
        raise HighFiveError(f"{alone}give either a data folder or --windows FILE.npz")
    if options.locked and (options.windows is not None or options.leave_out is not None):
        word = "a windows file" if options.windows is not None else "--leave-out"
        raise HighFiveError(f"--locked brings its own people to judge on, and so does {word}; leave one of them out")
    _check_curve(options)
    preset = preset_named(options.preset)
    kept = options.kept
    if options.windows is not None:
        if options.model is not None or options.leave_out is not None:
            word = "the model" if options.model is not None else "--leave-out"
            raise HighFiveError(f"a windows file brings its own training part; leave {word} out")
        if options.also:
            raise HighFiveError("a model of your own (--also) answers trials of a data folder, not a windows file")
        return _on_windows(options.windows, preset, options, kept, bar)
    if options.model is not None and options.leave_out is not None:
        raise HighFiveError("--leave-out trains models of its own; leave the model out")
    assert options.data is not None
    return _on_trials(options.data, preset, options, kept, bar)


def _check_curve(options: EvaluateOptions) -> None:
    """Raises :class:`HighFiveError` where a learning curve, or a model to adapt, does not go with the rest."""
    if options.learning_curve and min(options.learning_curve) < 1:
        raise HighFiveError(f"--learning-curve {min(options.learning_curve)}; at least one trial a style is needed")
    if options.learning_curve and (options.model is not None or options.leave_out is not None):
        word = "the model" if options.model is not None else "--leave-out"
        raise HighFiveError(f"--learning-curve trains models on parts of the training trials; leave {word} out")
    if options.jobs > 1 and options.kept is None:
        raise HighFiveError("--jobs needs a folder of trainings that the processes share; give --out or --models")
    if (options.jobs > 1 or options.models is not None) and options.windows is not None:
        raise HighFiveError("--jobs and --models share out trainings of a data folder, not of a windows file")
    if options.start is not None and (options.model is not None or options.windows is not None):
        word = "a windows file" if options.windows is not None else "a model that is trained already"
        raise HighFiveError(f"--from adapts a model to trials of a data folder, not to {word}")


def after_interruption(options: EvaluateOptions) -> str:
    """How an interrupted evaluation goes on."""
    if options.kept is None:
        return ""
    found = options.kept.iterdir() if options.kept.is_dir() else ()
    there = any(is_kept(path) and not path.name.startswith(UNFINISHED) for path in found)
    return f"; the same command goes on from {options.kept}" if there else "; nothing is kept yet"


def _trainings(entry: Path) -> bool:
    """Whether this is the folder of an interrupted evaluation's trainings, and nothing else is in it."""
    return entry.name == MODELS and entry.is_dir() and all(is_kept(path) for path in entry.iterdir())


def _summary(runs: list[Scored]) -> dict[str, Scored]:
    return {"scores": _over(runs, np.median), "smallest": _over(runs, np.min), "largest": _over(runs, np.max)}


def _over(runs: list[Scored], summary: Callable[[list[float]], Any]) -> Scored:
    """One value for each method and metric out of those of all seeds."""
    return {
        method: {name: float(summary([run[method][name] for run in runs])) for name in values}
        for method, values in runs[0].items()
    }


def _on_windows(path: Path, preset: Preset, options: EvaluateOptions, kept: Path | None, bar: Bar) -> dict[str, Any]:
    learn, test = windows.read_windows(path)
    chosen = windows.window_preset(preset, learn)
    unit = "m" if test.person is not None else f"{test.unit}²"
    most = windows.most_sequences(learn)
    counts = [n for n in sorted(set(options.learning_curve)) if n <= most] or [most]
    if options.learning_curve:
        _say_left_out(options.learning_curve, counts, most, "sequences of an action")
    count = TrainingCount(bar, options.seeds * len(counts), say_aside)

    def scored(part: windows.Windows, seed: int, name: str) -> Scored:
        fitted = fit_windows(part, chosen, options.inducing, seed, kept, count.next(name))
        scores = {"hgpdm": windows.window_scores(windows.respond(fitted.model, test), test)}
        task = fitted.task
        baseline = {"sparse_gp": baselines.regression(fitted.sparse_gp), **evaluation.plain_baselines(task)}
        for method, predictor in baseline.items():
            scores[method] = windows.window_scores(windows.predicted(predictor, task.feature_map, test), test)
        return scores

    if options.learning_curve:
        drawn = [
            [scored(windows.few_sequences(learn, n, s), s, f"{n} an action, draw {s}") for s in range(options.seeds)]
            for n in counts
        ]
        runs = drawn[-1]
    else:
        drawn, runs = [], [scored(learn, seed, f"seed {seed}") for seed in range(options.seeds)]
    about = {"windows": str(path), "unit": unit, "seeds": options.seeds, "points": len(learn.target)}
    result = {**_summary(runs), **about, "preset": preset.name, "inducing": options.inducing}
    if drawn:
        result["learning_curve"] = learning_curve(counts, drawn, unit)
    return _reported(result, options.out, None, ())


def _check_counts(folds: Sequence[Fold], preset: Preset) -> None:
    """Raises HighFiveError, before any training, of a number of trials that is too few to learn from."""
    for fold in folds:
        learned = [trial for trial in fold.trials if not trial.test]
        rate = min(trial.rate_hz for trial in learned)
        lengths = [len(trial.joints) / trial.rate_hz for trial in learned]
        if (points := points_of(lengths, rate, learned[0].joints.shape[1], preset).points) < MINIMUM_POINTS:
            least = f"{points} training points, at least {MINIMUM_POINTS} are needed"
            raise HighFiveError(f"--learning-curve: {fold.name} gives {least}; leave that number out")


def _say_left_out(asked: Sequence[int], used: Sequence[int], most: int, what: str) -> None:
    if left := [str(count) for count in sorted(set(asked) - set(used))]:
        say_aside(f"--learning-curve: {' and '.join(left)} left out; the most there is to learn from is {most} {what}")


def _check_memory(lengths: Sequence[float], preset: Preset, options: EvaluateOptions) -> None:
    each = options.seeds * max(1, len(set(options.learning_curve)))
    at_once = options.jobs if options.leave_out else min(options.jobs, each)
    checked_memory(lengths, preset, options.inducing, at_once=at_once)


def _on_trials(folder: Path, preset: Preset, options: EvaluateOptions, kept: Path | None, bar: Bar) -> dict[str, Any]:
    model = None if options.model is None else load_model(options.model, avatar_skeleton().hash)
    rows = read_table(folder)
    if options.leave_out is not None:  # what is wrong with the table is reported before any marker is solved
        left_out_in_turn(rows, options.leave_out)
    if model is not None and not options.locked and not any(row.test for row in rows):
        advice = "mark some with split test in trials.csv and train again, or leave the model out"
        raise HighFiveError(f"{folder} has no held-out trial with a contact; {advice}")
    pairs = load_trials(
        folder,
        options.human,
        options.avatar,
        options.human_set,
        options.avatar_set,
        lambda total: bar("solving markers", total),
        learn_only=options.locked,
        hold_out=model is None and options.leave_out is None and not options.locked,
        lengths=(lambda _: None) if model is not None else partial(_check_memory, preset=preset, options=options),
    )
    trials = [pair.trial for pair in pairs] + (_locked_trials(bar) if options.locked else [])
    folds = own_split(trials) if options.leave_out is None else leave_out(trials, options.leave_out)
    others = {name: learner(name) for name in options.also}
    prior = None if options.start is None else model_to_adapt(options.start)
    parts = [draws(trials, options.learning_curve, seed) for seed in range(options.seeds)]
    if options.learning_curve:
        used = [int(fold.name.partition(" ")[0]) for fold in parts[0]]
        styles = Counter(trial.emotion for trial in trials if not trial.test)
        _say_left_out(options.learning_curve, used, max(styles.values(), default=0), "trials of a style")
        _check_counts([fold for drawn in parts for fold in drawn], preset)
    each = len(parts[0]) if options.learning_curve else trainings(folds, options.leave_out)
    count = TrainingCount(bar, options.seeds * each, say_aside)

    def run(folds: Sequence[Fold], seed: int) -> Run:
        named = partial(_fold_steps, count, seed, "" if options.learning_curve else "without ")
        what = options.leave_out
        return run_protocol(folds, what, preset, options.inducing, seed, kept, named, model, others, prior)

    if kept is not None and model is None and (options.jobs > 1 or options.models is not None):
        seeded = [(fold, seed) for seed in range(options.seeds) for fold in (parts[seed] or folds)]
        work = [Training(fold.name, fold.trials, preset, options.inducing, seed, prior) for fold, seed in seeded]
        in_processes(work, kept, options.jobs)
    drawn: list[list[Run]] = []
    if options.learning_curve:
        drawn = [[run([fold], seed) for fold in parts[seed]] for seed in range(options.seeds)]
        runs = [of_seed[-1] for of_seed in drawn]
    else:
        runs = [run(folds, seed) for seed in range(options.seeds)]
    about = {
        "data": str(folder),
        "model": None if options.model is None else str(options.model),
        "preset": preset.name if model is None else model.preset.name,
        "inducing": options.inducing if model is None else int(model.avatar.inducing.shape[0]),
        "seeds": options.seeds,
        "trials": len(trials) if options.leave_out else sum(not trial.test for trial in trials),
        "held_out_trials": len(runs[0].trials),
        "recorded": evaluation.recorded_smoothness(runs[0].trials),
    }
    if options.locked:
        about |= {"locked": True, "locked_set": NUMBER}
    if options.leave_out is not None:
        about |= {"leave_out": options.leave_out, "folds": len(folds), "by_fold": runs[0].by_fold()}
    about["false_starts"] = (
        None if model is None or not options.gestures else false_starts(model, lambda total: bar("false starts", total))
    )
    if options.start is not None:
        about |= {"from": options.start}
    ahead = looking_ahead(runs)
    if len(folds) == 1 and not drawn:  # else no one training saw none of the held-out trials
        mixture = MixtureReach(runs[0].fitted.task, folds[0].trials)
        about["forecast_mixture"] = mixture_forecasts(
            runs[0].trials, runs[0].answers["hgpdm"], mixture, horizons.BEFORE
        )
        ahead["contact_point"]["gaussian_mixture"] = about["forecast_mixture"]["contact_point"]
    result = {**_summary([run.scores for run in runs]), **about, "looking_ahead": ahead}
    if drawn:
        counts = [int(fold.name.split()[0]) for fold in parts[0]]
        result["learning_curve"] = learning_curve(
            counts, [[run.scores for run in row] for row in zip(*drawn, strict=True)]
        )
    return _reported(result, options.out, runs[0], folds[0].trials)


def _locked_trials(bar: Bar) -> list[Trial]:
    """The people of the locked set, captured, tracked and solved as those of a data folder."""
    with TemporaryDirectory() as folder:
        write_locked(Path(folder), lambda total: bar("the locked set", total))
        pairs = load_trials(Path(folder), progress=lambda total: bar("solving the locked set", total))
    return [pair.trial for pair in pairs]


def _reported(result: dict[str, Any], out: Path | None, run: Run | None, trials: Sequence[Trial]) -> dict[str, Any]:
    """The result, once its report is written, if one is requested."""
    if out is None:
        return result
    from highfive.hil.report.evaluation_report import write_evaluation  # noqa: PLC0415 (matplotlib takes a second)

    return {**result, "report": str(write_evaluation(out, result, run, trials))}


def _fold_steps(count: TrainingCount, seed: int, word: str, fold: str) -> ProgressCallback:
    return count.next(f"seed {seed}, {word}{fold}" if fold else f"seed {seed}")

"""Runs a protocol: trains once for each fold, and scores each held-out trial by a training that did not see it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from highfive.hil.evaluation.model_cache import Fitted, fit
from highfive.hil.evaluation.score_table import Scored
from highfive.hil.evaluation.step_times import step_times
from highfive.hil.runtime.console import say_aside
from highfive.hil.session.open_responder import open_responder
from highfive.hil.sim.avatar import PALM_IN_RIGHT_WRIST, avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.evaluation import baselines
from highfive.model.evaluation import scores as evaluation
from highfive.model.evaluation.predictions import Body, Method, Prediction, online, reacting, regressed
from highfive.model.evaluation.splits import Fold, leave_out
from highfive.model.geometry.rotations import Array
from highfive.model.gp.optimise import ProgressCallback
from highfive.model.hgpdm.presets import Preset
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.reaction import FitReactionModel

Steps = Callable[[str], ProgressCallback]
"""From the name of a fold to what is called after each of its steps."""


@dataclass(frozen=True)
class Run:
    """A protocol with one seed.

    Attributes:
        fitted: the training of the first fold.
        trials: the held-out trials of all folds.
        folds: which fold each of them is from.
        answers: method → answer to each trial.
        held: what was recorded.
        scores: method → metric → value.
        seen: method → (n,) m, error at contact of each trial by a training that saw its cell, where that was requested.
    """

    fitted: Fitted
    trials: list[Trial]
    folds: list[str]
    answers: dict[str, list[Prediction]]
    held: evaluation.HeldOut
    scores: Scored
    seen: dict[str, Array]

    def by_fold(self) -> dict[str, Scored]:
        """Fold → method → mean distance of the palms at contact, m, and the same when the cell was seen."""
        table: dict[str, Scored] = {}
        for fold in dict.fromkeys(self.folds):
            chosen = [name == fold for name in self.folds]
            table[fold] = {}
            for method, answers in self.answers.items():
                errors = evaluation.contact_errors(self.trials, answers)[chosen]
                table[fold][method] = {"palm_at_contact": float(errors.mean())}
                seen = self.seen[method][chosen] if method in self.seen else np.zeros(0)
                if np.any(np.isfinite(seen)):
                    table[fold][method]["palm_at_contact_seen"] = float(np.nanmean(seen))
        return table


def body() -> Body:
    """The avatar's body."""
    return Body(avatar_skeleton(), PALM_IN_RIGHT_WRIST)


def methods(fitted: Fitted) -> dict[str, Method]:
    """The model and all baselines of one training."""
    task, avatar = fitted.task, body()
    plain = evaluation.plain_baselines(task)
    return {
        "hgpdm": online(fitted.model, avatar),
        **({} if fitted.adapted is None else {"adapted": online(fitted.adapted, avatar)}),
        "sparse_gp": regressed(baselines.regression(fitted.sparse_gp), task, avatar, fitted.sparse_gp),
        **{name: regressed(regression, task, avatar) for name, regression in plain.items()},
        **{
            name: reacting(partial(open_responder, model, patience=None), avatar)
            for name, model in fitted.others.items()
        },
    }


def run_protocol(
    folds: Sequence[Fold],
    what: str | None,
    preset: Preset,
    inducing: int,
    seed: int,
    kept: Path | None,
    steps: Steps,
    model: HGPDM | None = None,
    others: Mapping[str, FitReactionModel] = MappingProxyType({}),
    prior: HGPDM | None = None,
) -> Run:
    """Trains and scores with one seed.

    Args:
        folds: trainings and what they do not see.
        what: ``repetition`` or ``cell``, what is left out in turn, or None.
        preset: of the model.
        inducing: inducing inputs of each layer.
        seed: seed of the training.
        kept: folder of trainings, see :func:`highfive.hil.evaluation.model_cache.fit`.
        steps: makes the progress bars.
        model: a model that is trained already, scored instead.
        others: learn models of somebody else's, by name, which are scored beside it.
        prior: a model that was trained before, adapted to each fold's trials and scored beside it, too.

    Raises:
        HighFiveError: the data cannot be learned from, or no held-out trial is of an emotion that was learned.
    """

    known = scorable(folds, model)

    def train(fold: Fold) -> Fitted:
        return fit(fold.trials, preset, inducing, seed, kept, steps(fold.name), model, others, prior)

    found = [
        _Scored(fold, fitted := train(fold), indices, _answered(fold, fitted, indices))
        for fold, indices in zip(folds, known, strict=True)
    ]
    trials = [part.fold.trials[index] for part in found for index in part.indices]
    fitted = found[0].fitted
    answers = {name: [a for part in found for a in part.answers[name]] for name in found[0].answers}
    held = evaluation.held_out(trials, answers["hgpdm"], body())
    scores = {name: evaluation.score(trials, given, held, body()) for name, given in answers.items()}
    for name, times in step_times(fitted, evaluation.plain_baselines(fitted.task), trials[0]).items():
        scores[name] |= {f"step_ms_p{part}": float(np.percentile(times, part)) for part in (50, 99)}
    seen: dict[str, Array] = {}
    if what == "cell":
        order = [index for part in found for index in part.indices]
        seen = {name: errors[order] for name, errors in _errors_when_seen(folds[0].trials, train).items()}
        for name, errors in seen.items():
            scores[name] |= _against_seen(evaluation.contact_errors(trials, answers[name]), errors)
    names = [part.fold.name for part in found for _ in part.indices]
    return Run(fitted, trials, names, answers, held, scores, seen)


@dataclass(frozen=True)
class _Scored:
    """A fold, its training, the indices of its held-out trials that can be scored, and each method's answers."""

    fold: Fold
    fitted: Fitted
    indices: list[int]
    answers: dict[str, list[Prediction]]


def _answered(fold: Fold, fitted: Fitted, indices: Sequence[int]) -> dict[str, list[Prediction]]:
    """Each method's answers to some trials of the fold."""
    return {name: [method(fold.trials[i]) for i in indices] for name, method in methods(fitted).items()}


def scorable(folds: Sequence[Fold], model: HGPDM | None = None) -> list[list[int]]:
    """Indices of each fold's held-out trials of emotions that its training, or the ``model``, knows.

    Raises:
        HighFiveError: nothing is left in any fold.
    """
    known = []
    for fold in folds:
        taught = {trial.emotion for trial in fold.trials if not trial.test} if model is None else set(model.emotions)
        known.append(learned(fold, taught))
    refuse_none([fold.trials[index] for fold, indices in zip(folds, known, strict=True) for index in indices])
    return known


def learned(fold: Fold, emotions: Collection[str]) -> list[int]:
    """Indices of the held-out trials of a fold that are of ``emotions``; says which emotions are missing."""
    if missing := {fold.trials[index].emotion for index in fold.held_out} - set(emotions):
        where = f" of {fold.name}" if fold.name else ""
        say_aside(f"{', '.join(sorted(missing))}: not learned; held-out trials{where} that show it are not scored")
    return [index for index in fold.held_out if fold.trials[index].emotion in emotions]


def refuse_none(trials: Sequence[Trial]) -> None:
    """Raises :class:`HighFiveError` where nothing is left that can be scored."""
    if not trials:
        raise HighFiveError("no held-out trial is of an emotion that was learned")


def trainings(folds: Sequence[Fold], what: str | None) -> int:
    """How many trainings :func:`run_protocol` needs for these folds with one seed."""
    return len(folds) + (len(_seen_folds(folds[0].trials)) if what == "cell" else 0)


def _seen_folds(trials: Sequence[Trial]) -> list[Fold]:
    """Folds in which each trial is left out, but not its cell; none where no repetitions are known."""
    try:
        return list(leave_out(trials, "repetition"))
    except HighFiveError:
        return []


def _errors_when_seen(trials: Sequence[Trial], train: Callable[[Fold], Fitted]) -> dict[str, Array]:
    """Errors (trials,), m, at contact, each by a training that saw other repetitions of the trial's cell, else NaN.

    Where no repetitions are known there is nothing to say: {}.
    """
    seen: dict[str, Array] = {}
    for fold in _seen_folds(trials):
        fitted = train(fold)
        known = {(t.cell, t.emotion) for t in fold.trials if not t.test and t.emotion in fitted.emotions}
        for name, method in methods(fitted).items():
            errors = seen.setdefault(name, np.full(len(trials), np.nan))
            for index in fold.held_out:
                trial = fold.trials[index]
                if (trial.cell, trial.emotion) in known:
                    errors[index] = evaluation.contact_errors([trial], [method(trial)])[0]
    return seen


def _against_seen(unseen: Array, seen: Array) -> dict[str, float]:
    """The same trials' errors at contact when their cell was seen, and the ratios of means and medians."""
    both = np.isfinite(seen)
    if not np.any(both):
        return {}
    unseen, seen = unseen[both], seen[both]
    return {
        "palm_at_contact_seen": float(seen.mean()),
        "palm_at_contact_median_seen": float(np.median(seen)),
        "unseen_over_seen": float(unseen.mean() / seen.mean()),
        "unseen_over_seen_median": float(np.median(unseen) / np.median(seen)),
    }

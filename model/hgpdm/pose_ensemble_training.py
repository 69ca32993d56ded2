"""Learns what answers beside the hierarchy, and how sure the pool is, from trials that were left out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import chdtri

from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.coregionalisation import initial_style
from highfive.model.gp.kernels import MotionKernel
from highfive.model.gp.optimise import ProgressCallback
from highfive.model.gp.posterior import Posterior
from highfive.model.gp.regression import learned
from highfive.model.gp.sparse import Layer, Targets
from highfive.model.hgpdm.arm_features import arm_history, fit_arm_features, with_arms
from highfive.model.hgpdm.dataset import TrainingSet, sample_times
from highfive.model.hgpdm.hierarchy import Problem
from highfive.model.hgpdm.pose_ensemble import (
    HIERARCHY,
    NEAREST,
    NEIGHBOURS,
    REGRESSION,
    ArmAnswer,
    Neighbours,
    PoseEnsemble,
)
from highfive.model.hgpdm.tempo import tempo_history
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class EnsembleTrainingSettings(Settings):
    """How the ensemble learns. Set by hand."""

    iterations: int = setting(60, "steps", least=1)
    """More fit the training points better, and the pool no longer."""
    least_noise: float = setting(5e-3, above=0.0)
    most_noise: float = setting(1.0, above=0.0)
    """Bounds of the regression's noise, as for the avatar layer."""
    folds: int = setting(4, least=2)
    """Of trials, for the calibration."""
    region: float = setting(0.9, above=0.0, most=0.99)
    """Share of the recorded values that the pool's central intervals of this size should hold."""
    usual: float = setting(0.99, above=0.0, most=1.0)
    """Share of such points whose neighbours are as near as a hand's must be for the direct answers to count in full."""
    worth: float = setting(0.02, above=0.0, most=1.0)
    """Share of the error that the whole arm has to take off."""
    narrowest: float = setting(0.5, above=0.0)
    widest: float = setting(4.0, above=0.0)
    """Bounds of a channel's factor."""

    @property
    def noise(self) -> tuple[float, float]:
        """Both bounds."""
        return self.least_noise, self.most_noise


ARM_SHARES = (0.0, 0.2, 0.4)
"""Of what the whole arm says. Half was another percent better where people walk, and would lean on it more."""
ONLINE = 1.08
"""Deviations that the filter says over those by the back projections alone: 1.03 to 1.1 in the channels that matter."""
_FAR = 1e9
ENSEMBLE_TRAINING = EnsembleTrainingSettings()


def regression_layer(
    task: Problem,
    inducing: int,
    rng: np.random.Generator,
    iterations: int,
    noise: tuple[float, float],
    stage: str,
    progress: ProgressCallback | None = None,
) -> tuple[Layer, jax.Array]:
    """Plain sparse GP regression from features to channels, motion × style kernel: the layer and its noise variance."""
    features, styles, targets = jnp.asarray(task.features), jnp.asarray(task.data.styles), task.avatar_targets
    chosen = np.sort(rng.choice(len(features), size=min(inducing, len(features)), replace=False))
    style = initial_style(styles.shape[1], styles[chosen])
    start = Layer(MotionKernel.initial(features.shape[1]), features[chosen], sparse.raw_noise(0.2, noise), style)
    return learned(start, features, targets, noise, iterations, iterations // 2, stage, progress, styles)


def regression_posterior(
    layer: Layer, noise: jax.Array, task: Problem, rows: NDArray[np.bool_] | None = None
) -> Posterior:
    """The regression as learned from the points ``rows`` (N,), all by default."""
    kept = np.ones(len(task.features), bool) if rows is None else rows
    scaled = jnp.asarray((task.data.outputs[kept] - task.avatar_offset) / task.avatar_scale)
    styles = jnp.asarray(task.data.styles[kept])
    offset, scale = jnp.asarray(task.avatar_offset), jnp.asarray(task.avatar_scale)
    return sparse.fit(layer, jnp.asarray(task.features[kept]), scaled, noise, styles, offset, scale)


class SeenArms(NamedTuple):
    """The whole arm at the training points.

    Attributes:
        known: (N,) where it is known; of these n:
        arms: (n, H + 1, 15) m, now and before, see :func:`highfive.model.hgpdm.arm_features.arm_history`.
        tempo: (n, TEMPO), of the reach.
    """

    known: NDArray[np.bool_]
    arms: Array
    tempo: Array


def seen_arms(trials: Sequence[Trial], data: TrainingSet) -> SeenArms:
    """The arms of the trials from which ``data`` was sampled."""
    armed = with_arms(trials)
    times = [sample_times(trials[index], data.lag) for index in armed]
    looks = (arm_history, tempo_history)
    arms, tempo = (
        np.concatenate([look(trials[index], at) for index, at in zip(armed, times, strict=True)]) for look in looks
    )
    return SeenArms(np.isin(data.trial, armed), arms, tempo)


def fit_ensemble(
    model: HGPDM,
    task: Problem,
    inducing: int,
    seed: int,
    progress: ProgressCallback | None = None,
    settings: EnsembleTrainingSettings = ENSEMBLE_TRAINING,
    seen: SeenArms | None = None,
) -> tuple[PoseEnsemble, LeftOut | None]:
    """Learns what answers beside a trained hierarchy; and what of it is said of trials that were left out.

    Args:
        model: the hierarchy, with back projections from the hand's features.
        task: its training points.
        inducing: inducing inputs of the regression.
        seed: of their choice.
        progress: called after every step.
        settings: as said there.
        seen: the whole arm; None where it is not to be learned from.
    """
    rng = np.random.default_rng(seed)
    stage = "direct answers"
    layer, noise = regression_layer(task, inducing, rng, settings.iterations, settings.noise, stage, progress)
    regression = regression_posterior(layer, noise, task)
    left_out = _left_out(task, layer, noise, settings)
    if left_out is None:
        return PoseEnsemble(regression, neighbours_of(task, None), np.ones(len(task.avatar_scale))), None
    pool, deviation = _pool_errors(model, task, regression, left_out)
    arm = None
    if seen is not None:
        arm, left_out = _fit_arm(task, seen, pool, left_out, inducing, rng, progress, settings)
    return PoseEnsemble(regression, neighbours_of(task, left_out), _spread(pool, deviation, settings), arm), left_out


def _fit_arm(
    task: Problem, seen: SeenArms, pool: Array, left_out: LeftOut, inducing: int, rng: np.random.Generator,
    progress: ProgressCallback | None, settings: EnsembleTrainingSettings,
) -> tuple[ArmAnswer | None, LeftOut]:  # fmt: skip
    """What the whole arm says of the pose, None where that is not worth it; beside what is said of trials left out.

    Its share is the one with which the pool, of errors ``pool`` (N, channels) without it, errs least there: over the
    points at which the arm is known, each channel in its own scale.
    """
    features = fit_arm_features(seen.arms, seen.tempo)
    armed = _from(task, seen.known, features(seen.arms, seen.tempo))
    layer, noise = regression_layer(armed, inducing, rng, settings.iterations, settings.noise, "whole arm", progress)
    error = left_out.direct.copy()
    error[seen.known] = own = _regression_errors(armed, layer, noise, _folds(task, settings))
    known = pool[seen.known]
    errors = [
        np.sqrt(np.mean((((1.0 - share) * known + share * own) / task.avatar_scale) ** 2)) for share in ARM_SHARES
    ]
    best = int(np.argmin(errors))
    if errors[best] > (1.0 - settings.worth) * errors[0]:
        return None, left_out
    arm = ArmAnswer(features, regression_posterior(layer, noise, armed), np.array(ARM_SHARES[best]))
    return arm, left_out._replace(arm=error, share=ARM_SHARES[best])


def _from(task: Problem, rows: NDArray[np.bool_], features: Array) -> Problem:
    """The points ``rows`` (N,) with other ``features`` (n, F), for a regression to the same channels."""
    data, targets = task.data, task.avatar_targets
    parts = {name: getattr(data, name)[rows] for name in ("outputs", "styles", "trial")}
    kept = Targets(targets.thin[rows], targets.channels, targets.discarded * float(np.mean(rows)))
    return replace(task, data=replace(data, **parts), features=features, avatar_targets=kept)


class LeftOut(NamedTuple):
    """At each training point, by the trials of other folds.

    Attributes:
        regression, neighbours: (N, channels) errors of the direct answers.
        distance: (N,) of the :data:`NEAREST`-th point.
        fold: (N,) that each point was left out with.
        arm: (N, channels) errors of what the whole arm says, where it is not known those of the other direct answers;
            None where it is not asked.
        share: of that in the pool.
    """

    regression: Array
    neighbours: Array
    distance: Array
    fold: NDArray[np.int64]
    arm: Array | None = None
    share: float = 0.0

    @property
    def direct(self) -> Array:
        """(N, channels) errors of both direct answers, as they are pooled."""
        return (REGRESSION * self.regression + NEIGHBOURS * self.neighbours) / (REGRESSION + NEIGHBOURS)

    @property
    def with_arm(self) -> Array:
        """(N, channels) errors of all direct answers."""
        return self.direct if self.arm is None else (1.0 - self.share) * self.direct + self.share * self.arm


def neighbours_of(task: Problem, left_out: LeftOut | None) -> Neighbours:
    """The training points, ordered by style; their channels as the likelihood sees them, compressed."""
    style: NDArray[np.int64] = np.argmax(task.data.styles, axis=1)
    order: NDArray[np.int64] = np.argsort(style, kind="stable")
    first = np.append(0, np.cumsum(np.bincount(style, minlength=task.data.styles.shape[1])))
    scaled = (task.data.outputs[order] - task.avatar_offset) / task.avatar_scale
    basis = task.avatar_basis.T
    usual = np.inf if left_out is None else np.quantile(left_out.distance, ENSEMBLE_TRAINING.usual)
    return Neighbours(
        task.features[order].astype(np.float32),
        first,
        (scaled @ basis.T).astype(np.float16),  # to a thousandth: the file is large enough
        basis * task.avatar_scale,
        np.asarray(task.avatar_offset),
        np.array(min(usual, _FAR)),
    )


def direct_answers(ensemble: PoseEnsemble, features: Array, styles: Array) -> tuple[Array, Array]:
    """What a trained pool's direct answers, without the whole arm's, weigh in it together, (T, channels), and how far
    they count (T,), 0 to 1: as the tick has them.

    Args:
        ensemble: as trained.
        features: (T, F) of hands.
        styles: (T, K) one-hot.
    """
    near, style = ensemble.neighbours, np.argmax(styles, axis=1)
    answer, furthest = np.empty((len(features), len(near.offset))), np.full(len(features), np.inf)
    for k in np.unique(style):
        own, at = slice(near.first[k], near.first[k + 1]), style == k
        known, scores = near.features[own].astype(float), near.scores[own].astype(float)
        average, furthest[at] = local_average(known, scores, features[at])
        answer[at] = average @ near.basis + near.offset
    by_layer = np.asarray(sparse.means(ensemble.regression, features, styles))
    beyond = np.clip(furthest / float(near.usual) - 1.0, 0.0, 1.0)
    return REGRESSION * by_layer + NEIGHBOURS * answer, 1.0 - beyond**2 * (3.0 - 2.0 * beyond)


def local_average(features: Array, values: Array, at: Array) -> tuple[Array, Array]:
    """Averages (T, C) of the values (N, C) of the :data:`NEAREST` points (N, F) about each of ``at`` (T, F).

    With the tricube weights of Cleveland 1979, which let a point come and go without a jump. Beside them, the distance
    (T,) of the furthest of these points.
    """
    distance, nearest = KDTree(features).query(at, k=min(NEAREST, len(features)))
    distance, nearest = distance.reshape(len(at), -1), nearest.reshape(len(at), -1)
    weights = (1.0 - (distance / np.maximum(distance[:, -1:], 1e-9)) ** 3) ** 3 + 1e-9
    average = np.einsum("tn,tnc->tc", weights / weights.sum(axis=1, keepdims=True), values[nearest])
    return average, distance[:, -1]


def _left_out(task: Problem, layer: Layer, noise: jax.Array, settings: EnsembleTrainingSettings) -> LeftOut | None:
    """What the direct answers are of trials that were left out; of one trial alone, None."""
    outputs, styles, trial = task.data.outputs, task.data.styles, task.data.trial
    if (folds := _folds(task, settings)) < 2:
        return None
    features, style = task.features, np.argmax(styles, axis=1)
    neighbours, distance = np.empty_like(outputs), np.empty(len(outputs))
    for fold in range(folds):
        out = trial % folds == fold
        for k in range(styles.shape[1]):
            rows, others = out & (style == k), ~out & (style == k)
            if np.any(rows):
                pool = others if np.any(others) else ~out
                average, distance[rows] = local_average(features[pool], outputs[pool], features[rows])
                neighbours[rows] = average - outputs[rows]
    return LeftOut(_regression_errors(task, layer, noise, folds), neighbours, distance, trial % folds)


def _folds(task: Problem, settings: EnsembleTrainingSettings) -> int:
    return min(settings.folds, int(task.data.trial[-1]) + 1)


def _regression_errors(task: Problem, layer: Layer, noise: jax.Array, folds: int) -> Array:
    """Errors (N, channels) of a regression that has its weights of the other trials."""
    outputs, styles, fold = task.data.outputs, task.data.styles, task.data.trial % folds
    error = np.empty_like(outputs)
    for one in range(folds):
        if np.any(out := fold == one):
            without = regression_posterior(layer, noise, task, ~out)
            error[out] = np.asarray(sparse.means(without, task.features[out], styles[out])) - outputs[out]
    return error


def _pool_errors(model: HGPDM, task: Problem, full: Posterior, left_out: LeftOut) -> tuple[Array, Array]:
    """Errors (N, channels) of the pool at points of trials that were left out, and the hierarchy's deviations there.

    The direct answers are those of the other trials. The hierarchy cannot be learned anew for each fold: its errors are
    taken to grow as the regression's do, which has the same features, points and number of inducing inputs.
    """
    inside = np.asarray(sparse.means(full, task.features, task.data.styles)) - task.data.outputs
    growth = np.sqrt(np.mean(left_out.regression**2, axis=0) / np.maximum(np.mean(inside**2, axis=0), 1e-12))
    hierarchy, deviation = _hierarchy_errors(model, task)
    return HIERARCHY * np.maximum(growth, 1.0) * hierarchy + (REGRESSION + NEIGHBOURS) * left_out.direct, deviation


def _spread(pool: Array, deviation: Array, settings: EnsembleTrainingSettings) -> Array:
    """Factors (channels,) of the hierarchy's deviations (N, channels), by the ``pool``'s errors (N, channels)."""
    relative = np.sort(np.abs(pool) / deviation, axis=0)
    largest = relative[min(int(settings.region * len(relative)), len(relative) - 1)]
    return np.clip(largest / math.sqrt(chdtri(1, 1.0 - settings.region)), settings.narrowest, settings.widest)


def _hierarchy_errors(model: HGPDM, task: Problem) -> tuple[Array, Array]:
    """Errors (N, channels) of the hierarchy at its training points, and the deviations that it says there.

    By the back projections alone, without the filter, which has :data:`ONLINE` times the deviations.
    """
    values, doubts = np.asarray(task.features), np.zeros((len(task.features), 0))
    for stage in model.back:
        values, doubts = np.asarray(sparse.means(stage, values)), np.asarray(sparse.variances(stage, values))
    dims, split = model.preset.interaction_dims, model.preset.avatar_dims
    latents, doubts = values[:, dims:], doubts[:, dims:]
    if not latents.shape[1]:  # X¹ comes from I alone
        latents, doubts = np.asarray(sparse.means(model.interaction, values))[:, :split], np.zeros((len(values), split))
    styles, scale = task.data.styles, np.asarray(model.avatar.scale)
    means = np.asarray(sparse.means(model.avatar, latents, styles))
    variance = np.broadcast_to(np.asarray(model.avatar.noise) * scale**2, means.shape).copy()
    for d in range(split):
        aside = latents.copy()
        aside[:, d] += np.sqrt(doubts[:, d])
        variance += (np.asarray(sparse.means(model.avatar, aside, styles)) - means) ** 2
    return means - task.data.outputs, ONLINE * np.sqrt(variance)

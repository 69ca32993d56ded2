"""Learns the contact layer from trials, and calibrates it on trials that it did not see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.kernels import MotionKernel
from highfive.model.gp.optimise import ProgressCallback
from highfive.model.gp.posterior import Posterior
from highfive.model.gp.regression import learned
from highfive.model.gp.sparse import Layer, Targets
from highfive.model.hgpdm.arm_features import arm_history, check_arms, fit_arm_features, with_arms
from highfive.model.hgpdm.contact_layer import (
    ARM_SHARE,
    BEGIN,
    CHANNELS,
    END,
    KNOTS,
    REGION,
    SPEED_SPAN,
    SPEEDS,
    ArmContactLayer,
    ContactLayer,
    pooled,
)
from highfive.model.hgpdm.dataset import KNUCKLES, hand_history
from highfive.model.hgpdm.features import FeatureMap
from highfive.model.hgpdm.tempo import tempo_history
from highfive.model.hgpdm.trials import Trial
from highfive.model.settings import Settings, setting

RATE_HZ = 30.0  # of the frames that it learns from


@dataclass(frozen=True)
class ContactTrainingSettings(Settings):
    """How the contact layer learns. Chosen on simulated trials that were held out, bounds and steps set by hand."""

    least_noise: float = setting(5e-3, above=0.0)
    most_noise: float = setting(1.0, above=0.0)
    """Bounds of its noise ``far`` from contact, in units of the channels' standard deviation."""
    near: float = setting(0.05, "s", above=0.0)
    far: float = setting(0.3, "s", above=0.0)
    """How far a hand is from where it will be grows with the time left, from ``near`` on."""
    iterations: int = setting(100, "steps", least=1)
    folds: int = setting(6, least=1)
    """Of trials, for the calibration."""
    frames: int = setting(6000, least=2)
    """Of all, at random, that choose kernel and inducing inputs; the weights are then of all."""
    frames_each: int = setting(20, "frames", least=1)
    """More inducing inputs than asked for where there are so many frames for each of them, ..."""
    most_inducing: int = setting(400, least=2)
    """... up to so many."""
    span: float = setting(0.07, "s", above=0.0)
    """Around a knot whose frames count for it, at least."""
    fewest: int = setting(30, "frames", least=1)
    """Around a knot, at least."""
    share: float = setting(1.0 / 3.0, above=0.0, most=1.0)
    """Of the frames around a knot those that are nearest to a speed count for it, at least so many of them,"""
    alike: int = setting(20, "trials", least=1)
    """and of so many trials: of fewer nobody could tell a region that nine in ten keep."""

    @property
    def noise(self) -> tuple[float, float]:
        """Both bounds."""
        return self.least_noise, self.most_noise


CONTACT_TRAINING = ContactTrainingSettings()


ARM_SHARES = (0.5, 0.6, ARM_SHARE, 0.75, 0.85, 1.0)
"""Of the arm's layer in a pooled forecast, that are tried at trials left out."""

Look = Callable[[Trial, Array], Array]
"""What is seen of a trial at times (n,), s: (n, …)."""


def approaches(trials: Sequence[Trial], look: Look) -> tuple[Array, Array, NDArray[np.int64]]:
    """What is seen (n, …), way and time left (n, 4), and the trial (n,), of frames around the approach."""
    seen: list[Array] = []
    left: list[Array] = []
    number: list[NDArray[np.int64]] = []
    for index, trial in enumerate(trials):
        contact = trial.contact_frame / trial.rate_hz
        times = contact - np.arange(END, BEGIN, 1.0 / RATE_HZ)
        times = times[(times >= 0.0) & (times <= (len(trial.joints) - 1) / trial.rate_hz)]
        seen.append(look(trial, times))
        knuckles = hand_history(trial, times, ())[:, 0, KNUCKLES]
        left.append(np.column_stack([trial.palm[trial.contact_frame] - knuckles, contact - times]))
        number.append(np.full(len(times), index))
    return np.concatenate(seen), np.concatenate(left), np.concatenate(number)


def precision(time: Array, settings: ContactTrainingSettings = CONTACT_TRAINING) -> Array:
    """How far frames (n,) count whose contact is ``time`` s away, against one that is ``far`` away.

    What a hand does not yet know of its way (its speed will change, the other may still move) makes it err by so many
    metres per second of the time left: the noise's deviation grows with it. One noise for all frames lets those
    far away blur those near contact: 36 held-out simulated trials, angry, 0.1 s before contact, median: 1.5 cm
    against 3.0.
    """
    return ((settings.far + settings.near) / (np.abs(time) + settings.near)) ** 2


def fit_contact_layers(
    trials: Sequence[Trial],
    feature_map: FeatureMap,
    history: Sequence[float],
    inducing: int = 200,
    seed: int = 0,
    progress: ProgressCallback | None = None,
    settings: ContactTrainingSettings = CONTACT_TRAINING,
    *,
    whole_arm: bool = False,
) -> tuple[ContactLayer, ArmContactLayer | None]:
    """Learns the layer of the hand and, if wanted, of the whole arm; calibrates them on trials left out in turn.

    108 simulated training trials in three folds, mean error of the contact point 0.3, 0.2 and 0.1 s before contact: the
    hand's layer 35, 28 and 20 mm, the arm's 29, 23 and 18, both pooled 28, 22 and 16; sad, the slowest, at 0.2 s: 11,
    10 and 8.

    Args:
        trials: the training trials.
        feature_map, history: the model's, of the hand.
        inducing: inducing inputs of each layer; more where there are many frames.
        seed: of their choice.
        progress: called after every step.
        settings: how they learn.
        whole_arm: learn the second layer, too, from the trials that have one.

    Raises:
        HighFiveError: it is wanted, and too many trials lack elbow, shoulder and head.
    """
    if whole_arm:
        check_arms(trials)
    hands, left, number = approaches(trials, lambda trial, times: hand_history(trial, times, history))
    hand = _fitted(np.asarray(feature_map(hands)), left, number, inducing, seed, progress, settings)
    speed, _, _ = approaches(trials, knuckle_speed)
    hand_layer = ContactLayer(hand.posterior, _calibration(hand, left, speed, number, settings))
    if not whole_arm:
        return hand_layer, None
    armed = with_arms(trials)
    known, rows = [trials[index] for index in armed], np.isin(number, armed)
    arms, left, number = approaches(known, arm_history)
    tempo, _, _ = approaches(known, tempo_history)
    features = fit_arm_features(arms, tempo)
    arm = _fitted(features(arms, tempo), left, number, inducing, seed, progress, settings)
    share = ARM_SHARE if not _folds(number, settings) else best_share(arm.error, hand.error[rows], left, settings)
    error, variance = (pooled(a, h[rows], share) for a, h in ((arm.error, hand.error), (arm.variance, hand.variance)))
    both = _calibration(_Fitted(arm.posterior, error, variance), left, speed[rows], number, settings)
    return hand_layer, ArmContactLayer(features, ContactLayer(arm.posterior, both), share)


def best_share(arm: Array, hand: Array, left: Array, settings: ContactTrainingSettings = CONTACT_TRAINING) -> float:
    """The arm's share with which both pooled err least at frames (n,) of trials left out.

    Args:
        arm, hand: (n, 4) errors of way and time; frames count as in training.
        left: (n, 4), what was left of them.
        settings: how frames count.
    """
    scale = np.sqrt(np.array([*[left[:, :3].var()] * 3, left[:, 3].var()]))
    counts = precision(left[:, 3], settings)
    errors = [counts @ np.sum((pooled(arm, hand, share) / scale) ** 2, axis=1) for share in ARM_SHARES]
    return ARM_SHARES[int(np.argmin(errors))]


class _Fitted(NamedTuple):
    """A layer, and what it said of the frames (n, 4) that were left out of its weights: error, and its own variance."""

    posterior: Posterior
    error: Array
    variance: Array


def _fitted(
    features: Array, left: Array, number: NDArray[np.int64], inducing: int, seed: int,
    progress: ProgressCallback | None, settings: ContactTrainingSettings,
) -> _Fitted:  # fmt: skip
    """The layer from features (n, F) to way and time left (n, 4), of the trials ``number`` (n,)."""
    offset: Array = left.mean(axis=0)
    scale = np.array([*[left[:, :3].std()] * 3, left[:, 3].std()])
    values = (left - offset) / scale
    count, dims = len(features), features.shape[1]
    counts = precision(left[:, 3], settings)
    rng = np.random.default_rng(seed)
    some = _frames(count, settings.frames, rng)
    number_of = max(inducing, min(settings.most_inducing, count // settings.frames_each))
    share = np.sqrt(counts[some]) / np.sqrt(counts[some]).sum()
    chosen = some[_drawn(share, number_of, rng)]
    start = Layer(MotionKernel.initial(dims), jnp.asarray(features[chosen]), sparse.raw_noise(0.2, settings.noise))

    points, weights, steps = jnp.asarray(features[some]), jnp.asarray(counts[some]), settings.iterations
    targets, stage = Targets(jnp.asarray(values[some]), CHANNELS, 0.0), "looking ahead"
    layer, noise = learned(start, points, targets, settings.noise, steps, steps, stage, progress, weights=weights)

    def posterior(rows: NDArray[np.bool_]) -> Posterior:
        units = {"offset": jnp.asarray(offset), "scale": jnp.asarray(scale)}
        inputs, outputs = jnp.asarray(features[rows]), jnp.asarray(values[rows])
        return sparse.fit(layer, inputs, outputs, noise, **units, weights=jnp.asarray(counts[rows]))

    error, variance = np.zeros_like(left), np.ones_like(left)
    folds = _folds(number, settings)
    for fold in range(folds):
        out = number % folds == fold
        without = posterior(~out)
        error[out] = np.asarray(sparse.means(without, features[out])) - left[out]
        variance[out] = np.asarray(sparse.variances(without, features[out]))
    return _Fitted(posterior(np.ones(len(features), bool)), error, variance)


def _frames(count: int, most: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices of all of a ``count`` of frames, or of so many at random, ascending."""
    return np.arange(count) if count <= most else np.sort(rng.choice(count, most, replace=False))


def _drawn(share: Array, most: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices of so many of N, drawn with probabilities ``share`` (N,), ascending."""
    return np.sort(rng.choice(len(share), min(most, len(share)), replace=False, p=share))


def _folds(number: NDArray[np.int64], settings: ContactTrainingSettings) -> int:
    """Of the trials; none of one alone."""
    folds = min(settings.folds, int(number[-1]) + 1)
    return folds if folds > 1 else 0


def knuckle_speed(trial: Trial, times: Array) -> Array:
    """Mean speed (T,) of a trial's knuckles over :data:`SPEED_SPAN` before ``times`` (T,) s, m/s."""
    knuckles = hand_history(trial, times, (SPEED_SPAN,))[:, :, KNUCKLES]
    return np.linalg.norm(knuckles[:, 0] - knuckles[:, 1], axis=1) / SPEED_SPAN


def _calibration(
    fitted: _Fitted, left: Array, speed: Array, number: NDArray[np.int64], settings: ContactTrainingSettings
) -> Array:
    """By what was said of trials that were left out; of one trial alone, none."""
    if not _folds(number, settings):
        return np.tile([0.0, 1.0, 1.0], (len(KNOTS), len(SPEEDS), 1))
    return calibration(fitted.error, fitted.variance, left, speed, number, settings)


def calibration(
    error: Array, variance: Array, left: Array, speed: Array, number: NDArray[np.int64],
    settings: ContactTrainingSettings = CONTACT_TRAINING,
) -> Array:  # fmt: skip
    """A contact layer's (KNOTS, SPEEDS, 3) by errors and variances (n, 4) of trials ``number`` (n,) that were left out.

    How much later than forecast contact comes is the median. The factors make the regions hold ``REGION`` of the
    frames that are forecast at about each knot's time, of knuckles about as fast. The level is raised as in split
    conformal prediction (Vovk et al. 2005), and kept for each group by itself
    (Mondrian conformal prediction, the same), with trials for examples: frames of a trial err together.

    Args:
        error, variance: of way and time.
        left: (n, 4), what was left of them.
        speed: (n,) m/s, of the knuckles.
        number: of whom a frame is.
        settings: how many frames and trials make a group.
    """
    time = left[:, 3] + error[:, 3]
    found = np.empty((len(KNOTS), len(SPEEDS), 3))
    for row, knot in enumerate(KNOTS):
        distance = np.abs(time - knot)
        near = distance <= max(settings.span, np.sort(distance)[min(settings.fewest, len(distance)) - 1])
        for column, usual in enumerate(SPEEDS):
            group = np.flatnonzero(near)[_alike(speed[near], number[near], usual, settings)]
            level = min(REGION * (1.0 + 1.0 / len(np.unique(number[group]))), 1.0)
            late = -np.median(error[group, 3])
            squares = (error[group] + [0.0, 0.0, 0.0, late]) ** 2 / variance[group]
            factors = [
                np.quantile(part.sum(axis=1), level) / chdtri(part.shape[1], 1.0 - REGION)
                for part in (squares[:, :3], squares[:, 3:])
            ]
            found[row, column] = late, *np.maximum(factors, 1e-3)
    return found


def _alike(
    speed: Array, number: NDArray[np.int64], usual: float, settings: ContactTrainingSettings
) -> NDArray[np.int64]:
    """Of frames (n,) of trials ``number`` those whose speed is nearest to a usual one, by its logarithm."""
    order = np.argsort(np.abs(np.log(np.maximum(speed, SPEEDS[0])) - np.log(usual)), kind="stable")
    _, first = np.unique(number[order], return_index=True)  # where each trial comes in
    last = np.sort(first)[min(settings.alike, len(first)) - 1]
    return order[: max(last + 1, round(settings.share * len(order)), min(settings.fewest, len(order)))]

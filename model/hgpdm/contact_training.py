"""Learns the contact layer from trials, and calibrates it on trials that it did not see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.kernels import MotionKernel
from highfive.model.gp.optimise import ProgressCallback, minimise
from highfive.model.gp.posterior import Posterior
from highfive.model.gp.sparse import Layer, Targets
from highfive.model.hgpdm.contact_layer import BEGIN, CHANNELS, END, KNOTS, REGION, ContactLayer
from highfive.model.hgpdm.dataset import KNUCKLES, hand_history
from highfive.model.hgpdm.features import FeatureMap
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
    span: float = setting(0.07, "s", above=0.0)
    """Around a knot whose frames count for it, at least."""
    fewest: int = setting(30, "frames", least=1)
    """Around a knot, at least."""

    @property
    def noise(self) -> tuple[float, float]:
        """Both bounds."""
        return self.least_noise, self.most_noise


CONTACT_TRAINING = ContactTrainingSettings()


def approaches(trials: Sequence[Trial], history: Sequence[float]) -> tuple[Array, Array, NDArray[np.int64]]:
    """Hand histories (n, H + 1, 6), m, way and time left (n, 4), and the trial (n,), of frames around the approach."""
    histories: list[Array] = []
    left: list[Array] = []
    number: list[NDArray[np.int64]] = []
    for index, trial in enumerate(trials):
        contact = trial.contact_frame / trial.rate_hz
        times = contact - np.arange(END, BEGIN, 1.0 / RATE_HZ)
        times = times[(times >= 0.0) & (times <= (len(trial.joints) - 1) / trial.rate_hz)]
        hands = hand_history(trial, times, history)
        histories.append(hands)
        left.append(np.column_stack([trial.palm[trial.contact_frame] - hands[:, 0, KNUCKLES], contact - times]))
        number.append(np.full(len(times), index))
    return np.concatenate(histories), np.concatenate(left), np.concatenate(number)


def precision(time: Array, settings: ContactTrainingSettings = CONTACT_TRAINING) -> Array:
    """How far frames (n,) count whose contact is ``time`` s away, against one that is ``far`` away.

    What a hand does not yet know of its way (its speed will change, the other may still move) makes it err by so many
    metres per second of the time left: the noise's deviation grows with it. One noise for all frames lets those
    far away blur those near contact: 36 held-out simulated trials, angry, 0.1 s before contact, median: 1.5 cm
    against 3.0.
    """
    return ((settings.far + settings.near) / (np.abs(time) + settings.near)) ** 2


def fit_contact_layer(
    trials: Sequence[Trial],
    feature_map: FeatureMap,
    history: Sequence[float],
    inducing: int = 200,
    seed: int = 0,
    progress: ProgressCallback | None = None,
    settings: ContactTrainingSettings = CONTACT_TRAINING,
) -> ContactLayer:
    """Learns the layer from trials, and calibrates it on trials that were left out of its weights in turn.

    Args:
        trials: the training trials.
        feature_map, history: the model's.
        inducing: inducing inputs at most.
        seed: of their choice.
        progress: called after every step.
        settings: how it learns.
    """
    hands, left, number = approaches(trials, history)
    features = np.asarray(feature_map(hands))
    offset: Array = left.mean(axis=0)
    scale = np.array([*[left[:, :3].std()] * 3, left[:, 3].std()])
    values = (left - offset) / scale
    count, dims = features.shape
    counts = precision(left[:, 3], settings)
    targets = Targets(jnp.asarray(values), CHANNELS, 0.0)
    share = np.sqrt(counts) / np.sqrt(counts).sum()
    chosen = np.sort(np.random.default_rng(seed).choice(count, min(inducing, count), replace=False, p=share))
    start = Layer(MotionKernel.initial(dims), jnp.asarray(features[chosen]), sparse.raw_noise(0.2, settings.noise))

    points, weights = jnp.asarray(features), jnp.asarray(counts)

    def value(layer: Layer):
        noise = sparse.noise_variance(layer.raw_noise, settings.noise)
        total = sparse.negative_log_likelihood(layer, points, targets, noise, variational=True, weights=weights)
        return total / count

    layer, _ = minimise(
        value, start, settings.iterations, settings.iterations, stage="looking ahead", progress=progress
    )
    noise = sparse.noise_variance(layer.raw_noise, settings.noise)

    def posterior(rows: NDArray[np.bool_]) -> Posterior:
        units = {"offset": jnp.asarray(offset), "scale": jnp.asarray(scale)}
        inputs, outputs = jnp.asarray(features[rows]), jnp.asarray(values[rows])
        return sparse.fit(layer, inputs, outputs, noise, **units, weights=jnp.asarray(counts[rows]))

    error, variance = np.zeros_like(left), np.ones_like(left)
    folds = min(settings.folds, len(trials))
    for fold in range(folds if folds > 1 else 0):
        out = number % folds == fold
        without = posterior(~out)
        error[out] = np.asarray(sparse.means(without, features[out])) - left[out]
        variance[out] = np.asarray(sparse.variances(without, features[out]))
    scales = np.ones((len(KNOTS), 2))
    if folds > 1:
        scales = _scales(left[:, 3] + error[:, 3], error**2 / variance, len(trials), settings)
    return ContactLayer(posterior(np.ones(len(features), bool)), scales)


def _scales(time: Array, squares: Array, trials: int, settings: ContactTrainingSettings = CONTACT_TRAINING) -> Array:
    """Factors (KNOTS, 2) that make the regions hold ``REGION`` of the frames forecast at about each knot's time.

    The level is raised as in split conformal prediction (Vovk et al. 2005), with trials for examples: frames of a trial
    err together.
    """
    level = min(REGION * (1.0 + 1.0 / trials), 1.0)
    scales = np.empty((len(KNOTS), 2))
    for row, knot in enumerate(KNOTS):
        distance = np.abs(time - knot)
        near = distance <= max(settings.span, np.sort(distance)[min(settings.fewest, len(distance)) - 1])
        for column, part in enumerate((squares[near, :3], squares[near, 3:])):
            scales[row, column] = np.quantile(part.sum(axis=1), level) / chdtri(part.shape[1], 1.0 - REGION)
    return np.maximum(scales, 1e-3)

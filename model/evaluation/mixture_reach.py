"""Where a reach will end, as a mixture of hypotheses: the other reach predictor of the literature.

A Gaussian mixture over what is seen of the hand and what is left of its way, learned from the approaches of training
trials; given the hand, what is left is a mixture again (Gaussian mixture regression, Cohn et al. 1996; of reaching
hands: Mainprice & Berenson 2013). The number of components is the one with the least BIC.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from scipy.special import logsumexp

from highfive.model.evaluation.predictions import Prediction
from highfive.model.geometry.rotations import Array
from highfive.model.gp.mixture import GaussianMixture, fitted, log_normal
from highfive.model.hgpdm.contact_layer import REGION
from highfive.model.hgpdm.contact_training import approaches
from highfive.model.hgpdm.dataset import KNUCKLES, Channels, hand_history
from highfive.model.hgpdm.hierarchy import Problem
from highfive.model.hgpdm.trials import Trial

SEEN = 10  # principal components of the hand's features
COMPONENTS = (2, 4, 8, 12, 16)
FORECASTS = ("contact_point", "hypotheses", "within_90", "log_density", "log_density_gaussian")
FLOOR = 1e-3  # added to the variances of unit-variance coordinates


class MixtureReach:
    """Learned from training trials; says where a hand will be."""

    def __init__(self, task: Problem, trials: Sequence[Trial], seed: int = 0) -> None:
        """Learns from the ``trials`` that are not held out, with the features of their training points."""
        self._task = task

        def look(trial: Trial, times: Array) -> Array:
            return task.feature_map(hand_history(trial, times, task.preset.history))

        features, left, _ = approaches([trial for trial in trials if not trial.test], look)
        self._centre = features.mean(axis=0)
        _, scale, axes = np.linalg.svd(features - self._centre, full_matrices=False)
        self._axes: Array = axes[:SEEN].T / np.maximum(scale[:SEEN] / np.sqrt(len(features)), 1e-9)
        self._offset, self._scale = left[:, :3].mean(axis=0), float(left[:, :3].std())
        joint = np.concatenate([(features - self._centre) @ self._axes, (left[:, :3] - self._offset) / self._scale], 1)
        counts = [count for count in COMPONENTS if 20 * count <= len(joint)] or [1]
        self._joint = fitted(joint, counts, seed, FLOOR)

    def __call__(self, trial: Trial, frame: int) -> GaussianMixture:
        """What is said at a frame of a trial."""
        history = hand_history(trial, np.array([frame / trial.rate_hz]), self._task.preset.history)
        seen = ((self._task.feature_map(history)[0] - self._centre) @ self._axes).ravel()
        size, logs = len(seen), np.empty(len(self._joint.weights))
        points, covariances = np.empty((len(logs), 3)), np.empty((len(logs), 3, 3))
        for k, (mean, covariance) in enumerate(zip(self._joint.points, self._joint.covariances, strict=True)):
            own, cross = covariance[:size, :size], covariance[size:, :size]
            gain = np.asarray(np.linalg.solve(own, cross.T), dtype=float).T
            logs[k] = np.log(self._joint.weights[k]) + log_normal((seen - mean[:size])[None], own)[0]
            points[k] = mean[size:] + gain @ (seen - mean[:size])
            covariances[k] = covariance[size:, size:] - gain @ cross.T
        weights = np.exp(logs - cast(float, logsumexp(logs)))
        knuckles = history[0, 0, KNUCKLES]
        return GaussianMixture(weights, knuckles + self._offset + self._scale * points, self._scale**2 * covariances)


def mixture_forecasts(
    trials: Sequence[Trial], answers: Sequence[Prediction], mixture: MixtureReach, before: Array
) -> dict[str, list[float | None]]:
    """What the mixture says of held-out trials, ``before`` (H,) s before contact, beside another method's Gaussian.

    Returns:
        ``contact_point``: m, median error of the mean; ``hypotheses``: how many count, mean; ``within_90``: share of
        contacts in the 90 % region; ``log_density``: mean, of contacts, in 1/m³; and ``log_density_gaussian``, the same
        by the ``answers`` where they say how sure they are. None where no trial reaches so far back.
    """
    rng = np.random.default_rng(0)
    rows: dict[str, list[float | None]] = {name: [] for name in FORECASTS}
    for ago in before.tolist():
        found: list[tuple[float, ...]] = []
        for trial, answer in zip(trials, answers, strict=True):
            frame = trial.contact_frame - round(ago * trial.rate_hz)
            if frame < 0:
                continue
            said, end = mixture(trial, frame), trial.palm[trial.contact_frame]
            at, gaussian = int(np.argmin(np.abs(answer.frames - frame))), np.nan
            if answer.uncertainty is not None:
                away = answer.outputs[at, Channels(trial.joints.shape[1]).contact] - end
                gaussian = float(log_normal(away[None], answer.uncertainty.contact[at])[0])
            miss, inside = float(np.linalg.norm(said.mean - end)), float(said.level(end, rng) < REGION)
            found.append((miss, said.number, inside, float(said.log_density(end[None])[0]), gaussian))
        table = np.array(found, dtype=float).reshape(-1, len(FORECASTS))
        for column, name in enumerate(FORECASTS):
            values = table[np.isfinite(table[:, column]), column]
            summary = np.median if name == "contact_point" else np.mean
            rows[name].append(round(float(summary(values)), 4) if len(values) else None)
    return rows

"""Mixtures of Gaussians: what may be one of several things."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from scipy.cluster.vq import kmeans2  # pyright: ignore[reportMissingTypeStubs, reportUnknownVariableType]
from scipy.special import logsumexp

from highfive.model.geometry.rotations import Array

STEPS = 60  # of expectation–maximisation


@dataclass(frozen=True)
class GaussianMixture:
    """A mixture of Gaussians: hypotheses of a point, as of where palms will meet.

    Attributes:
        weights: (K,).
        points: (K, D), the means, m of a place.
        covariances: (K, D, D).
    """

    weights: Array
    points: Array
    covariances: Array

    @property
    def mean(self) -> Array:
        """(D,)."""
        return self.weights @ self.points

    @property
    def covariance(self) -> Array:
        """(D, D), of all together."""
        away = self.points - self.mean
        return np.tensordot(self.weights, self.covariances, 1) + (self.weights[:, None] * away).T @ away

    @property
    def number(self) -> float:
        """How many hypotheses count: the exponential of the weights' entropy."""
        kept = self.weights[self.weights > 1e-12]
        return float(np.exp(-np.sum(kept * np.log(kept))))

    def log_density(self, points: Array) -> Array:
        """Log densities (N,) of points (N, D), in the unit of a volume."""
        parts = [log_normal(points - p, c) for p, c in zip(self.points, self.covariances, strict=True)]
        return np.asarray(logsumexp(np.array(parts) + np.log(self.weights + 1e-300)[:, None], axis=0))

    def level(self, point: Array, rng: np.random.Generator, samples: int = 1000) -> float:
        """Share of the mixture that is likelier than a point (D,): below 0.9 where the 90 % region holds it."""
        which = rng.choice(len(self.weights), samples, p=self.weights / self.weights.sum())
        roots = np.linalg.cholesky(self.covariances)[which]
        drawn = self.points[which] + np.einsum("nij,nj->ni", roots, rng.normal(size=(samples, len(point))))
        likelier = self.log_density(drawn) > self.log_density(point[None])[0]
        return float(likelier.mean())

    def told(self, point: Array, covariance: Array, probability: float = 1.0) -> GaussianMixture:
        """The same hypotheses after the word that it is about a ``point`` (D,), give or take a ``covariance`` (D, D).

        By Bayes' rule where the word is about this; with a ``probability`` below 1 it may be about something else, of
        which the weights were right (law of total probability).
        """
        away, both = point - self.points, self.covariances + covariance
        squares = np.sum(away * np.linalg.solve(both, away[:, :, None])[:, :, 0], axis=1)
        logs = np.log(self.weights + 1e-300) - 0.5 * (squares + np.linalg.slogdet(both)[1])
        weights = np.exp(logs - cast(float, logsumexp(logs)))
        return replace(self, weights=probability * weights + (1.0 - probability) * self.weights)


def fitted(
    points: Array, counts: Sequence[int], seed: int, floor: float, starts: int = 1, *, tied: bool = False
) -> GaussianMixture:
    """The mixture of points (N, D) with the least BIC (Schwarz 1978).

    Args:
        points: them.
        counts: numbers of components that are tried, each from ``starts`` beginnings.
        seed: of the beginnings.
        floor: added to the variance in each direction.
        starts: how many.
        tied: all components have one covariance.
    """
    fits = [_maximised(points, count, seed + start, floor, tied) for count in counts for start in range(starts)]
    return min(fits, key=lambda fit: fit[0])[1]


def _maximised(points: Array, count: int, seed: int, floor: float, tied: bool) -> tuple[float, GaussianMixture]:
    """BIC, and a mixture of so many components, by expectation–maximisation."""
    total, dims = points.shape
    if tied:  # groups of one size: k-means begins near them
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a group that is empty: it gets its share below
            nearest = np.asarray(cast(Any, kmeans2)(points, count, minit="++", rng=seed)[1])
    else:
        first = points[np.random.default_rng(seed).choice(total, count, replace=False)]
        nearest = np.array([np.sum((points - point) ** 2, axis=1) for point in first]).argmin(axis=0)
    shares: Array = np.eye(count)[nearest] + 1e-3
    shares = shares / shares.sum(axis=1, keepdims=True)
    weights, means, covariances = np.empty(count), np.empty((count, dims)), np.empty((count, dims, dims))
    likelihood = -np.inf
    for _ in range(STEPS):
        weights = shares.mean(axis=0)
        means = shares.T @ points / (total * weights[:, None])
        for k in range(count):
            away = points - means[k]
            covariances[k] = (shares[:, k, None] * away).T @ away / (total * weights[k]) + floor * np.eye(dims)
        if tied:
            covariances[:] = np.tensordot(weights, covariances, 1)
        logs = np.array([log_normal(points - m, c) for m, c in zip(means, covariances, strict=True)]).T
        logs += np.log(weights)
        whole = np.asarray(logsumexp(logs, axis=1))
        shares, before, likelihood = np.exp(logs - whole[:, None]), likelihood, float(whole.sum())
        if likelihood - before < 1e-4 * total:
            break
    free = count * (1 + dims) - 1 + (1 if tied else count) * dims * (dims + 1) / 2
    return free * np.log(total) - 2.0 * likelihood, GaussianMixture(weights, means, covariances)


def log_normal(away: Array, covariance: Array) -> Array:
    """Log densities (N,) of deviations (N, D) under a covariance (D, D)."""
    root = np.linalg.cholesky(covariance)
    solved = np.linalg.solve(root, away.T)
    return -0.5 * np.sum(solved**2, axis=0) - np.log(np.diag(root)).sum() - 0.5 * len(root) * np.log(2.0 * np.pi)

"""Whether interaction helps, over people: effects that differ between them, with an interval that holds what it says.

Each person has an estimate d of her effect and its variance v. People's true effects are N(μ, τ²); μ is normal and τ
half-normal beforehand. Given τ, μ's posterior is a normal distribution; τ is on a grid, so that the posterior of μ is a
mixture of normals and nothing is sampled (Gelman et al., Bayesian Data Analysis, 3rd ed., section 5.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import logsumexp, ndtr

from highfive.hil.experiments.analysis.counts import PersonCounts
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class HierarchySettings(Settings):
    """What is believed of effects before any data. Defaults: of differences in logits."""

    centre: float = setting(0.0, least=-100.0, most=100.0)
    """Mean of μ: neither condition is better."""
    spread: float = setting(1.0, above=0.0)
    """Standard deviation of μ: one logit takes a rate of .75 to .89, more than any such effect."""
    between: float = setting(0.5, above=0.0)
    """Scale of the half-normal τ: intervals of 5 to 24 simulated people held the truth in 95 to 99 of 100."""
    levels: int = setting(161, least=21, most=2001)
    """Values of τ, from 0 to five times its scale."""


@dataclass(frozen=True)
class Effects:
    """A posterior over the people.

    Attributes:
        mean, sd: of μ.
        interval: the central part of ``level`` of it.
        p_positive: posterior probability that μ > 0.
        between: posterior mean of τ.
    """

    mean: float
    sd: float
    interval: tuple[float, float]
    level: float
    p_positive: float
    between: float


@dataclass(frozen=True)
class _Mixture:
    """μ's posterior (S, T): weights, means and standard deviations at each τ (T,), for S studies at once."""

    tau: Array
    weights: Array
    means: Array
    sds: Array


def logit_differences(people: Sequence[PersonCounts]) -> tuple[Array, Array]:
    """Each person's empirical logit difference, interactive − replay, and its variance: (J,), (J,)."""
    k, n = _arrays(people)
    return empirical_logit_differences(k, n)


def empirical_logit_differences(k: Array, n: Array) -> tuple[Array, Array]:
    """d and v of counts (2, …), interactive first: differences of ln((k + ½)/(n − k + ½)), and their variances."""
    right, wrong = k + 0.5, n - k + 0.5
    logits, variances = np.log(right / wrong), 1.0 / right + 1.0 / wrong
    return logits[0] - logits[1], variances[0] + variances[1]


def over_people(
    estimates: Array, variances: Array, level: float = 0.95, settings: HierarchySettings | None = None
) -> Effects:
    """The posterior of the mean effect and of its spread between people.

    Args:
        estimates: (J,) of two people or more.
        variances: (J,) of the estimates, above 0.
        level: of the interval.
        settings: beliefs beforehand, in the estimates' unit.

    Raises:
        HighFiveError: fewer than two people.
    """
    if len(estimates) < 2:
        raise HighFiveError(f"{len(estimates)} person; what differs between people needs two or more")
    mixture = _posterior(estimates[None], variances[None], settings or HierarchySettings())
    weights, means, sds = mixture.weights[0], mixture.means[0], mixture.sds[0]
    mean = float(weights @ means)
    sd = float(np.sqrt(weights @ (sds**2 + (means - mean) ** 2)))
    low, high = float(np.min(means - 12.0 * sds)), float(np.max(means + 12.0 * sds))

    def quantile(p: float) -> float:
        return brentq(lambda x: float(weights @ ndtr((x - means) / sds)) - p, low, high, xtol=1e-12)

    tail = 0.5 * (1.0 - level)
    return Effects(
        mean, sd, (quantile(tail), quantile(1.0 - tail)), level, float(weights @ ndtr(means / sds)),
        float(weights @ mixture.tau),
    )  # fmt: skip


def p_positive(estimates: Array, variances: Array, settings: HierarchySettings | None = None) -> Array:
    """P(μ > 0) of many studies at once: (S,) of estimates and variances (S, J)."""
    mixture = _posterior(estimates, variances, settings or HierarchySettings())
    return np.sum(mixture.weights * ndtr(mixture.means / mixture.sds), axis=1)


def _posterior(d: Array, v: Array, settings: HierarchySettings) -> _Mixture:
    tau = np.linspace(0.0, 5.0 * settings.between, settings.levels)
    precision = 1.0 / (v[:, None, :] + tau[:, None] ** 2)  # (S, T, J)
    prior = settings.spread**-2
    total = prior + precision.sum(axis=2)
    shifted = d[:, None, :] - settings.centre
    mean = (precision * shifted).sum(axis=2) / total
    # ln p(τ | d), μ integrated out: of the people's normal densities, completed to the square in μ.
    log = 0.5 * np.log(precision).sum(axis=2) - 0.5 * (precision * shifted**2).sum(axis=2)
    log += 0.5 * total * mean**2 - 0.5 * np.log(total) - 0.5 * (tau / settings.between) ** 2
    log[:, 0] -= np.log(2.0)  # the trapezoidal rule's first node; the last weighs nothing
    weights = np.exp(log - logsumexp(log, axis=1, keepdims=True))
    return _Mixture(tau, weights, settings.centre + mean, 1.0 / np.sqrt(total))


def _arrays(people: Sequence[PersonCounts]) -> tuple[Array, Array]:
    both = [(person.interactive, person.replay) for person in people]
    k = np.array([[count.correct for count in pair] for pair in both], dtype=float).T
    n = np.array([[count.n for count in pair] for pair in both], dtype=float).T
    return k, n

"""How often the second of two styles is seen, by its share in the morph: PSE, JND and lapses from a grid posterior.

P(B | w) = λ + (1 − 2λ) Φ((w − m)/s): w the share of B, m the point of subjective equality (PSE), s the width, λ lapses
to either side. The just noticeable difference (JND), from 50 to 75 % but for lapses, is Φ⁻¹(¾) s = 0.674 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from highfive.hil.experiments.analysis.hierarchical import Effects, HierarchySettings, over_people
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

JND_OF_WIDTH = 0.6744897501960817
"""Φ⁻¹(¾)."""


@dataclass(frozen=True)
class PsychometricSettings(Settings):
    """What is believed of an observer beforehand, and the grid: m over ± 2, ln s over ± 2.5 of their deviations."""

    pse: float = setting(0.5, least=-10.0, most=10.0)
    """Mean of m: halfway."""
    pse_spread: float = setting(0.35, above=0.0)
    """Standard deviation of m: the whole morph lies within 1.5 of it."""
    width: float = setting(0.15, above=0.0)
    """Median of s: from 10 to 90 % within two fifths of the morph."""
    width_spread: float = setting(0.8, above=0.0)
    """Standard deviation of ln s: from steps to hardly a difference."""
    lapse: float = setting(0.03, above=0.0)
    """Mean of λ, exponential: few per hundred in attentive people."""
    pse_levels: int = setting(71, least=5, most=501)
    """Values of m: at 0.02, a fifth of what 80 trials tell it to."""
    width_levels: int = setting(41, least=5, most=301)
    """Values of ln s."""
    lapse_levels: int = setting(7, least=2, most=51)
    """Values of λ, from 0 to four means."""


@dataclass(frozen=True)
class Grid:
    """The values of m (M,), ln s (S,) and λ (L,), and the logarithm of the prior (M, S, L)."""

    pse: Array
    log_width: Array
    lapse: Array
    log_prior: Array


@dataclass(frozen=True)
class Estimate:
    """A posterior's centre, standard deviation and central part, by default 95 % (of lapses: from nought)."""

    value: float
    sd: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class Psychometric:
    """A person's function.

    Attributes:
        pse: share of B at which both styles are seen equally often; mean.
        jnd: in shares of B; ``value`` is the geometric mean, ``sd`` that of ln JND.
        lapse: share of answers that go by chance to either side; mean.
        trials: answers behind it.
    """

    pse: Estimate
    jnd: Estimate
    lapse: Estimate
    trials: int


@lru_cache(maxsize=8)
def grid_of(settings: PsychometricSettings) -> Grid:
    """The grid of these settings."""
    z_pse, z_width = np.linspace(-2.0, 2.0, settings.pse_levels), np.linspace(-2.5, 2.5, settings.width_levels)
    lapse = np.linspace(0.0, 4.0 * settings.lapse, settings.lapse_levels)
    prior = -0.5 * z_pse[:, None, None] ** 2 - 0.5 * z_width[:, None] ** 2 - lapse / settings.lapse
    prior[..., [0, -1]] -= np.log(2.0)  # the trapezoidal rule's ends: λ's density is largest at the first
    return Grid(
        settings.pse + settings.pse_spread * z_pse,
        np.log(settings.width) + settings.width_spread * z_width,
        lapse,
        prior,
    )


def p_second(weight: Array | float, pse: Array | float, width: Array | float, lapse: Array | float) -> Array:
    """P(B | w) of the function, broadcast."""
    return np.asarray(lapse + (1.0 - 2.0 * np.asarray(lapse)) * ndtr((weight - np.asarray(pse)) / width))


def p_on_grid(grid: Grid, weights: Array) -> Array:
    """P(B | w) (W, M, S, L) at weights (W,) for every value of the grid."""
    at = np.asarray(weights)[:, None, None, None]
    return p_second(at, grid.pse[:, None, None], np.exp(grid.log_width)[:, None], grid.lapse)


def log_likelihood(p: Array, second: bool) -> Array:
    """Of one answer, where B is seen with probability ``p``; no answer is quite impossible."""
    return np.log(np.maximum(p if second else 1.0 - p, 1e-12))


def fit(
    weights: Sequence[float] | Array, second: Sequence[bool] | Array, settings: PsychometricSettings | None = None,
    level: float = 0.95,
) -> Psychometric:  # fmt: skip
    """The function of one person from her answers.

    Args:
        weights: (T,) shares of B shown.
        second: (T,) whether B was answered.
        settings: beliefs beforehand.
        level: of the intervals.

    Raises:
        HighFiveError: no answer, or weights that are none.
    """
    shown, said = np.asarray(weights, dtype=float), np.asarray(second, dtype=bool)
    if not len(shown):
        raise HighFiveError("no answer to fit a psychometric function to")
    if shown.shape != said.shape or not np.all(np.isfinite(shown)):
        raise HighFiveError(f"{shown.shape} weights and {said.shape} answers; expected one finite weight an answer")
    grid = grid_of(settings or PsychometricSettings())
    levels, place = np.unique(shown, return_inverse=True)
    seconds = np.bincount(place, weights=said, minlength=len(levels))
    firsts = np.bincount(place, minlength=len(levels)) - seconds
    log, p = grid.log_prior.copy(), p_on_grid(grid, levels)
    for at in range(len(levels)):
        log += seconds[at] * log_likelihood(p[at], True) + firsts[at] * log_likelihood(p[at], False)
    return summary(grid, log, len(shown), level)


def summary(grid: Grid, log_posterior: Array, trials: int, level: float = 0.95) -> Psychometric:
    """PSE, JND and lapses of a posterior (M, S, L) on the grid."""
    p = np.exp(log_posterior - log_posterior.max())
    p /= p.sum()
    pse = _estimate(grid.pse, p.sum(axis=(1, 2)), level)
    log_jnd = _estimate(grid.log_width + np.log(JND_OF_WIDTH), p.sum(axis=(0, 2)), level)
    jnd = Estimate(
        float(np.exp(log_jnd.value)),
        log_jnd.sd,
        (float(np.exp(log_jnd.interval[0])), float(np.exp(log_jnd.interval[1]))),
    )
    return Psychometric(pse, jnd, _estimate(grid.lapse, p.sum(axis=(0, 1)), level, one_sided=True), trials)


def pooled_pse(people: Sequence[Psychometric], level: float = 0.95) -> Effects:
    """The mean PSE over people, and how far they differ (``p_positive`` says nothing here).

    Raises:
        HighFiveError: fewer than two people.
    """
    return _pooled([one.pse.value for one in people], [one.pse.sd for one in people], level, centre=0.5, spread=0.35)


def pooled_log_jnd(people: Sequence[Psychometric], level: float = 0.95) -> Effects:
    """The mean ln JND over people, and how far they differ.

    Raises:
        HighFiveError: fewer than two people.
    """
    centre = float(np.log(JND_OF_WIDTH * PsychometricSettings().width))
    values = [float(np.log(one.jnd.value)) for one in people]
    return _pooled(values, [one.jnd.sd for one in people], level, centre=centre, spread=0.8, between=0.5)


def pse_shift(first: Sequence[Psychometric], second: Sequence[Psychometric], level: float = 0.95) -> Effects:
    """The mean over people of the first condition's PSE minus the second's, person by person.

    Raises:
        HighFiveError: fewer than two people.
    """
    shifts = [one.pse.value - other.pse.value for one, other in zip(first, second, strict=True)]
    sds = [float(np.hypot(one.pse.sd, other.pse.sd)) for one, other in zip(first, second, strict=True)]
    return _pooled(shifts, sds, level, centre=0.0, spread=0.35)


def _pooled(
    values: Sequence[float], sds: Sequence[float], level: float, *, centre: float, spread: float, between: float = 0.1
) -> Effects:
    settings = HierarchySettings(centre=centre, spread=spread, between=between)
    return over_people(np.array(values), np.array(sds) ** 2, level, settings)


def _estimate(values: Array, p: Array, level: float, *, one_sided: bool = False) -> Estimate:
    mean = float(p @ values)
    sd = float(np.sqrt(p @ (values - mean) ** 2))
    # A node stands for what lies around it, half a step to either side.
    step = values[1] - values[0]
    edges = np.clip(np.append(values - 0.5 * step, values[-1] + 0.5 * step), values[0], values[-1])
    below = np.append(0.0, np.cumsum(p))
    low, high = np.interp((0.0, level) if one_sided else (0.5 - 0.5 * level, 0.5 + 0.5 * level), below, edges)
    return Estimate(mean, sd, (float(low), float(high)))

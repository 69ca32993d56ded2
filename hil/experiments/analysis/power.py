"""How many people a study needs, by simulation: how often an effect of a size is found with so many.

An effect is found where a two-sided t-test over people's own differences is below 5 %, as most studies report it. The
hierarchical estimate finds small effects with few people a little less often (5 people, 36 trials, .05: .05 of studies,
not .10) and as many from some 24 people on. The people are simulated: their spreads are assumed, not measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from highfive.hil.experiments.analysis.hierarchical import empirical_logit_differences
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class PowerSettings(Settings):
    """Which people are simulated, and how many studies of them."""

    rate: float = setting(0.75, above=0.0, below=1.0)
    """Right answers in replay, of a person like most: the source study's is .74."""
    people_spread: float = setting(0.58, "logit", least=0.0)
    """Standard deviation of people's own rates: .63 to .84 in two thirds of them. No source: the value at which an
    earlier simulation, that does not say its own, comes out nearest (its 42 powers to ± .03). At .5: up to .04 more."""
    effect_spread: float = setting(0.25, "logit", least=0.0)
    """Standard deviation of what interaction does to them."""
    pse_error: float = setting(0.05, least=0.0)
    """Standard error of one PSE: 40 adaptive trials, or 56 at constant levels."""
    shift_spread: float = setting(0.05, least=0.0)
    """Standard deviation of the PSE's shift between people."""
    studies: int = setting(4000, least=100, most=1_000_000)
    """Simulated ones: a power is then known to ± .008."""
    significance: float = setting(0.05, above=0.0, below=1.0)
    """Two-sided."""


def power_of_rates(
    people: int, trials: int, difference: float, seed: int, settings: PowerSettings | None = None
) -> float:
    """How often a difference in right answers is found.

    Args:
        people: in the study, two or more.
        trials: a condition and person.
        difference: of the rate of a person like most, interactive − replay.
        seed: of the simulated studies.
        settings: who takes part.

    Raises:
        HighFiveError: fewer than two people, no trials, or a rate that is none.
    """
    settings = settings or PowerSettings()
    _check(people)
    higher = settings.rate + difference
    if trials < 1 or not 0.0 < higher < 1.0:
        raise HighFiveError(
            f"{trials} trials at a rate of {higher:g}; expected one or more, and a rate between 0 and 1"
        )
    rng, shape = np.random.default_rng(seed), (settings.studies, people)
    base = _logit(settings.rate) + settings.people_spread * rng.standard_normal(shape)
    effect = _logit(higher) - _logit(settings.rate) + settings.effect_spread * rng.standard_normal(shape)
    rates = 1.0 / (1.0 + np.exp(-np.stack([base + effect, base])))
    right = rng.binomial(trials, rates).astype(float)
    differences, _ = empirical_logit_differences(right, np.full_like(right, trials))
    return _found(differences, settings.significance)


def power_of_pse_shift(people: int, shift: float, seed: int, settings: PowerSettings | None = None) -> float:
    """How often a shift of the PSE between two conditions is found, by as many people.

    Raises:
        HighFiveError: fewer than two people.
    """
    settings = settings or PowerSettings()
    _check(people)
    rng, shape = np.random.default_rng(seed), (settings.studies, people)
    own = shift + settings.shift_spread * rng.standard_normal(shape)
    errors = settings.pse_error * rng.standard_normal((2, *shape))
    return _found(own + errors[0] - errors[1], settings.significance)


def people_needed(
    power: Callable[[int], float], wanted: float = 0.8, candidates: Sequence[int] = tuple(range(3, 121))
) -> int | None:
    """The smallest number of people with whom an effect is found as often as wanted; None if none of them does.

    Args:
        power: of a number of people, rising with it but for what simulation adds.
        wanted: such as 0.8.
        candidates: rising; searched by halving.
    """
    low, high = 0, len(candidates)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if power(candidates[middle]) >= wanted else (middle + 1, high)
    return candidates[low] if low < len(candidates) else None


def _found(differences: Array, significance: float) -> float:
    """Share of studies (S, J) in which a t-test of J differences finds that their mean is not 0."""
    people = differences.shape[1]
    mean, error = differences.mean(axis=1), differences.std(axis=1, ddof=1) / np.sqrt(people)
    return float(np.mean(np.abs(mean) > stdtrit(people - 1, 1.0 - 0.5 * significance) * error))


def _logit(rate: float) -> float:
    return float(np.log(rate / (1.0 - rate)))


def _check(people: int) -> None:
    if people < 2:
        raise HighFiveError(f"{people} people; what differs between people needs two or more")

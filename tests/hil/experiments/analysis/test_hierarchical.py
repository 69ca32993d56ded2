"""The estimate over people: against a plain grid, and against truths that were put in."""

import numpy as np
import pytest
from scipy.special import expit, logit

from highfive.hil.experiments.analysis.counts import Count, PersonCounts
from highfive.hil.experiments.analysis.hierarchical import (
    HierarchySettings,
    empirical_logit_differences,
    logit_differences,
    over_people,
    p_positive,
)
from highfive.model.errors import HighFiveError

SOURCE = [(47, 39, 72), (57, 55, 72), (59, 62, 72), (50, 45, 60), (55, 56, 72)]
PEOPLE = [PersonCounts(f"S{j}", Count(i, n), Count(r, n)) for j, (i, r, n) in enumerate(SOURCE)]


def studies(rng: np.random.Generator, count: int, people: int, trials: int, effect: float, between: float):
    """Estimates and variances (count, people) of simulated studies: each person has her own rate and effect."""
    base = logit(0.75) + 0.5 * rng.standard_normal((count, people))
    own = effect + between * rng.standard_normal((count, people))
    k = np.stack([rng.binomial(trials, expit(base + own)), rng.binomial(trials, expit(base))]).astype(float)
    return empirical_logit_differences(k, np.full_like(k, trials))


def test_it_is_what_a_plain_grid_of_both_gives() -> None:
    d, v = logit_differences(PEOPLE)
    mu, tau = np.linspace(-3, 3, 2001)[:, None], np.linspace(0, 3, 801)[None, :]
    log = -0.5 * mu**2 - 0.5 * (tau / 0.5) ** 2 + np.zeros_like(mu * tau)
    for one, variance in zip(d, v, strict=True):
        log += -0.5 * np.log(variance + tau**2) - 0.5 * (one - mu) ** 2 / (variance + tau**2)
    p = np.exp(log - log.max())
    p /= p.sum()
    found = over_people(d, v)
    of_mu = p.sum(axis=1)
    assert found.mean == pytest.approx(float(of_mu @ mu[:, 0]), abs=0.001)
    assert found.p_positive == pytest.approx(float(of_mu[mu[:, 0] > 0].sum()), abs=0.003)
    assert found.between == pytest.approx(float(p.sum(axis=0) @ tau[0]), abs=0.003)
    inside = (mu[:, 0] > found.interval[0]) & (mu[:, 0] < found.interval[1])
    assert of_mu[inside].sum() == pytest.approx(0.95, abs=0.005)


def test_the_source_study_has_no_clear_effect() -> None:
    found = over_people(*logit_differences(PEOPLE))
    assert (found.mean, found.sd, found.p_positive) == pytest.approx((0.16, 0.22, 0.77), abs=0.011)
    assert found.interval[0] < 0.0 < found.interval[1]


def test_changed_over_conditions_change_the_sign_alone() -> None:
    d, v = logit_differences(PEOPLE)
    one, other = over_people(d, v), over_people(-d, v)
    assert other.mean == pytest.approx(-one.mean)
    assert other.interval == pytest.approx((-one.interval[1], -one.interval[0]))
    assert other.p_positive == pytest.approx(1.0 - one.p_positive)


def test_many_studies_at_once_are_each_by_itself() -> None:
    d, v = studies(np.random.default_rng(3), 4, 6, 36, 0.3, 0.25)
    assert p_positive(d, v) == pytest.approx([over_people(*one).p_positive for one in zip(d, v, strict=True)])


def test_rates_of_nought_and_one_are_no_trouble() -> None:
    people = [PersonCounts(name, Count(36, 36), Count(0, 36)) for name in "ab"]
    assert over_people(*logit_differences(people)).p_positive > 0.99


def test_one_person_says_nothing_of_people() -> None:
    with pytest.raises(HighFiveError, match="1 person; what differs between people needs two"):
        over_people(np.array([0.1]), np.array([0.2]))


def test_null_studies_are_called_an_effect_at_most_as_often_as_said() -> None:
    rng = np.random.default_rng(11)
    for people in (5, 12, 24):
        p = p_positive(*studies(rng, 2000, people, 36, 0.0, 0.25))
        assert np.mean((p > 0.975) | (p < 0.025)) <= 0.05


def test_90_percent_intervals_hold_what_was_injected() -> None:
    rng = np.random.default_rng(12)
    held = []
    for _ in range(200):  # effects, spreads and numbers of people as beliefs beforehand have them
        settings = HierarchySettings()
        effect = settings.centre + settings.spread * rng.standard_normal()
        between = abs(settings.between * rng.standard_normal())
        d, v = studies(rng, 1, int(rng.integers(5, 25)), 72, effect, between)
        low, high = over_people(d[0], v[0], 0.9).interval
        held.append(low < effect < high)
    assert 0.85 <= np.mean(held) <= 0.95

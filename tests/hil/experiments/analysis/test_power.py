"""Power by simulation: against the t-test's own theory, and the tables that were made apart."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import nct, t

from highfive.hil.experiments.analysis.power import PowerSettings, people_needed, power_of_pse_shift, power_of_rates
from highfive.model.errors import HighFiveError

PEOPLE = (5, 8, 12, 16, 24, 32, 48)
RATES = {
    (36, 0.05): (0.11, 0.18, 0.28, 0.40, 0.52, 0.66, 0.83),
    (36, 0.08): (0.25, 0.42, 0.62, 0.77, 0.92, 0.97, 1.0),
    (36, 0.12): (0.49, 0.79, 0.94, 0.99, 1.0, 1.0, 1.0),
    (72, 0.05): (0.18, 0.29, 0.45, 0.56, 0.77, 0.89, 0.97),
    (72, 0.08): (0.38, 0.66, 0.85, 0.94, 0.99, 1.0, 1.0),
    (72, 0.12): (0.70, 0.95, 1.0, 1.0, 1.0, 1.0, 1.0),
}
"""(Trials a condition, difference of the rate) → power with so many PEOPLE, from another simulation."""
SHIFTS = {
    0.04: (0.12, 0.21, 0.31, 0.40, 0.58, 0.71),
    0.06: (0.22, 0.40, 0.59, 0.73, 0.90, 0.97),
    0.10: (0.52, 0.78, 0.95, 0.99, 1.0, 1.0),
}


def theory(people: int, size: float) -> float:
    """Power of a two-sided t-test at 5 % on differences whose mean is so many standard deviations."""
    edge, shifted = t.ppf(0.975, people - 1), size * np.sqrt(people)
    return float(nct.sf(edge, people - 1, shifted) + nct.cdf(-edge, people - 1, shifted))


@pytest.mark.parametrize("shift", [0.0, 0.04, 0.1])
def test_a_shift_is_found_as_theory_says(shift: float) -> None:
    for people in (5, 16):
        expected = theory(people, shift / np.sqrt(2 * 0.05**2 + 0.05**2))
        found = power_of_pse_shift(people, shift, 1, PowerSettings(studies=20_000))
        assert found == pytest.approx(expected, abs=0.012)


def test_without_an_effect_one_in_twenty_is_found_and_more_of_anything_finds_more() -> None:
    assert power_of_rates(12, 36, 0.0, 2) == pytest.approx(0.05, abs=0.012)
    base = power_of_rates(12, 36, 0.08, 3)
    assert power_of_rates(24, 36, 0.08, 3) > base + 0.1
    assert power_of_rates(12, 72, 0.08, 3) > base + 0.1
    assert power_of_rates(12, 36, 0.12, 3) > base + 0.1
    assert power_of_rates(12, 36, 0.08, 3) == base
    spread = replace(PowerSettings(), effect_spread=1.0)
    assert power_of_rates(12, 36, 0.08, 3, spread) < base - 0.1


def test_people_needed_is_the_first_number_that_will_do() -> None:
    assert people_needed(lambda people: people / 100.0, 0.8) == 80
    assert people_needed(lambda people: 0.1) is None
    needed = people_needed(lambda people: power_of_rates(people, 72, 0.08, 4))
    assert needed is not None and 9 <= needed <= 13  # .66 with 8, .85 with 12


@pytest.mark.slow(30)
def test_rates_are_found_as_the_table_says() -> None:
    for (trials, difference), powers in RATES.items():
        for people, expected in zip(PEOPLE, powers, strict=True):
            found = power_of_rates(people, trials, difference, 5, PowerSettings(studies=100_000))
            assert found == pytest.approx(expected, abs=0.03), (trials, difference, people)


@pytest.mark.slow
def test_shifts_are_found_as_the_table_says() -> None:
    for shift, powers in SHIFTS.items():
        for people, expected in zip(PEOPLE, powers, strict=False):
            found = power_of_pse_shift(people, shift, 6, PowerSettings(studies=20_000))
            assert found == pytest.approx(expected, abs=0.03), (shift, people)


def test_what_is_no_study_is_refused() -> None:
    with pytest.raises(HighFiveError, match="1 people; what differs between people needs two"):
        power_of_rates(1, 36, 0.05, 0)
    with pytest.raises(HighFiveError, match="0 trials at a rate"):
        power_of_rates(5, 0, 0.05, 0)
    with pytest.raises(HighFiveError, match=r"at a rate of 1\.05"):
        power_of_rates(5, 36, 0.30, 0)

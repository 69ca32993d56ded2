"""The source study's table from its counts, and its probabilities against sums and sampling."""

import math

import numpy as np
import pytest
from scipy.special import betaln

from highfive.hil.experiments.analysis.counts import Count, PersonCounts
from highfive.hil.experiments.analysis.source_table import classification_rate, overall, p_higher, source_table
from highfive.model.errors import HighFiveError

PRINTED = {
    "S1": ((47, 39, 72), (0.617, 0.054, 0.519, 0.055, 0.911)),
    "S2": ((57, 55, 72), (0.741, 0.048, 0.716, 0.050, 0.653)),
    "S3": ((59, 62, 72), (0.765, 0.047, 0.802, 0.044, 0.252)),
    "S4": ((50, 45, 60), (0.768, 0.050, 0.696, 0.055, 0.866)),
    "S5": ((55, 56, 72), (0.716, 0.050, 0.728, 0.049, 0.422)),
}
"""Counts (interactive, replay, of so many) and what Taubert et al. (2013), Table 1, print."""
PEOPLE = [PersonCounts(name, Count(i, n), Count(r, n)) for name, ((i, r, n), _) in PRINTED.items()]


def test_the_counts_give_every_printed_figure_to_the_third_decimal() -> None:
    table = source_table(PEOPLE)
    for row in table.rows:
        found = (row.interactive.mean, row.interactive.se, row.replay.mean, row.replay.se, row.p_interactive_higher)
        assert found == pytest.approx(PRINTED[row.participant][1], abs=0.001)
    assert table.overall == pytest.approx(0.969, abs=0.0005)


def by_sum(first: Count, second: Count) -> float:
    """P(x > y) in closed form for whole parameters (E. Miller 2015): a sum over Beta functions."""
    a, b, c, d = first.correct + 1, first.wrong + 1, second.correct + 1, second.wrong + 1
    terms = [betaln(c + i, d + b) - math.log(b + i) - betaln(1 + i, b) - betaln(c, d) for i in range(a)]
    return float(np.sum(np.exp(terms)))


@pytest.mark.parametrize("counts", [(47, 72, 39, 72), (0, 1, 1, 1), (1, 1, 0, 1), (0, 500, 3, 40), (36, 36, 36, 36)])
def test_the_quadrature_is_exact(counts: tuple[int, int, int, int]) -> None:
    first, second = Count(*counts[:2]), Count(*counts[2:])
    assert p_higher(first, second) == pytest.approx(by_sum(first, second), abs=1e-10)
    assert p_higher(first, second) + p_higher(second, first) == pytest.approx(1.0, abs=1e-10)


def test_many_trials_are_no_trouble() -> None:
    assert p_higher(Count(75_000, 100_000), Count(75_000, 100_000)) == pytest.approx(0.5, abs=1e-9)
    assert p_higher(Count(80_000, 100_000), Count(70_000, 100_000)) == pytest.approx(1.0)


@pytest.mark.parametrize("emotions", [2, 3, 4])
def test_rate_is_the_diagonal_of_a_confusion_matrix_with_a_pseudo_count_in_each_cell(emotions: int) -> None:
    rng = np.random.default_rng(5)
    cells = np.full((emotions, emotions), 3)
    cells[np.diag_indices(emotions)] = 9
    drawn = rng.dirichlet((cells + 1).ravel(), 100_000).reshape(-1, emotions, emotions)
    diagonal = np.trace(drawn, axis1=1, axis2=2)
    rate = classification_rate(Count(9 * emotions, int(cells.sum())), emotions)
    assert rate.mean == pytest.approx(diagonal.mean(), abs=0.001)
    assert rate.se == pytest.approx(diagonal.std(), abs=0.001)


def test_overall_is_the_ratio_of_products_and_holds_for_any_number_of_people() -> None:
    p = [0.9, 0.6, 0.2]
    up, down = math.prod(p), math.prod(1 - x for x in p)
    assert overall(p) == pytest.approx(up / (up + down))
    assert overall([0.99] * 500) == 1.0
    assert overall([0.01] * 500) == pytest.approx(0.0)
    assert overall([0.5] * 7) == 0.5
    assert overall([1.0, 0.3]) == 1.0


def test_a_choice_of_one_is_refused() -> None:
    with pytest.raises(HighFiveError, match="1 emotions; a choice has two"):
        source_table(PEOPLE, 1)

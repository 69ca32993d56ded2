"""Williams squares, and orders with few alike in a row: against counting all there are."""

from collections import Counter
from itertools import groupby, pairwise, permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from highfive.hil.experiments.sequence import _counted_out, can_be_ordered, draw_order, longest_run
from highfive.hil.experiments.williams import williams


@pytest.mark.parametrize("count", range(1, 11))
def test_each_thing_follows_each_other_one_and_is_at_each_place_equally_often(count: int) -> None:
    rows = williams(count)
    assert len(rows) == (count if count % 2 == 0 or count == 1 else 2 * count)
    assert all(sorted(row) == list(range(count)) for row in rows)
    follows = Counter(pair for row in rows for pair in pairwise(row))
    assert len(follows) == count * (count - 1) and len(set(follows.values())) <= 1
    assert {Counter(row[place] for row in rows)[thing] for place in range(count) for thing in range(count)} == {
        len(rows) // count
    }


def allowed(counts: dict[str, int], alike: int, free: str) -> set[tuple[str, ...]]:
    """By trying all."""
    things = [thing for thing, count in counts.items() for _ in range(count)]
    return {
        order
        for order in permutations(things)
        if all(thing == free or len(list(run)) <= alike for thing, run in groupby(order))
    }


@pytest.mark.parametrize(
    ("counts", "alike", "free"),
    [
        ({"a": 3, "b": 3}, 1, ""),
        ({"a": 2, "b": 2, "c": 2}, 1, ""),
        ({"a": 4, "b": 3}, 2, ""),
        ({"x": 3, "a": 2, "b": 2}, 1, "x"),
        ({"a": 5, "b": 1, "c": 1}, 2, ""),
    ],
)
@pytest.mark.slow
def test_every_allowed_order_is_equally_likely_whichever_way_it_is_drawn(
    counts: dict[str, int], alike: int, free: str
) -> None:
    expected, draws = allowed(counts, alike, free), 3000
    for way in (draw_order, lambda *given: _counted_out(dict(given[0]), *given[1:])):
        rng = np.random.default_rng(1)
        seen = Counter(tuple(way(counts, alike, rng, free)) for _ in range(draws))
        assert set(seen) <= expected
        mean = draws / len(expected)
        chi_square = sum((seen[order] - mean) ** 2 / mean for order in expected)
        assert chi2.sf(chi_square, len(expected) - 1) > 1e-5


@given(st.dictionaries(st.sampled_from("abcd"), st.integers(0, 3), min_size=1), st.integers(1, 3))
def test_what_is_said_to_be_possible_is_what_trying_all_finds(counts: dict[str, int], alike: int) -> None:
    if sum(counts.values()) > 7:
        counts = {name: min(1, count) for name, count in counts.items()}
    assert can_be_ordered(counts, alike) == bool(allowed(counts, alike, ""))


def test_orders_that_hardly_any_shuffle_passes_are_drawn() -> None:
    """Of 40 + 40 of which never two are alike in a row there are two."""
    drawn = {tuple(draw_order({"a": 40, "b": 40}, 1, np.random.default_rng(seed))) for seed in range(12)}
    assert drawn == {("a", "b") * 40, ("b", "a") * 40}
    assert longest_run(draw_order({"a": 20, "b": 20, "c": 20}, 1, np.random.default_rng(0))) == 1

"""Confusion matrices: laws of what is made of them, and a case by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.experiments.analysis.confusion import (
    Confusion,
    chance_bits,
    confusion,
    emotion_rates,
    mutual_information,
)
from highfive.model.errors import HighFiveError

BY_HAND = Confusion(("angry", "fearful", "neutral"), np.array([[8, 2, 2], [1, 6, 5], [0, 0, 12]]))
MATRICES = st.integers(2, 5).flatmap(
    lambda k: (
        st.lists(st.lists(st.integers(0, 20), min_size=k, max_size=k), min_size=k, max_size=k)
        .map(lambda rows: Confusion(tuple("abcde"[: len(rows)]), np.array(rows)))
        .filter(lambda matrix: matrix.trials > 0)
    )
)


def test_counts_by_trial() -> None:
    shown = ["b", "a", "b", "b"]
    found = confusion(shown, ["b", "b", "a", "b"])
    assert found.emotions == ("a", "b")
    assert found.counts.tolist() == [[0, 1], [1, 2]]


def test_rates_by_hand() -> None:
    angry, fearful, neutral = emotion_rates(BY_HAND)
    assert (angry.correct, angry.shown, angry.answered) == (8, 12, 9)
    assert angry.mean == pytest.approx(9 / 15)  # Beta(9, 6)
    assert angry.unbiased == pytest.approx(64 / (12 * 9))
    assert neutral.unbiased == pytest.approx(12 / 19) and neutral.mean == pytest.approx(13 / 15)
    assert neutral.answer_bias == pytest.approx(7 / 36) and fearful.answer_bias == pytest.approx(-4 / 36)
    assert angry.interval[0] < angry.mean < angry.interval[1]


@given(MATRICES)
def test_laws(matrix: Confusion) -> None:
    rates = emotion_rates(matrix)
    assert sum(rate.answer_bias for rate in rates) == pytest.approx(0.0)
    for rate in rates:
        assert (rate.unbiased is None) == (rate.shown == 0)
        if rate.unbiased is not None:  # it is at most the rate itself, and at most the share of its answers
            assert 0.0 <= rate.unbiased <= rate.correct / rate.shown + 1e-12
    joint = matrix.counts / matrix.trials
    entropies = [-sum(p * math.log2(p) for p in joint.sum(axis=axis) if p > 0) for axis in (0, 1)]
    both = -sum(p * math.log2(p) for p in joint.ravel() if p > 0)
    assert mutual_information(matrix) == pytest.approx(sum(entropies) - both, abs=1e-9)
    turned = Confusion(matrix.emotions, matrix.counts.T)
    assert mutual_information(turned) == pytest.approx(mutual_information(matrix))


def test_perfect_answers_say_all_and_constant_ones_nothing() -> None:
    perfect = Confusion(("a", "b", "c", "d"), 5 * np.eye(4, dtype=int))
    assert mutual_information(perfect) == pytest.approx(2.0)
    constant = Confusion(("a", "b"), np.array([[7, 0], [7, 0]]))
    assert mutual_information(constant) == 0.0 and chance_bits(constant) == 0.0
    a, b = emotion_rates(constant)
    assert a.unbiased == 0.5 and b.unbiased == 0.0  # every a is right, yet nothing is told apart


def test_blind_answers_seem_to_say_what_chance_adds() -> None:
    rng = np.random.default_rng(2)
    blind = [
        confusion(rng.choice(list("abc"), 120).tolist(), rng.choice(list("abc"), 120).tolist()) for _ in range(400)
    ]
    assert np.mean([mutual_information(m) for m in blind]) == pytest.approx(chance_bits(blind[0]), rel=0.1)


def test_nothing_and_a_single_label_are_refused() -> None:
    with pytest.raises(HighFiveError, match="no trial to make"):
        confusion([], [])
    with pytest.raises(HighFiveError, match="all that was shown and answered is sad"):
        confusion(["sad"], ["sad"])

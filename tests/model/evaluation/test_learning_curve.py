"""Learning curves: the law that is found, nested draws, and what more trials would bring."""

from itertools import pairwise

import numpy as np
import pytest
from made_up import EMOTIONS, made_up_trial

from highfive.model.evaluation.learning_curve import PowerLaw, draws, fit_power_law, gains, proxy_curve

COUNTS = [3, 5, 10, 20, 40]


@pytest.mark.parametrize("law", [PowerLaw(0.05, 0.3, 0.5), PowerLaw(0.0, 0.2, 0.8), PowerLaw(0.1, 0.4, 1.5)])
def test_a_power_law_is_found_again(law: PowerLaw) -> None:
    found = fit_power_law(COUNTS, [law(n) for n in COUNTS])
    for n in (4, 15, 80, 200):
        assert found(n) == pytest.approx(law(n), rel=1e-2)


def test_no_law_promises_more_than_no_error_or_that_trials_do_harm() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        found = fit_power_law(COUNTS, rng.uniform(0.0, 1.0, 5))
        values = [found(n) for n in (1, 10, 100, 10_000)]
        assert found.floor >= 0.0 and all(a >= b >= 0.0 for a, b in pairwise(values))
    assert fit_power_law([5], [0.2])(50) == pytest.approx(0.2)


def test_more_trials_bring_more_and_the_range_holds_the_middle() -> None:
    rng = np.random.default_rng(1)
    errors = np.array([[0.05 + 0.3 * n**-0.6 for n in COUNTS]] * 4) * rng.uniform(0.9, 1.1, (4, 1))
    found = gains(COUNTS, errors, [5, 20])
    assert all(low <= middle <= high for middle, low, high in found)
    assert found[0][0] < found[1][0] < errors[:, -1].max()


def test_smaller_sets_are_parts_of_larger_ones_and_nothing_held_out_is_learned_from() -> None:
    rng = np.random.default_rng(2)
    trials = [made_up_trial(goal, e, 60.0, rng) for goal in np.linspace(0.3, 0.7, 6) for e in EMOTIONS]
    trials += [made_up_trial(0.5, e, 60.0, rng, test=True) for e in EMOTIONS]
    folds = draws(trials, [2, 4, 6, 9], seed=0)
    assert [fold.name for fold in folds] == ["2 a style", "4 a style", "6 a style"]
    before: set[int] = set()
    for count, fold in zip((2, 4, 6), folds, strict=True):
        learned = {id(t) for t in fold.trials if not t.test}
        assert before <= learned and len(learned) == count * len(EMOTIONS)
        assert [t for t in fold.trials if t.test] == trials[-len(EMOTIONS) :]
        before = learned
    assert [fold.name for fold in draws(trials, [40], seed=0)] == ["6 a style"]  # named by what is learned from
    assert {id(t) for t in draws(trials, [2], seed=1)[0].trials} != {id(t) for t in folds[0].trials}


def test_the_stand_in_falls_with_more_trials_and_needs_three_a_style() -> None:
    rng = np.random.default_rng(3)
    trials = [made_up_trial(goal, e, 60.0, rng) for goal in np.linspace(0.3, 0.7, 10) for e in EMOTIONS]
    counts, errors = proxy_curve(trials)
    assert counts == sorted(counts) and errors.shape == (3, len(counts))
    assert errors[:, 0].mean() > errors[:, -1].mean()
    assert proxy_curve(trials[: 2 * len(EMOTIONS)])[0] == []

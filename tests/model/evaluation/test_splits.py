from collections.abc import Callable
from dataclasses import replace

import pytest

from highfive.model.errors import HighFiveError
from highfive.model.evaluation.splits import group_of, leave_out, own_split
from highfive.model.hgpdm.trials import Trial


@pytest.fixture
def grid(trials: list[Trial]) -> list[Trial]:
    """Three cells, eleven repetitions, and a trial that tells neither."""
    named = [replace(trials[0], cell=cell, repetition=n) for cell in ("C1", "A1", "B2") for n in range(1, 12)]
    return [*named, replace(trials[1], cell="", repetition=-1, test=True)]


@pytest.mark.parametrize("what", ["repetition", "cell"])
def test_the_folds_hold_out_every_named_trial_once(grid: list[Trial], what: str):
    folds = leave_out(grid, what)
    held = [index for fold in folds for index in fold.held_out]
    assert sorted(held) == list(range(len(grid) - 1))
    for fold in folds:
        assert {group_of(fold.trials[index], what) for index in fold.held_out} == {fold.name}
        assert all(t.test or group_of(t, what) != fold.name for t in fold.trials)
        assert [replace(t, test=False) for t in fold.trials] == [replace(t, test=False) for t in grid]


def test_folds_are_in_the_order_of_numbers(grid: list[Trial]):
    assert [fold.name for fold in leave_out(grid, "repetition")] == [str(n) for n in range(1, 12)]
    assert [fold.name for fold in leave_out(grid, "cell")] == ["A1", "B2", "C1"]


def test_the_table_s_own_split_is_one_fold(trials: list[Trial]):
    (fold,) = own_split(trials)
    assert fold.held_out == [index for index, trial in enumerate(trials) if trial.test]


@pytest.mark.parametrize(
    ("change", "split", "message"),
    [
        (lambda t: replace(t, test=False), own_split, "no trial is held out"),
        (lambda t: replace(t, test=True), own_split, "every trial is held out"),
        (lambda t: t, lambda trials: leave_out(trials, "cell"), "names no cell"),
        (lambda t: replace(t, repetition=3), lambda trials: leave_out(trials, "repetition"), "names only repetition 3"),
        (lambda t: t, lambda trials: leave_out(trials, "emotion"), "expected repetition or cell"),
    ],
)
def test_what_cannot_be_split_is_said(trials: list[Trial], change: Callable, split: Callable, message: str):
    with pytest.raises(HighFiveError, match=message):
        split([change(trial) for trial in trials])

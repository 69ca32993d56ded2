import json
import sys

import numpy as np
import pytest

from highfive.hil.bench.speed import BenchOptions, bench_model
from highfive.hil.bench.synthetic_trials import made_up_trials
from highfive.model.errors import HighFiveError


def silent(label: str, total: int):
    return lambda note="", done=None: None


def test_made_up_motion_has_the_points_requested_and_comes_from_the_seed():
    trials, again = made_up_trials(1001, 12, 3), made_up_trials(1001, 12, 3)
    assert sum(len(trial.joints) for trial in trials) == 1001
    for first, second in zip(trials, again, strict=True):
        np.testing.assert_array_equal(first.joints, second.joints)
    assert not np.array_equal(made_up_trials(1001, 12, 4)[0].joints, trials[0].joints)


@pytest.mark.slow(15)
def test_bench_gives_every_figure_as_a_positive_number():
    options = BenchOptions(300, 12, 10, sizes=(200, 300), repeats=1, steps=5, training=False)
    result = json.loads(json.dumps(bench_model(options, silent)))
    assert result["objective_gradient_s"] > 0.0
    assert [row["points"] for row in result["by_points"]] == [200, 300]
    assert (result["peer"] is None) == (result["peer_objective_gradient_s"] is None) == ("peer_advice" in result)


def test_an_interpreter_that_is_none_is_reported():
    options = BenchOptions(300, 12, 10, peer_python=sys.executable + "-none")
    with pytest.raises(HighFiveError, match="--peer-python"):
        bench_model(options, silent)

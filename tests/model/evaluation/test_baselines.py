import numpy as np
import pytest

from highfive.model.evaluation import baselines
from highfive.model.evaluation.predictions import Body, online, regressed
from highfive.model.hgpdm.dataset import output_channels, training_set
from highfive.model.hgpdm.hierarchy import problem
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial


@pytest.fixture(scope="module")
def errors(trials: list[Trial], model: HGPDM, body: Body) -> dict[str, float]:
    """Mean joint error, rad, of each method on the held-out trials."""
    task = problem(training_set(trials, model.preset), model.preset)
    predictors = {
        "mean": baselines.constant_mean(task),
        "ridge": baselines.ridge(task),
        "knn": baselines.nearest_neighbours(task),
        "sparse_gp": baselines.regression(baselines.sparse_gp(task, 40, np.random.default_rng(0))),
    }
    methods = {name: regressed(predictor, task, body) for name, predictor in predictors.items()}
    methods["hgpdm"] = online(model, body)
    found = {}
    for name, method in methods.items():
        off = []
        for trial in trials:
            if trial.test:
                answer = method(trial)
                expected = output_channels(trial, answer.frames / trial.rate_hz)
                off.append(np.abs(answer.outputs - expected)[:, : model.joints].mean())
        found[name] = float(np.mean(off))
    return found


def test_every_method_beats_the_mean(errors: dict[str, float]):
    for name in ("ridge", "knn", "sparse_gp", "hgpdm"):
        assert errors[name] < 0.6 * errors["mean"], errors


def test_the_hierarchy_is_level_with_direct_regression(errors: dict[str, float]):
    assert errors["hgpdm"] < 1.5 * errors["sparse_gp"], errors


def test_nearest_neighbours_of_one_style_stay_in_it(trials: list[Trial], model: HGPDM):
    task = problem(training_set(trials, model.preset), model.preset)
    first = task.data.styles[:, 0] > 0.5
    answer = baselines.nearest_neighbours(task)(task.features[first], task.data.styles[first])
    assert np.abs(answer - task.data.outputs[first]).mean() < 0.1

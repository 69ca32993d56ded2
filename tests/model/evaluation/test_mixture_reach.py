"""The mixture of hypotheses against mixtures that are known."""

from dataclasses import replace

import numpy as np
from scipy.stats import multivariate_normal

from highfive.model.evaluation.mixture_reach import Hypotheses, MixtureReach, mixture_forecasts
from highfive.model.evaluation.predictions import Prediction
from highfive.model.hgpdm.dataset import Channels, training_set
from highfive.model.hgpdm.hierarchy import problem
from highfive.model.hgpdm.presets import DEFAULT
from highfive.model.hgpdm.trials import Trial


def two() -> Hypotheses:
    points = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 1.2]])
    return Hypotheses(np.array([0.25, 0.75]), points, np.array([0.01 * np.eye(3), np.diag([0.02, 0.01, 0.005])]))


def test_density_is_that_of_the_normal_parts() -> None:
    mixture, points = two(), np.random.default_rng(0).normal(size=(20, 3))
    parts = [multivariate_normal(p, c).pdf(points) for p, c in zip(mixture.points, mixture.covariances, strict=True)]
    np.testing.assert_allclose(mixture.log_density(points), np.log(0.25 * parts[0] + 0.75 * parts[1]), rtol=1e-9)
    assert mixture.number == np.exp(-0.25 * np.log(0.25) - 0.75 * np.log(0.75))
    np.testing.assert_allclose(mixture.mean, [0.45, 0.0, 1.15])


def test_of_its_own_draws_nine_of_ten_are_in_the_region() -> None:
    mixture, rng = two(), np.random.default_rng(1)
    which = rng.choice(2, 400, p=mixture.weights)
    drawn = [rng.multivariate_normal(mixture.points[k], mixture.covariances[k]) for k in which]
    inside = np.mean([mixture.level(point, rng, 400) < 0.9 for point in drawn])
    assert 0.85 < inside < 0.95


def test_of_a_few_frames_there_is_one_hypothesis(trials: list[Trial]) -> None:
    first = next(trial for trial in trials if not trial.test)
    late = slice(first.contact_frame - 8, None)
    cut = {name: getattr(first, name)[late] for name in ("hand_points", "joints", "root", "palm", "person_palm")}
    short = replace(first, **cut, contact_frame=8, arm_points=None)
    said = MixtureReach(problem(training_set(trials, DEFAULT), DEFAULT), [short])(short, 4)
    assert len(said.weights) == 1 and np.isfinite(said.covariances).all()


def test_a_reach_of_known_trials_is_foreseen_better_the_nearer_it_is(trials: list[Trial]) -> None:
    task = problem(training_set(trials, DEFAULT), DEFAULT)
    held, mixture = [trial for trial in trials if trial.test], MixtureReach(task, trials)
    outputs = [np.zeros((len(trial.joints), Channels(trial.joints.shape[1]).size)) for trial in held]
    answers = [Prediction(np.arange(len(o)), o, t.palm, None) for t, o in zip(held, outputs, strict=True)]
    said = mixture_forecasts(held, answers, mixture, np.array([0.05, 0.4, 60.0]))
    near, far, never = said["contact_point"]
    assert near is not None and far is not None and never is None
    assert near < 0.03 and near < far
    assert said["log_density_gaussian"] == [None, None, None]

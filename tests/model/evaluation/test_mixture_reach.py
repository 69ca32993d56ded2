"""What a mixture says of reaches, and that few frames are one hypothesis."""

from dataclasses import replace

import numpy as np

from highfive.model.evaluation.mixture_reach import MixtureReach, mixture_forecasts
from highfive.model.evaluation.predictions import Prediction
from highfive.model.hgpdm.dataset import Channels, training_set
from highfive.model.hgpdm.hierarchy import problem
from highfive.model.hgpdm.presets import DEFAULT
from highfive.model.hgpdm.trials import Trial


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

"""How the palm is led is learned from what was said of trials that were left out."""

import numpy as np
import pytest

from highfive.model.evaluation.predictions import Body
from highfive.model.geometry.arm_chain import arm_chain
from highfive.model.hgpdm.dataset import Channels, training_set
from highfive.model.hgpdm.hierarchy import Problem, problem
from highfive.model.hgpdm.pose_ensemble_training import LeftOut
from highfive.model.hgpdm.task_space import KNOTS
from highfive.model.hgpdm.task_space_training import STIFF, fit_task_space
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial

AT_CONTACT = int(np.flatnonzero(KNOTS == 0.0)[0])


@pytest.fixture(scope="module")
def task(model: HGPDM, trials: list[Trial]) -> Problem:
    return problem(training_set(trials, model.preset, model.emotions), model.preset)


def left_out(task: Problem, errors: np.ndarray) -> LeftOut:
    return LeftOut(errors, errors, np.ones(len(errors)), task.data.trial % 4)


@pytest.mark.slow
def test_a_palm_that_errs_by_trial_is_led_to_the_contact_where_the_palms_meet(
    task: Problem, model: HGPDM, trials: list[Trial], body: Body
) -> None:
    where, rng = Channels(model.joints), np.random.default_rng(0)
    errors = np.zeros_like(task.data.outputs)
    errors[:, where.palm] = 0.3 * rng.normal(size=(int(task.data.trial[-1]) + 1, 3))[task.data.trial]
    learned, chain = [trial for trial in trials if not trial.test], arm_chain(body.skeleton, body.palm_in_wrist)
    assert model.contact is not None
    space = fit_task_space(learned, task, model.contact, left_out(task, errors), chain)
    assert space is not None
    assert space.slopes[1, AT_CONTACT] == pytest.approx(1.0, abs=0.15)
    assert abs(space.slopes[0, AT_CONTACT]) < 0.3
    np.testing.assert_allclose(space.covariance, STIFF * np.eye(len(space.covariance)))  # the joints never erred


def test_the_covariance_is_that_of_the_chains_errors(
    task: Problem, model: HGPDM, trials: list[Trial], body: Body
) -> None:
    rng = np.random.default_rng(1)
    mixing = rng.normal(size=(task.data.outputs.shape[1],) * 2) * 0.02
    errors = rng.normal(size=task.data.outputs.shape) @ mixing
    errors[:, Channels(model.joints).clock] = 0.0
    learned, chain = [trial for trial in trials if not trial.test], arm_chain(body.skeleton, body.palm_in_wrist)
    assert model.contact is not None
    space = fit_task_space(learned, task, model.contact, left_out(task, errors), chain)
    assert space is not None
    columns = [model.joints, model.joints + 1, model.joints + 2, 0, 1, 2, 6, 7, 8]  # root, hips, wrist
    expected = (mixing.T @ mixing)[np.ix_(columns, columns)]
    np.testing.assert_allclose(space.covariance, expected, atol=0.3 * np.abs(expected).max())


def test_of_no_approach_nothing_is_learned(task: Problem, model: HGPDM, trials: list[Trial], body: Body) -> None:
    errors = np.zeros_like(task.data.outputs)
    errors[:, Channels(model.joints).clock] = 5.0  # by the pool's clock everybody is long past
    chain = arm_chain(body.skeleton, body.palm_in_wrist)
    assert model.contact is not None
    learned = [trial for trial in trials if not trial.test]
    assert fit_task_space(learned, task, model.contact, left_out(task, errors), chain) is None

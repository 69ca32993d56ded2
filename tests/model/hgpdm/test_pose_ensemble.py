"""Whether the whole arm is asked about the pose, by trials that are left out, and what it says online."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import EMOTIONS, made_up_trial, with_arm
from same_model import assert_same_model

from highfive.model.errors import HighFiveError
from highfive.model.gp import sparse
from highfive.model.hgpdm.arm_features import arm_history
from highfive.model.hgpdm.contact_training import fit_contact_layers
from highfive.model.hgpdm.dataset import training_set
from highfive.model.hgpdm.hierarchy import problem
from highfive.model.hgpdm.pose_ensemble import ArmAnswer, PoseEnsemble
from highfive.model.hgpdm.pose_ensemble_training import LeftOut, fit_ensemble, seen_arms
from highfive.model.hgpdm.store import load_model, save_model
from highfive.model.hgpdm.tempo import tempo_history
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.arm_track import FADE, arm_at
from highfive.model.online.responder import Responder

RATE = 60.0


def people(told: bool) -> list[Trial]:
    """The avatar's actor stands somewhere else each time. The person's head is there, too, if it is to be ``told``;
    else her arm is anywhere, as if it were somebody else's."""
    rng, trials = np.random.default_rng(3), []
    for goal in (0.3, 0.4, 0.5, 0.6, 0.7):
        for emotion in EMOTIONS:
            trial, aside = with_arm(made_up_trial(goal, emotion, RATE, rng)), rng.uniform(-0.3, 0.3)
            assert trial.arm_points is not None
            lies, head = rng.normal(0.0, 0.5, (3, 3)), np.array([[0.0] * 3, [0.0] * 3, [0.0, aside, 0.0]])
            arm = trial.arm_points + (head if told else lies)
            joints = trial.joints + 2.0 * aside
            trials.append(replace(trial, joints=joints, root=trial.root + np.array([0.0, aside, 0.0]), arm_points=arm))
    return trials


def fitted(model: HGPDM, trials: list[Trial]) -> tuple[PoseEnsemble, LeftOut]:
    data = training_set(trials, model.preset, model.emotions)
    ensemble, left_out = fit_ensemble(model, problem(data, model.preset), 40, 0, seen=seen_arms(trials, data))
    assert left_out is not None
    return ensemble, left_out


def arm_answer(model: HGPDM) -> ArmAnswer:
    assert model.ensemble is not None and model.ensemble.arm is not None
    return model.ensemble.arm


def asking(model: HGPDM, arm: ArmAnswer | None) -> PoseEnsemble:
    assert model.ensemble is not None
    return replace(model.ensemble, arm=arm)


@pytest.fixture(scope="module")
def told() -> list[Trial]:
    return people(True)


@pytest.fixture(scope="module")
def armed(model: HGPDM, told: list[Trial]) -> HGPDM:
    """Learned with one trial whose arm is not known."""
    trials = [*told[:-1], replace(told[-1], arm_points=None)]
    contact, arm = fit_contact_layers(trials, model.feature_map, model.preset.history, 40, whole_arm=True)
    ensemble, left_out = fitted(model, trials)
    assert ensemble.arm is not None and left_out.arm is not None and left_out.share == float(ensemble.arm.share)
    errors = [np.sqrt(np.mean(part[:, model.channels.root] ** 2)) for part in (left_out.with_arm, left_out.direct)]
    assert errors[0] < 0.9 * errors[1]
    last = training_set(trials, model.preset).trial == len(trials) - 1
    np.testing.assert_allclose(left_out.with_arm[last], left_out.direct[last])
    return replace(model, contact=contact, arm_contact=arm, ensemble=ensemble, task_space=None)


@pytest.mark.slow
def test_an_arm_that_tells_nothing_beyond_the_hand_is_not_asked(model: HGPDM):
    trials = people(False)
    ensemble, left_out = fitted(model, trials)
    assert ensemble.arm is None
    np.testing.assert_array_equal(left_out.with_arm, left_out.direct)


@pytest.mark.slow
def test_an_arm_that_tells_more_has_its_share_while_it_is_known_and_fades(armed: HGPDM, told: list[Trial]):
    """Pooled, the answer of a still person goes by the share from the others' to the arm's; hidden, back to theirs."""
    arm = arm_answer(armed)
    trial, still = told[2], 60
    hand, points = trial.hand_points[-1], arm_at(trial, len(trial.hand_points) - 1)
    both, alone = (Responder(replace(armed, ensemble=asking(armed, asked)), "neutral", RATE) for asked in (arm, None))
    for _ in range(still):
        answer, without = both.step(hand, None, points), alone.step(hand, None, points)
    at_rest = replace(
        trial,
        hand_points=np.tile(hand, (still, 1, 1)),
        arm_points=np.tile(points.points, (still, 1, 1)),
        joints=trial.joints[:still],
    )
    seen = arm.features(*(look(at_rest, np.array([(still - 1) / RATE])) for look in (arm_history, tempo_history)))
    said = np.asarray(sparse.means(sparse.with_kernel(arm.regression), seen, np.array([[1.0, 0.0]])))[0]
    low, high = (part.generated.avatar[armed.channels.root] for part in (without, answer))
    way = said[armed.channels.root] - low
    assert np.abs(way).max() > 0.05  # there is something to tell
    np.testing.assert_allclose(high - low, float(arm.share) * way, atol=0.02 * np.abs(way).max())

    hidden = [np.abs(both.step(hand, None, None).generated.avatar - alone.step(hand, None, None).generated.avatar)
              for _ in range(still)]  # fmt: skip
    largest = np.array([gap[armed.channels.root].max() for gap in hidden])
    assert np.all(np.diff(largest) <= 1e-9)
    assert largest[round((FADE + 0.2) * RATE)] < 0.02 * largest[0] and largest[0] > 0.01


@pytest.mark.slow
def test_its_file_holds_it_and_a_damaged_one_is_refused(armed: HGPDM, tmp_path: Path):
    path = tmp_path / "model.safetensors"
    save_model(armed, path)
    assert_same_model(load_model(path), armed)
    arm = arm_answer(armed)
    for broken, says in (
        (replace(arm, share=np.array(1.5)), "a share of the whole arm of 1.5"),
        (replace(arm, features=replace(arm.features, centre=np.zeros(3))), "features of the arm of shapes"),
    ):
        save_model(replace(armed, ensemble=asking(armed, broken)), path)
        with pytest.raises(HighFiveError, match=says):
            load_model(path)
    save_model(replace(armed, arm_contact=None), path)
    with pytest.raises(HighFiveError, match="of which no layer says where palms meet"):
        load_model(path)

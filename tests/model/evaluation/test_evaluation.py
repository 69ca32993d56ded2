from dataclasses import replace

import numpy as np
import pytest

from highfive.model.errors import HighFiveError
from highfive.model.evaluation import baselines
from highfive.model.evaluation import scores as evaluation
from highfive.model.evaluation.predictions import Body, Prediction, Uncertainty, online, regressed, scored_frames
from highfive.model.geometry import rotations
from highfive.model.hgpdm.dataset import CLOCK_SCALE, Channels, output_channels, training_set
from highfive.model.hgpdm.hierarchy import problem
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.responder import Responder

ERRORS = ("all_joints", "joint_angle", "palm", "palm_at_contact", "palm_at_contact_median", "contact_point",
          "time_to_contact", "lag_ms")  # fmt: skip


@pytest.fixture
def held(trials: list[Trial]) -> list[Trial]:
    return [trial for trial in trials if trial.test]


def recorded(trial: Trial, uncertainty: float | None = None) -> Prediction:
    """An answer that is what was recorded."""
    frames = scored_frames(trial)
    outputs = output_channels(trial, frames / trial.rate_hz)
    if uncertainty is None:
        return Prediction(frames, outputs, trial.palm, None)
    spread = np.tile(uncertainty**2 * np.eye(3), (len(frames), 1, 1))
    return Prediction(frames, outputs, trial.palm, Uncertainty(np.full(outputs.shape, uncertainty), spread, spread))


def test_what_was_recorded_has_no_error(held: list[Trial], body: Body):
    answers = [recorded(trial) for trial in held]
    truth = evaluation.held_out(held, answers, body)
    scores = evaluation.score(held, answers, truth, body)
    assert {name: scores[name] for name in ERRORS} == pytest.approx(dict.fromkeys(ERRORS, 0.0), abs=1e-6)
    assert not any("within" in name for name in scores)
    assert scores.items() >= evaluation.recorded_smoothness(held).items()


def test_known_errors_are_found(held: list[Trial], body: Body):
    where, late = Channels(9), 0.05
    answers = []
    for trial in held:
        answer = recorded(trial)
        outputs = answer.outputs.copy()
        outputs[:, where.contact] += [0.03, 0.0, 0.04]
        outputs[:, where.clock] = np.tanh(
            np.arctanh(outputs[:, where.clock].clip(-0.999999, 0.999999)) + late / CLOCK_SCALE
        )
        answers.append(replace(answer, outputs=outputs, palm=trial.palm + np.array([0.0, 0.0, 0.02])))
    truth = evaluation.held_out(held, answers, body)
    scores = evaluation.score(held, answers, truth, body)
    assert scores["contact_point"] == pytest.approx(0.05)
    assert scores["time_to_contact"] == pytest.approx(late)
    assert scores["palm"] == scores["palm_at_contact"] == pytest.approx(0.02)
    assert evaluation.contact_errors(held, answers) == pytest.approx(np.full(len(held), 0.02))


def test_gaussian_errors_of_the_size_that_was_said_are_calibrated(held: list[Trial], body: Body):
    rng, answers = np.random.default_rng(0), []
    for trial in held * 12:
        answer = recorded(trial, 0.01)
        answers.append(replace(answer, outputs=answer.outputs + 0.01 * rng.normal(size=answer.outputs.shape)))
    truth = evaluation.held_out(held * 12, answers, body)
    scores = evaluation.score(held * 12, answers, truth, body)
    for kind in evaluation.CALIBRATED:
        assert scores[f"{kind}_within_50"] == pytest.approx(0.5, abs=0.1)
        assert scores[f"{kind}_within_90"] == pytest.approx(0.9, abs=0.06)
        assert scores[f"{kind}_z2"] == pytest.approx(1.0, abs=0.2)


def test_the_doubt_is_that_of_the_responder(held: list[Trial], model: HGPDM, body: Body):
    trial = held[0]
    answer, responder = online(model, body)(trial), Responder(model, trial.emotion, trial.rate_hz)
    responses = [responder.step(hand) for hand in trial.hand_points]
    assert answer.uncertainty is not None
    for row, frame in enumerate(answer.frames):
        assert np.allclose(np.diagonal(answer.uncertainty.palm[row]), responses[frame].palm_std ** 2)
        forecast = responses[frame].contact
        assert forecast is not None
        assert np.allclose(answer.uncertainty.contact[row], forecast.covariance[:3, :3])
        assert np.allclose(answer.outputs[row, model.channels.contact], forecast.point)
        assert np.all(np.linalg.eigvalsh(answer.uncertainty.contact[row]) > 0.0)


@pytest.mark.slow
def test_a_sparse_gp_doubts_more_where_it_has_seen_nothing(trials: list[Trial], model: HGPDM, body: Body):
    task = problem(training_set(trials, model.preset), model.preset)
    layer = baselines.sparse_gp(task, 20, np.random.default_rng(0))
    method = regressed(baselines.regression(layer), task, body, layer)
    near, far = (
        method(replace(trials[0], hand_points=trials[0].hand_points + away)).uncertainty for away in (0.0, 0.5)
    )
    assert near is not None and far is not None
    assert far.deviations[:, Channels(9).palm].mean() > 1.2 * near.deviations[:, Channels(9).palm].mean()


def test_an_unknown_emotion_is_said(held: list[Trial], model: HGPDM, body: Body):
    with pytest.raises(HighFiveError, match="'bored'; the model knows neutral, angry"):
        online(model, body)(replace(held[0], emotion="bored"))


def test_the_palm_is_where_the_whole_body_puts_it(body: Body):
    skeleton, rng = body.skeleton, np.random.default_rng(0)
    outputs = rng.normal(size=(5, Channels(9).size))
    pose = skeleton.from_rotation_vectors(outputs[:, :9])
    positions, orientations = skeleton.forward_kinematics(outputs[:, Channels(9).root], pose)
    wrist = skeleton.index("right_wrist")
    palm = positions[:, wrist] + rotations.rotate(orientations[:, wrist], body.palm_in_wrist)
    assert np.allclose(body.palm(outputs), palm)
    assert np.allclose(body.joints(outputs), positions)

import numpy as np
import pytest

from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.responder import Responder, Response

RATE = 60.0


@pytest.fixture(scope="module")
def responder(model: HGPDM) -> Responder:
    return Responder(model, "neutral", RATE)


def play(responder: Responder, trial: Trial, hidden: range = range(0)) -> list[Response]:
    responder.reset()
    return [responder.step(None if n in hidden else hand) for n, hand in enumerate(trial.hand_points)]


def speeds(responses: list[Response]) -> np.ndarray:
    return np.abs(np.diff([response.joints for response in responses], axis=0)).max(axis=1)


def test_follows_a_held_out_trial(responder: Responder, trials: list[Trial]):
    trial = next(t for t in trials if t.test and t.emotion == "neutral")
    responses = play(responder, trial)
    error = np.abs(np.array([r.joints for r in responses]) - trial.joints).mean()
    still = np.abs(trial.joints - trial.joints.mean(axis=0)).mean()
    assert error < 0.2 * still
    contact = trial.contact_frame
    assert np.linalg.norm(responses[contact].palm - trial.palm[contact]) < 0.05
    times = [responses[contact - n].time_to_contact for n in (20, 10)]
    np.testing.assert_allclose(times, [20 / RATE, 10 / RATE], atol=0.1)


def test_deviations_belong_to_the_answer_however_late_they_are_read(responder: Responder, trials: list[Trial]):
    responder.reset()
    first = responder.step(trials[0].hand_points[0])
    play(responder, trials[0], range(10, len(trials[0].hand_points)))
    responder.reset()
    again = responder.step(trials[0].hand_points[0])
    for name in ("joints", "root", "palm", "contact_point", "hand"):
        late, soon = getattr(first, f"{name}_std"), getattr(again, f"{name}_std")
        np.testing.assert_array_equal(late, soon)
        assert late.shape == getattr(first, name).shape
        assert np.all(late > 0.0)


def test_hidden_hand_gives_growing_doubt_and_smooth_motion(responder: Responder, trials: list[Trial]):
    trial = next(t for t in trials if t.test and t.emotion == "neutral")
    begin, end = trial.contact_frame - 25, trial.contact_frame - 7
    full, gap = play(responder, trial), play(responder, trial, range(begin, end))
    spread = [np.trace(r.latent_covariance) for r in gap]
    assert np.all(np.diff(spread[begin : end - 1]) > 0.0)
    assert spread[end - 1] > 3.0 * spread[begin - 1]
    assert spread[end + 30] < 2.0 * spread[begin - 1]  # once its history, too, is of seen hands
    assert speeds(gap).max() < 2.0 * speeds(full).max()


def test_far_from_the_data_the_back_projection_loses_weight(responder: Responder, trials: list[Trial]):
    trial = trials[0]
    play(responder, trial)
    near = responder.step(trial.hand_points[-1])
    far = responder.step(trial.hand_points[-1] + 3.0)
    assert np.trace(far.latent_covariance) > np.trace(near.latent_covariance)
    assert np.abs(far.joints - near.joints).max() < 0.3


def test_style_changes_move_smoothly_to_the_new_style(responder: Responder, trials: list[Trial]):
    still = trials[0].hand_points[0]
    responder.set_style("neutral")
    responder.reset()
    before = [responder.step(still) for _ in range(30)][-1]
    responder.set_style({"angry": 1.0})
    after = [before] + [responder.step(still) for _ in range(90)]
    whole = np.abs(after[-1].joints - before.joints).max()
    assert whole > 0.05
    assert speeds(after)[0] < 0.05 * whole  # it sets off from rest
    responder.set_style("angry")
    responder.reset()
    settled = [responder.step(still) for _ in range(30)][-1]
    np.testing.assert_allclose(after[-1].joints, settled.joints, atol=0.02 * whole)
    responder.set_style("neutral")


def test_same_input_gives_the_same_answer_bit_for_bit(responder: Responder, trials: list[Trial]):
    first, second = (play(responder, trials[1])[-1] for _ in range(2))
    np.testing.assert_array_equal(first.joints, second.joints)
    np.testing.assert_array_equal(first.latent_covariance, second.latent_covariance)


def test_forecast_begins_at_the_belief_and_spreads(responder: Responder, trials: list[Trial]):
    responder.reset()
    response = [responder.step(hand) for hand in trials[0].hand_points[:60]][-1]
    ahead = responder.forecast(0.2)
    assert 0.2 - 1e-9 <= ahead[-1].ahead < 0.2 + responder.model.lag
    assert np.linalg.norm(ahead[0].palm - response.palm) < 0.2
    assert np.trace(ahead[-1].latent_covariance) > np.trace(response.latent_covariance)
    np.testing.assert_array_equal(ahead[0].joints, responder.forecast(0.2)[0].joints)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ("cheerful", "knows neutral, angry"),
        ({"neutral": 0.5, "sad": 0.5}, "no emotion sad"),
        ([0.7, 0.7], "must sum to 1"),
        ([1.5, -0.5], "none may be negative"),
        ([1.0], "neutral, angry"),
        ([0.5, float("nan")], "finite numbers"),
    ],
)
def test_bad_style_weights_are_named(responder: Responder, weights, message: str):
    with pytest.raises(HighFiveError, match=message):
        responder.set_style(weights)


def test_bad_hands_are_named(responder: Responder):
    """And leave no trace: the next answer is that of a responder that was never asked."""
    hand = np.zeros((2, 3))
    responder.reset()
    before = [responder.step(None) for _ in range(2)][-1]
    responder.reset()
    responder.step(None)
    wrong = [np.zeros((3, 3)), np.zeros(6), np.zeros((3, 2)), np.zeros((1, 2, 3)), 0.0]
    for points in wrong:
        with pytest.raises(HighFiveError, match="shape"):
            responder.step(points)
    for covariance in (np.zeros((2, 3)), np.zeros(6), np.zeros((3, 2, 3))):
        with pytest.raises(HighFiveError, match="shape"):
            responder.step(hand, covariance)
        with pytest.raises(HighFiveError, match="shape"):
            responder.step(None, covariance)
    for bad in (np.nan, np.inf):
        with pytest.raises(HighFiveError, match="NaN"):
            responder.step(np.full((2, 3), bad))
        with pytest.raises(HighFiveError, match="NaN"):
            responder.step(None, np.full((2, 3, 3), bad))
        with pytest.raises(HighFiveError, match="metres"):
            responder.step(np.full((2, 3), 1e60))
    with pytest.raises(HighFiveError, match="variance"):
        responder.step(hand, np.tile(-np.eye(3), (2, 1, 1)))
    assert np.array_equal(responder.step(None).joints, before.joints)


@pytest.mark.parametrize("size", [3e1, 1e3, 1e6])
def test_a_responder_recovers_from_what_no_hand_can_be(responder: Responder, trials: list[Trial], size: float):
    """One such hand, or one such covariance; a moment later the answers are those of one that never saw it."""
    hands = trials[0].hand_points[:90]
    responder.reset()
    usual = [responder.step(hand) for hand in hands][-1]
    for points, covariance in ((np.full((2, 3), size), None), (hands[0], np.full((2, 3, 3), size))):
        responder.reset()
        for _ in range(3):
            responder.step(points, covariance)
        for hand in hands:
            response = responder.step(hand)
            assert np.isfinite(response.joints).all()
        np.testing.assert_allclose(response.joints, usual.joints, atol=0.05)


@pytest.mark.parametrize("part", ["latent", "covariance", "hands", "residual"])
def test_a_belief_that_is_spoilt_begins_anew(responder: Responder, trials: list[Trial], part: str):
    """Rounding may leave a number that is none; without a new beginning it would stay for ever."""
    hands = trials[0].hand_points[:90]
    responder.reset()
    usual = [responder.step(hand) for hand in hands][-1]
    spoilt = getattr(responder._belief, part).copy()
    spoilt.flat[0] = np.nan
    responder._belief = responder._belief._replace(**{part: spoilt})
    for hand in hands:
        response = responder.step(hand)
        assert np.isfinite(response.joints).all()
    np.testing.assert_allclose(response.joints, usual.joints, atol=0.05)

"""The whole arm tells where and when palms will meet, for as long as all of it is known; else the hand does."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import EMOTIONS, made_up_trial, with_arm

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.arm_features import HISTORY, SIZE, arm_history, fit_arm_features
from highfive.model.hgpdm.contact_layer import SPEED_SPAN
from highfive.model.hgpdm.contact_training import fit_contact_layers
from highfive.model.hgpdm.store import load_model, save_model
from highfive.model.hgpdm.tempo import TEMPO, tempo_history, tempo_of
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.arm_track import FADE, ArmPoints, ArmTrack, arm_at, known_tempo
from highfive.model.online.contact_forecast import ContactForecast
from highfive.model.online.responder import Responder

RATE = 60.0
WINDOW = round(HISTORY[-1] * RATE) + 2


@pytest.fixture(scope="module")
def armed(model: HGPDM) -> HGPDM:
    rng = np.random.default_rng(1)
    known = [with_arm(made_up_trial(goal, emotion, RATE, rng)) for goal in (0.3, 0.5, 0.7) for emotion in EMOTIONS]
    contact, arm = fit_contact_layers(known, model.feature_map, model.preset.history, 40, whole_arm=True)
    assert arm is not None
    return replace(model, contact=contact, arm_contact=arm)


@pytest.fixture(scope="module")
def trial() -> Trial:
    return with_arm(made_up_trial(0.45, "neutral", RATE, np.random.default_rng(5), test=True))


def said(model: HGPDM, trial: Trial, arms: dict[int, ArmPoints | None] | None = None) -> list[ContactForecast]:
    """Every tick's forecast, with the arm of the trial but where ``arms`` has another."""
    responder = Responder(model, "neutral", RATE)
    found: list[ContactForecast] = []
    for frame, hand in enumerate(trial.hand_points):
        arm = arms[frame] if arms is not None and frame in arms else arm_at(trial, frame)
        contact = responder.step(hand, None, arm).contact
        assert contact is not None
        found.append(contact)
    return found


def same(one: ContactForecast, other: ContactForecast) -> bool:
    return np.array_equal(one.point, other.point) and np.array_equal(one.covariance, other.covariance)


def turned(arms: Array, angle: float) -> Array:
    """About the vertical."""
    c, s = np.cos(angle), np.sin(angle)
    return arms.reshape(*arms.shape[:-1], 5, 3) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def test_lengths_stay_as_they_are_when_everything_is_turned(trial: Trial) -> None:
    arms = arm_history(trial, np.arange(0.4, 1.3, 0.05))
    tempo = tempo_history(trial, np.arange(0.4, 1.3, 0.05))
    features = fit_arm_features(arms, tempo)
    first = features(arms, tempo)
    assert first.shape == (18, SIZE) and np.allclose(first.mean(axis=0), 0.0)
    again = features(turned(arms, 1.1).reshape(arms.shape), tempo)
    np.testing.assert_allclose(again[:, 45:], first[:, 45:], atol=1e-9)
    assert np.abs(again[:, :45] - first[:, :45]).max() > 0.5


@pytest.mark.slow
def test_a_doubted_point_widens_the_belief_by_what_it_would_change(armed: HGPDM, trial: Trial) -> None:
    """The covariance by derivatives, against differences: every tick's arm is doubted in one coordinate."""
    frame, deviation, step = trial.contact_frame - 12, 0.02, 1e-4
    for point, axis in ((0, 2), (2, 1)):  # the shoulder also tells the tempo, which counts as known
        doubt = np.zeros((3, 3, 3))
        doubt[point, axis, axis] = deviation**2 + 3e-3**2
        arms = {n: ArmPoints(arm_at(trial, n).points, doubt) for n in range(len(trial.hand_points))}  # type: ignore
        sure, doubted = said(armed, trial)[frame], said(armed, trial, arms)[frame]
        assert np.array_equal(sure.point, doubted.point)
        grown = doubted.covariance - sure.covariance
        assert np.linalg.eigvalsh(grown).min() > -1e-9 and grown.trace() > 0.0
        # Each of the times that it looks back to errs by itself.
        expected = np.zeros((3, 3))
        for back in np.round(np.array([0.0, *HISTORY]) * RATE, 6):
            share = {int(back): 1.0 - back % 1.0, int(back) + 1: back % 1.0}
            moved = dict(arms)
            for ago, part in share.items():
                points = arms[frame - ago].points.copy()
                points[point, axis] += step * part
                moved[frame - ago] = ArmPoints(points, np.zeros((3, 3, 3)))
            change = (said(armed, trial, moved)[frame].point - sure.point) / step
            expected += deviation**2 * np.outer(change, change)
        knuckles = [trial.hand_points[frame - back, 1] for back in (0, round(SPEED_SPAN * RATE))]
        speed = float(np.linalg.norm(np.subtract(*knuckles))) / SPEED_SPAN
        arm = armed.arm_contact
        assert arm is not None
        factor = arm.layer.calibrated(sure.time, speed, np.ones((4, 4)))[1][0, 0]
        # Covariances are pooled.
        assert grown[:3, :3].trace() == pytest.approx(factor * expected.trace() / arm.share, rel=0.15)


@pytest.mark.slow
def test_without_an_arm_the_hand_is_answered_as_ever(armed: HGPDM, trial: Trial) -> None:
    bare = replace(armed, arm_contact=None)
    nothing = dict.fromkeys(range(len(trial.hand_points)))
    pairs = zip(said(armed, trial, nothing), said(bare, trial), strict=True)
    assert all(same(one, other) for one, other in pairs)
    assert not same(said(armed, trial)[60], said(bare, trial)[60])


@pytest.mark.slow
def test_a_hidden_point_is_the_hands_forecast_until_it_was_seen_for_as_long_as_is_looked_back(
    armed: HGPDM, trial: Trial
) -> None:
    """It fades into it and back: no forecast jumps."""
    hidden, fade = range(40, 44), round(FADE * RATE)
    gap = said(armed, trial, dict.fromkeys(hidden))
    whole, hand = said(armed, trial), said(replace(armed, arm_contact=None), trial)
    back = hidden.stop + WINDOW - 1
    for frame in range(len(gap)):
        if frame < hidden.start or frame >= back + fade:  # of the tempo some little stays unknown
            near = 1e-9 if frame < hidden.start else 0.02
            assert np.allclose(gap[frame].point, whole[frame].point, rtol=0.0, atol=near), frame
        elif hidden.start + fade <= frame < back:
            assert same(gap[frame], hand[frame]), frame
    jumps = [np.linalg.norm(np.diff([one.point for one in said], axis=0), axis=1).max() for said in (whole, gap)]
    assert jumps[1] < 1.5 * jumps[0] + 0.002


def test_trials_without_an_arm_are_refused_where_it_is_wanted(model: HGPDM, trial: Trial) -> None:
    with pytest.raises(HighFiveError, match="elbow, shoulder and head are known in 1 of 2 trials: too few"):
        bare = [replace(trial, arm_points=None), trial]
        fit_contact_layers(bare, model.feature_map, model.preset.history, 40, whole_arm=True)


@pytest.mark.slow
def test_what_both_layers_say_is_pooled_and_meets_the_truth(armed: HGPDM, trial: Trial) -> None:
    whole, hand = said(armed, trial), said(replace(armed, arm_contact=None), trial)
    for before in (6, 12, 18):
        frame = trial.contact_frame - before
        assert np.linalg.norm(whole[frame].point - trial.palm[trial.contact_frame]) < 0.05
        assert whole[frame].time == pytest.approx(before / RATE, abs=0.05)
        share = armed.arm_contact.share  # type: ignore[union-attr]
        alone = (whole[frame].point - (1.0 - share) * hand[frame].point) / share
        assert np.isfinite(alone).all() and not np.allclose(alone, hand[frame].point)


@pytest.mark.slow
def test_a_file_keeps_it_and_one_of_before_has_none(armed: HGPDM, trial: Trial, tmp_path) -> None:
    save_model(armed, tmp_path / "armed.safetensors")
    read = load_model(tmp_path / "armed.safetensors")
    assert all(same(one, other) for one, other in zip(said(read, trial), said(armed, trial), strict=True))
    save_model(replace(armed, arm_contact=None), tmp_path / "before.safetensors")
    assert load_model(tmp_path / "before.safetensors").arm_contact is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((2, 3)), "arm points of shape .* elbow, shoulder, head"),
        (np.full((3, 3), np.nan), "the arm points hold NaN or infinity"),
        (np.full((3, 3), 1e9), "the arm points hold 1e\\+09"),
    ],
)
def test_points_that_no_arm_has_are_refused(armed: HGPDM, trial: Trial, points: Array, message: str) -> None:
    responder = Responder(armed, "neutral", RATE)
    with pytest.raises(HighFiveError, match=message):
        responder.step(trial.hand_points[0], None, ArmPoints(points, np.zeros((3, 3, 3))))


@pytest.mark.slow
def test_a_variance_below_zero_is_refused(armed: HGPDM, trial: Trial) -> None:
    assert trial.arm_points is not None
    arm = ArmPoints(trial.arm_points[0], np.full((3, 3, 3), -1e-6))
    with pytest.raises(HighFiveError, match="a variance of -1e-06 m² of the arm points"):
        Responder(armed, "neutral", RATE).step(trial.hand_points[0], None, arm)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [30.0, 60.0])
def test_the_tempo_of_ticks_is_the_one_that_was_learned(armed: HGPDM, trial: Trial, rate: float) -> None:
    every = round(RATE / rate)
    assert armed.arm_contact is not None and trial.arm_points is not None
    points = trial.arm_points[::every]
    seen = replace(trial, rate_hz=rate, hand_points=trial.hand_points[::every], arm_points=points)
    track, found = ArmTrack(armed.arm_contact, rate), []
    for hand, arm in zip(seen.hand_points, points, strict=True):
        last = track.step(hand.ravel(), np.zeros(6), ArmPoints(arm, np.zeros((3, 3, 3))))
        assert last is not None
        value = np.empty(TEMPO)
        tempo_of(last.tempo, value)
        found.append(value)
    learned = tempo_history(seen, np.arange(len(found)) / rate)
    np.testing.assert_allclose(found, learned, rtol=0.0, atol=1e-9)
    assert np.ptp(learned, axis=0).min() > 0.1  # a hand that moves


@pytest.mark.slow
def test_a_tempo_that_no_reach_has_leaves_it_to_the_hand(armed: HGPDM, trial: Trial) -> None:
    """Who gestures for long and then reaches is no slow reach."""
    assert armed.arm_contact is not None
    track, last = ArmTrack(armed.arm_contact, RATE), None
    for frame in range(trial.contact_frame - 10):
        last = track.step(trial.hand_points[frame].ravel(), np.zeros(6), arm_at(trial, frame))
    assert last is not None
    furthest = armed.arm_contact.features.furthest
    value = np.empty(TEMPO)
    assert known_tempo(last.tempo, furthest, value) == 1.0
    knuckles, by_hand = trial.hand_points[0, 1], (np.array([0.3, 0.1, 0.2, 0.4]), np.diag([0.01, 0.01, 0.01, 0.02]))
    shares = []
    for beyond in (1.0, 10.0):
        tempo = last.tempo.copy()
        tempo[1] = furthest[1] + (beyond - 1.0) * max(furthest[1], 1.0)  # m, of its way
        shares.append(known_tempo(tempo, furthest, value))
        found = track.forecast(last._replace(tempo=tempo), knuckles, 0.5, by_hand)
    assert shares == [1.0, 0.0]
    clock, _ = armed.arm_contact.layer.calibrated(by_hand[0][3], 0.5, by_hand[1])
    np.testing.assert_allclose([*(found.point - knuckles), found.time], [*by_hand[0][:3], clock])


@pytest.mark.slow
def test_ticks_that_are_passed_over_count(armed: HGPDM, trial: Trial) -> None:
    def since(passed_over: bool) -> float:
        responder = Responder(armed, "neutral", RATE)
        for frame in range(trial.contact_frame - 20):
            responder.step(trial.hand_points[frame], None, arm_at(trial, frame))
        if passed_over:
            responder.skip(10)
        for _ in range(0 if passed_over else 10):
            responder.step(None)
        frame = trial.contact_frame - 10
        responder.step(trial.hand_points[frame], None, arm_at(trial, frame))
        assert responder._arm is not None
        return float(responder._arm._tempo[0])

    assert since(True) == pytest.approx(since(False))

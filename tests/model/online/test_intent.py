"""Whether a contact is coming: learned from approaches and other gestures, said tick by tick, kept in the file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import EMOTIONS, made_up_trial, reach
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.hgpdm.dataset import hand_history
from highfive.model.hgpdm.intent_features import HISTORY, SIZE, raw_features
from highfive.model.hgpdm.intent_layer import IntentLayer, probabilities
from highfive.model.hgpdm.intent_training import INTENT_TRAINING, examples, fit_intent
from highfive.model.hgpdm.store import load_model, save_model
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Gesture, Trial
from highfive.model.online.responder import Responder

RATE = 60.0
QUICK = replace(INTENT_TRAINING, iterations=20, inducing=60, frames=1000)


def other(height: float, rng: np.random.Generator) -> Gesture:
    """A hand that goes up beside its person and does not come."""
    times = np.arange(0.0, 2.4, 1.0 / RATE)
    rise = reach((times - 0.4) / 0.8) - reach((times - 1.4) / 0.8)
    wrist = np.stack([1.0 + 0.1 * rise, 0.4 * rise, 0.9 + height * rise], axis=1)
    hands = np.stack([wrist, wrist + np.array([0.0, 0.0, 0.08])], axis=1)
    return Gesture(RATE, hands + rng.normal(size=hands.shape) * 1e-3, "up")


@pytest.fixture(scope="module")
def taught() -> IntentLayer:
    rng = np.random.default_rng(1)
    trials = [made_up_trial(goal, emotion, RATE, rng) for goal in (0.3, 0.4, 0.5, 0.6) for emotion in EMOTIONS]
    return fit_intent(trials, [other(height, rng) for height in np.linspace(0.3, 0.8, 8)], settings=QUICK)


@pytest.fixture(scope="module")
def knowing(model: HGPDM, taught: IntentLayer) -> HGPDM:
    return replace(model, intent=taught)


def said(model: HGPDM, hands: Array, hidden: slice = slice(0, 0)) -> list[float | None]:
    responder = Responder(model, "neutral", RATE)
    unseen = range(len(hands))[hidden]
    return [responder.step(None if n in unseen else hand).contact_probability for n, hand in enumerate(hands)]


def by_the_book(layer: IntentLayer, track: Trial | Gesture) -> Array:
    """Every frame's probability, from the trial's own interpolation and the posterior as it was learned."""
    features = layer.features(hand_history(track, np.arange(len(track.hand_points)) / RATE, HISTORY))
    mean, variance = (np.asarray(f(layer.posterior, features))[:, 0].copy() for f in (sparse.means, sparse.variances))
    return probabilities(mean, variance, layer.squash)


@pytest.mark.slow
def test_hands_that_it_never_saw_are_told_apart(taught: IntentLayer) -> None:
    rng = np.random.default_rng(9)
    late = slice(round(0.9 * RATE), round(1.3 * RATE))
    assert by_the_book(taught, made_up_trial(0.45, "neutral", RATE, rng))[late].min() > 0.75
    assert by_the_book(taught, other(0.55, rng))[late].max() < 0.2


@pytest.mark.slow
def test_online_it_says_what_the_layer_says_of_the_recording(knowing: HGPDM, taught: IntentLayer) -> None:
    for track in (made_up_trial(0.45, "angry", RATE, np.random.default_rng(2)), other(0.5, np.random.default_rng(3))):
        np.testing.assert_allclose(said(knowing, track.hand_points), by_the_book(taught, track), atol=1e-6)


@pytest.mark.slow
def test_while_the_hand_is_hidden_the_word_stands(knowing: HGPDM) -> None:
    track = made_up_trial(0.45, "angry", RATE, np.random.default_rng(2))
    found = said(knowing, track.hand_points, slice(50, 60))
    assert found[49:60] == [found[49]] * 11 and found[60] != found[49]


@pytest.mark.slow
def test_before_a_hand_is_seen_and_without_the_layer_nothing_is_said(model: HGPDM, knowing: HGPDM) -> None:
    responder = Responder(knowing, "neutral", RATE)
    assert responder.step(None).contact_probability is None
    assert 0.0 <= responder.step(np.ones((2, 3))).contact_probability <= 1.0  # type: ignore[operator]
    responder.reset()
    assert responder.step(None).contact_probability is None
    assert said(model, np.ones((3, 2, 3))) == [None] * 3


@pytest.mark.slow
def test_what_is_answered_does_not_depend_on_it(model: HGPDM, knowing: HGPDM) -> None:
    hands = made_up_trial(0.45, "angry", RATE, np.random.default_rng(2)).hand_points
    one, two = Responder(model, "neutral", RATE), Responder(knowing, "neutral", RATE)
    for hand in hands:
        np.testing.assert_allclose(one.step(hand).joints, two.step(hand).joints, atol=1e-9)


def test_probabilities_grow_with_the_mean_and_know_less_where_the_variance_is_large() -> None:
    mean, squash = np.linspace(-2.0, 2.0, 41), np.array([3.0, 0.0])
    sure, unsure = (probabilities(mean, np.full(41, variance), squash) for variance in (0.01, 4.0))
    assert np.all(np.diff(sure) > 0.0) and np.all(np.diff(unsure) > 0.0)
    assert np.all(np.abs(unsure - 0.5) <= np.abs(sure - 0.5) + 1e-12)
    np.testing.assert_allclose(sure + sure[::-1], 1.0, atol=1e-12)


def test_features_turn_with_the_hand_and_lengths_stay() -> None:
    hands = np.random.default_rng(0).normal(size=(20, len(HISTORY) + 1, 6))
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turned = (hands.reshape(20, -1, 2, 3) @ turn.T).reshape(hands.shape)
    one, two = raw_features(hands), raw_features(turned)
    vectors = SIZE - len(HISTORY)
    np.testing.assert_allclose(one[:, :vectors].reshape(20, -1, 3) @ turn.T, two[:, :vectors].reshape(20, -1, 3))
    np.testing.assert_allclose(one[:, vectors:], two[:, vectors:])


def test_both_classes_count_alike_however_many_there_are() -> None:
    rng = np.random.default_rng(1)
    found = examples([made_up_trial(0.4, "angry", RATE, rng)], [other(0.5, rng) for _ in range(7)], 0)
    coming, not_coming = (found.weights[found.labels == label].sum() for label in (1.0, -1.0))
    assert coming == pytest.approx(not_coming)


def test_of_one_class_alone_nothing_is_learned() -> None:
    with pytest.raises(HighFiveError, match="1 trials with and 0 without a contact"):
        fit_intent([made_up_trial(0.4, "angry", RATE, np.random.default_rng(1))], [])


@pytest.mark.slow
def test_the_file_keeps_it_and_files_of_before_have_none(model: HGPDM, knowing: HGPDM, tmp_path: Path) -> None:
    path = tmp_path / "m.safetensors"
    save_model(knowing, path)
    hands = made_up_trial(0.45, "angry", RATE, np.random.default_rng(2)).hand_points
    assert said(load_model(path), hands) == said(knowing, hands)
    save_model(model, path)
    assert load_model(path).intent is None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["intent.squash", "intent_features.centre", "intent.weights"])
def test_a_damaged_layer_is_refused(knowing: HGPDM, tmp_path: Path, name: str) -> None:
    path = tmp_path / "m.safetensors"
    save_model(knowing, path)
    with safe_open(str(path), framework="numpy") as file:
        metadata = file.metadata()
    save_file(load_file(path) | {name: np.zeros((7, 3))}, path, metadata)
    with pytest.raises(HighFiveError, match="damaged model"):
        load_model(path)

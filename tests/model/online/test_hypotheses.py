"""Where the palms may meet: what was learned while the hand rests, the place of this reach once it has risen."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import EMOTIONS

from highfive.model.errors import HighFiveError
from highfive.model.gp.mixture import GaussianMixture
from highfive.model.hgpdm.contact_places import contact_places
from highfive.model.hgpdm.store import load_model, save_model
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.reaction import SimpleReaction, hypotheses_of_contact
from highfive.model.online.responder import Responder, Response


def held_out(trials: list[Trial]) -> Trial:
    return next(trial for trial in trials if trial.test)


def answered(model: HGPDM, trial: Trial, frames: int) -> Response:
    responder = Responder(model, EMOTIONS[0], trial.rate_hz)
    for hand in trial.hand_points[: frames - 1]:
        responder.step(hand)
    return responder.step(trial.hand_points[frames - 1])


def test_the_places_are_those_of_the_contacts(model: HGPDM, trials: list[Trial]) -> None:
    contacts = np.array([trial.palm[trial.contact_frame] for trial in trials if not trial.test])
    assert model.places is not None
    assert model.places.weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(model.places.mean, contacts.mean(axis=0), atol=1e-6)


def test_places_far_apart_are_told_apart_as_the_hand_nears_one(model: HGPDM, trials: list[Trial]) -> None:
    trial = held_out(trials)
    there, beside = trial.palm[trial.contact_frame], np.array([0.0, 0.6, 0.0])
    places = GaussianMixture(np.full(2, 0.5), np.array([there, there + beside]), np.full((2, 3, 3), 4e-4 * np.eye(3)))
    two = replace(model, places=places)
    late = answered(two, trial, trial.contact_frame - round(0.1 * trial.rate_hz)).hypotheses
    assert late is not None and late.weights[0] > 0.99
    assert late.points is places.points


def test_what_may_be_no_contact_leaves_the_weights_as_they_were(model: HGPDM, trials: list[Trial]) -> None:
    trial = held_out(trials)
    assert model.places is not None
    last = answered(model, trial, trial.contact_frame)
    waits = replace(last, contact_probability=0.0).hypotheses
    assert waits is not None
    np.testing.assert_allclose(waits.weights, model.places.weights)


def test_a_model_of_before_has_none(model: HGPDM, trials: list[Trial], tmp_path: Path) -> None:
    save_model(replace(model, places=None), tmp_path / "before.safetensors")
    before = load_model(tmp_path / "before.safetensors")
    assert before.places is None
    assert answered(before, held_out(trials), 20).hypotheses is None


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"weights": np.array([0.5, 0.6])}, "places that weigh"),
        ({"weights": np.array([1.5, -0.5])}, "places that weigh"),
        ({"points": np.zeros((3, 3))}, "places of shapes"),
        ({"covariances": np.zeros((2, 3, 3))}, "damaged"),
    ],
)
def test_damaged_places_are_refused(model: HGPDM, tmp_path: Path, changes: dict[str, np.ndarray], says: str) -> None:
    whole = GaussianMixture(np.full(2, 0.5), np.zeros((2, 3)), np.full((2, 3, 3), np.eye(3)))
    path = tmp_path / "damaged.safetensors"
    save_model(replace(model, places=replace(whole, **changes)), path)
    with pytest.raises(HighFiveError, match=says):
        load_model(path)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [1, 2, 5, 20])
def test_of_few_trials_there_are_few_places(trials: list[Trial], count: int) -> None:
    places = contact_places([trials[i % len(trials)] for i in range(count)])
    assert 1 <= len(places.weights) <= max(1, count // 3)
    assert places.weights.sum() == pytest.approx(1.0)
    assert np.isfinite(places.points).all() and np.linalg.eigvalsh(places.covariances).min() > 0.0


@pytest.mark.filterwarnings("error")
def test_the_same_contact_again_and_again_is_one_place(trials: list[Trial]) -> None:
    assert len(contact_places([trials[0]] * 12).weights) == 1


def test_a_model_of_somebody_elses_may_say_places_and_what_is_none_is_not_taken_for_one() -> None:
    still = SimpleReaction(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), 0.5)
    places = GaussianMixture(np.ones(1), np.zeros((1, 3)), np.eye(3)[None])
    assert hypotheses_of_contact(still) is None
    assert hypotheses_of_contact(replace(still, hypotheses=places)) is places
    flat = GaussianMixture(np.ones(1), np.zeros((1, 2)), np.eye(2)[None])
    assert hypotheses_of_contact(replace(still, hypotheses=flat)) is None

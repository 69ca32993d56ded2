"""What each departure from the paper is worth: one thing is taken back at a time."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from highfive.hil.bench.ablation import departures, through_interaction
from highfive.hil.evaluation.cross_validation import learned, refuse_none
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.evaluation.splits import Fold
from highfive.model.hgpdm.presets import DEFAULT, PAPER
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.responder import Responder


def test_each_row_takes_back_one_departure_and_together_they_are_the_paper():
    default, paper = asdict(DEFAULT), asdict(PAPER)
    changed = set()
    for row in departures()[1:-1]:
        differing = {name for name, value in asdict(row.preset).items() if value != default[name]}
        assert all(asdict(row.preset)[name] == paper[name] for name in differing)
        assert bool(differing) != (row.after is through_interaction)
        changed |= differing
    left = {name for name in default if default[name] != paper[name]} - changed
    # The name, how the return to the start pose is had, what the palm weighs, and how long it is trained.
    assert left == {"name", "return_tolerance", "palm_weight", "iterations"}


def test_through_interaction_alone_the_pose_differs_by_what_only_the_hand_says_of_it():
    model = load_model(DEFAULT_MODEL)
    cut = through_interaction(model)
    assert cut.back[-1].weights.shape[1] == model.preset.interaction_dims
    style = model.emotions[0]
    whole, less = Responder(model, style), Responder(cut, style)
    hand = np.array([[0.5, 0.0, 1.2], [0.5, 0.0, 1.3]])
    for tick in range(60):
        moved = hand + np.array([0.0, 0.0, 0.004 * tick])
        one, other = whole.step(moved), less.step(moved)
    np.testing.assert_allclose(one.latent, other.latent, atol=1e-9)  # the belief over I is the same
    assert 0.0 < np.abs(one.joints - other.joints).max() < 0.5


def test_held_out_trials_of_an_emotion_that_nobody_learned_are_named_and_left_out(caplog: pytest.LogCaptureFixture):
    caplog.set_level("INFO", "highfive")
    still, way = np.zeros((4, 3)), np.zeros((4, 9))

    def trial(emotion: str, test: bool) -> Trial:
        return Trial(60.0, np.zeros((4, 2, 3)), way, still, still, still, 2, emotion, "A1", 0, test)

    fold = Fold("", (trial("neutral", False), trial("neutral", True), trial("happy", True)))
    assert learned(fold, ["neutral"]) == [1]
    assert "happy: not learned" in caplog.text
    with pytest.raises(HighFiveError, match="no held-out trial is of an emotion that was learned"):
        refuse_none([fold.trials[index] for index in learned(fold, ["sad"])])

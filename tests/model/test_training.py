from dataclasses import replace

import numpy as np
import pytest

from model.errors import HighFiveError
from model.hgpdm import HGPDM
from model.presets import PAPER
from model.training import train
from model.trials import Trial


def test_latents_have_unit_variance_and_both_layers_reconstruct(model: HGPDM, trials: list[Trial]):
    np.testing.assert_allclose(model.interaction_latents.std(axis=0), 1.0, rtol=1e-4)
    assert model.settings["points"] == len(model.trial)
    assert set(np.unique(model.emotion)) == {0, 1}


def test_paper_preset_trains_and_generates(trials: list[Trial]):
    small = replace(PAPER, points=300, adam_steps=40, iterations=45)
    trained = train(trials, small, inducing=25)
    assert len(trained.back) == 2
    assert trained.interaction_latents.shape[1] == 3
    neutral = np.array([1.0, 0.0])
    generated = trained.generate(trained.interaction_latents.astype(float), neutral)[:, : trained.joints]
    recorded = np.concatenate([t.joints for t in trials if t.emotion == "neutral" and not t.test])
    # Hardly trained: it stays within the range in which the joints move.
    assert np.abs(generated.mean(axis=0) - recorded.mean(axis=0)).max() < np.ptp(recorded, axis=0).max() / 2
    assert generated.std() > 0.5 * recorded.std()


def test_too_few_inducing_inputs_are_named(trials: list[Trial]):
    with pytest.raises(HighFiveError, match="at least 2"):
        train(trials, inducing=1)

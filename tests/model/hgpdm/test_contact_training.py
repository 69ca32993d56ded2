"""How the contact layers learn, against what is known of pools and of how many frames there are."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import EMOTIONS, made_up_trial, with_arm

from highfive.model.hgpdm.contact_training import ARM_SHARES, CONTACT_TRAINING, best_share, fit_contact_layers
from highfive.model.hgpdm.trained import HGPDM


@pytest.mark.parametrize(("arm", "hand", "share"), [(1.0, 1.0, 0.5), (0.1, 1.0, 1.0), (1.0, 1.4, 2.0 / 3.0)])
def test_a_share_is_that_of_least_variance(arm: float, hand: float, share: float) -> None:
    """Errors apart from each other, of deviations a and h: h² / (a² + h²) of the first (Bates & Granger 1969)."""
    rng, count = np.random.default_rng(0), 20000
    left = np.column_stack([0.3 * rng.normal(size=(count, 3)), rng.uniform(0.0, 0.9, count)])
    unit = left.std(axis=0)
    found = best_share(arm * unit * rng.normal(size=(count, 4)), hand * unit * rng.normal(size=(count, 4)), left)
    exact = hand**2 / (arm**2 + hand**2)
    assert found == min(ARM_SHARES, key=lambda one: abs(one - exact)) == pytest.approx(share)


@pytest.mark.slow(20)
def test_many_frames_get_more_inducing_inputs(model: HGPDM) -> None:
    rng = np.random.default_rng(0)
    trials = [with_arm(made_up_trial(goal, e, 60.0, rng)) for goal in (0.3, 0.5, 0.7) for e in EMOTIONS]
    some = replace(CONTACT_TRAINING, iterations=1, frames=100, frames_each=5, most_inducing=30)  # of 216 frames
    sizes = []
    for settings in (some, replace(some, most_inducing=20), replace(some, frames_each=100)):
        hand, arm = fit_contact_layers(
            trials, model.feature_map, model.preset.history, 12, settings=settings, whole_arm=True
        )
        assert arm is not None and arm.share in ARM_SHARES
        sizes.append({len(hand.posterior.inducing), len(arm.layer.posterior.inducing)})
    assert sizes == [{30}, {20}, {12}]

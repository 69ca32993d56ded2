"""A model adapted to a few trials: what it must keep, what must get better, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_trial, with_arm

from highfive.model.errors import HighFiveError
from highfive.model.evaluation.predictions import online
from highfive.model.gp.sparse import means
from highfive.model.hgpdm.adaptation import adapt
from highfive.model.hgpdm.arm_features import arm_history
from highfive.model.hgpdm.contact_training import approaches, fit_contact_layers
from highfive.model.hgpdm.store import load_model, save_model
from highfive.model.hgpdm.tempo import tempo_history
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial

MOVED = 0.15  # m, how much higher another laboratory's avatar holds its palm


def elsewhere(trial: Trial) -> Trial:
    joints = 0.5 * trial.joints + 0.2
    return replace(trial, palm=trial.palm + np.array([0.0, 0.0, MOVED]), joints=joints)


@pytest.fixture(scope="module")
def new(model: HGPDM) -> tuple[list[Trial], list[Trial]]:
    rng = np.random.default_rng(3)
    made = [elsewhere(made_up_trial(goal, e, 60.0, rng)) for goal in (0.35, 0.5, 0.65) for e in model.emotions]
    held = [elsewhere(made_up_trial(goal, e, 60.0, rng, test=True)) for goal in (0.45, 0.6) for e in model.emotions]
    return made, held


def said(model: HGPDM, trials: list[Trial], body) -> np.ndarray:
    return np.concatenate([online(model, body)(trial).outputs for trial in trials])


@pytest.mark.slow
def test_it_comes_nearer_to_another_laboratory_and_says_by_how_much(model: HGPDM, new, body) -> None:
    learn, held = new
    after, moved = adapt(model, learn)
    where = model.channels
    frames = [online(model, body)(trial).frames for trial in held]
    palm = np.concatenate([t.palm[f] for t, f in zip(held, frames, strict=True)])
    joints = np.concatenate([t.joints[f] for t, f in zip(held, frames, strict=True)])
    first, then = said(model, held, body), said(after, held, body)
    for part, truth in ((where.palm, palm), (slice(0, model.joints), joints)):
        assert np.abs(then[:, part] - truth).mean() < 0.5 * np.abs(first[:, part] - truth).mean()
    assert moved.trials == len(learn) and set(moved.palm) == set(model.emotions)
    assert all(0.5 * MOVED < value < 2.0 * MOVED for value in moved.palm.values())
    assert all(after_ < before for before, after_ in (moved.left_out["pose"], moved.left_out["palm"]))


@pytest.mark.slow
def test_styles_that_the_new_trials_do_not_show_stay_and_the_file_holds_it(model: HGPDM, new, tmp_path) -> None:
    only = [trial for trial in new[0] if trial.emotion == model.emotions[0]]
    after, moved = adapt(model, only)
    assert after.emotions == model.emotions and moved.emotions == (model.emotions[0],)
    save_model(after, tmp_path / "adapted.safetensors")
    read = load_model(tmp_path / "adapted.safetensors", model.skeleton_hash)
    latents = np.asarray(model.interaction_latents[:5], dtype=float)
    for name in model.emotions:
        style = np.eye(len(model.emotions))[model.emotions.index(name)]
        np.testing.assert_allclose(read.generate(latents, style), after.generate(latents, style), atol=1e-9)
    assert read.settings["adapted_from"] == model.data_hash


@pytest.mark.slow
def test_its_own_trials_hardly_move_it(model: HGPDM, trials, body) -> None:
    after, moved = adapt(model, trials)
    held = [trial for trial in trials if trial.test]
    joints = slice(0, model.joints)
    assert np.abs(said(after, held, body) - said(model, held, body))[:, joints].mean() < 0.05
    assert moved.body < 0.02


@pytest.mark.slow
def test_what_is_answered_as_well_as_it_was_stays_also_of_styles_that_were_not_shown(
    model: HGPDM, trials, body
) -> None:
    """A few trials of one style would else move the body that all styles share."""
    only = [trial for trial in trials if trial.emotion == model.emotions[0]]
    after, moved = adapt(model, only)
    held = [trial for trial in trials if trial.test]
    assert "pose" in moved.kept and after.avatar is model.avatar and after.ensemble is model.ensemble
    np.testing.assert_array_equal(
        said(after, held, body)[:, : model.joints], said(model, held, body)[:, : model.joints]
    )
    assert moved.left_out["pose"][0] == moved.left_out["pose"][1]


def test_one_trial_is_enough_to_adapt_and_leaves_how_sure_the_model_is(model: HGPDM, new) -> None:
    slow = replace(new[0][0], rate_hz=20.0)  # long enough
    after, moved = adapt(model, [slow])
    assert moved.left_out == {} and np.all(np.isfinite(np.asarray(after.avatar.weights)))
    np.testing.assert_array_equal(after.avatar.noise, model.avatar.noise)


def test_what_does_not_fit_is_refused(model: HGPDM, new) -> None:
    trial = new[0][0]
    with pytest.raises(HighFiveError, match="emotion bored"):
        adapt(model, [replace(trial, emotion="bored")])
    with pytest.raises(HighFiveError, match="no training trials"):
        adapt(model, [replace(trial, test=True)])
    with pytest.raises(HighFiveError, match="joint channels"):
        adapt(model, [replace(trial, joints=trial.joints[:, :3])])
    with pytest.raises(HighFiveError, match="no back projections"):
        adapt(replace(model, preset=replace(model.preset, back_constrained=False)), new[0])


@pytest.mark.slow
def test_the_layer_of_the_whole_arm_is_adapted_where_most_trials_have_one(model: HGPDM, new) -> None:
    rng = np.random.default_rng(1)
    known = [with_arm(made_up_trial(goal, e, 60.0, rng)) for goal in (0.3, 0.5, 0.7) for e in model.emotions]
    contact, arm = fit_contact_layers(known, model.feature_map, model.preset.history, 40, whole_arm=True)
    armed = replace(model, contact=contact, arm_contact=arm)
    learn, held = ([with_arm(trial) for trial in trials] for trials in new)
    after, _ = adapt(armed, learn)
    assert after.arm_contact is not None and arm is not None
    errors = []
    for layer in (arm, after.arm_contact):
        seen = [approaches(held, look)[0] for look in (arm_history, tempo_history)]
        left = approaches(held, tempo_history)[1]
        errors.append(np.abs(means(layer.layer.posterior, layer.features(*seen)) - left)[:, 2].mean())
    assert errors[1] < 0.5 * errors[0]  # palms meet higher there
    assert after.arm_contact.layer.calibration.shape == arm.layer.calibration.shape
    one_without, _ = adapt(armed, [*learn[:-1], replace(learn[-1], arm_points=None)])
    assert one_without.arm_contact is not None
    assert adapt(armed, new[0])[0].arm_contact is None

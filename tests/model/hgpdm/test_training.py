from dataclasses import replace

import jax
import numpy as np
import pytest
from made_up import SMALL

from highfive.model.errors import HighFiveError
from highfive.model.gp import sparse
from highfive.model.hgpdm.dataset import hand_history, output_channels, training_set
from highfive.model.hgpdm.hierarchy import objective, problem
from highfive.model.hgpdm.initial import initial_parameters
from highfive.model.hgpdm.presets import DEFAULT, PAPER
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.training import train
from highfive.model.hgpdm.trials import Trial


def test_latents_have_unit_variance_and_both_layers_reconstruct(model: HGPDM, trials: list[Trial]):
    np.testing.assert_allclose(model.interaction_latents.std(axis=0), 1.0, rtol=1e-4)
    assert model.settings["points"] == len(model.trial)
    assert set(np.unique(model.emotion)) == {0, 1}


def test_each_channel_has_the_noise_that_the_avatar_layer_leaves_of_it(model: HGPDM, trials: list[Trial]):
    data = training_set([trial for trial in trials if not trial.test], SMALL)
    latents = model.interaction_latents.astype(float)
    left = []
    for x in (model.avatar_latents.astype(float), sparse.means(model.interaction, latents)[:, : SMALL.avatar_dims]):
        left.append(np.mean((sparse.means(model.avatar, x, data.styles) - data.outputs) ** 2, axis=0))
    expected = np.mean(left, axis=0) / np.asarray(model.avatar.scale) ** 2
    np.testing.assert_allclose(model.avatar.noise, np.maximum(expected, SMALL.avatar_noise[0] ** 2), rtol=1e-3)
    assert np.ptp(np.asarray(model.avatar.noise)) > 0.0


@pytest.mark.slow
@pytest.mark.usefixtures("hurried")
def test_paper_preset_trains_and_generates(trials: list[Trial]):
    small = replace(PAPER, points=300, adam_steps=30, iterations=35)
    trained = train(trials, small, inducing=20)
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


def still(trial: Trial, joint: int) -> Trial:
    joints = trial.joints.copy()
    joints[:, joint] = 0.3
    return replace(trial, joints=joints)


def stuck(trial: Trial, point: int, axes: slice) -> Trial:
    """One point of the hand, or one axis of it, that the tracker lost for good."""
    points = trial.hand_points.copy()
    points[:, point, axes] = 0.5
    return replace(trial, hand_points=points)


def cut(trial: Trial, frames: slice) -> Trial:
    names = ("hand_points", "joints", "root", "palm", "person_palm")
    return replace(trial, contact_frame=5, **{name: getattr(trial, name)[frames] for name in names})


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda some: [still(t, 3) for t in some], id="a joint never moves"),
        pytest.param(
            lambda some: [stuck(t, 1, slice(None)) for t in some], id="the knuckles are stuck", marks=pytest.mark.slow
        ),
        pytest.param(
            lambda some: [stuck(stuck(t, 0, slice(2)), 1, slice(2)) for t in some],
            id="it moves on a line",
            marks=pytest.mark.slow,
        ),
        pytest.param(lambda some: some[:1] * len(some), id="ten times the same trial", marks=pytest.mark.slow),
        pytest.param(lambda some: some[:1], id="a single trial", marks=pytest.mark.slow),
        pytest.param(
            lambda some: [cut(t, slice(40, 50)) for t in some * 8], id="a tenth of a second", marks=pytest.mark.slow
        ),
    ],
)
@pytest.mark.slow
def test_poor_data_have_a_finite_objective_and_gradient_to_start_from(trials: list[Trial], change):
    preset = replace(DEFAULT, points=70)
    data = training_set(change([t for t in trials if not t.test]), preset)
    task = problem(data, preset)
    start = initial_parameters(task, 100, np.random.default_rng(0))  # more inducing inputs than points
    value, gradient = jax.jit(jax.value_and_grad(lambda p: objective(p, task)))(start)
    assert np.isfinite(value)
    assert all(np.all(np.isfinite(part)) for part in jax.tree.leaves(gradient))


@pytest.mark.slow
@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("count", [1, 12])
def test_a_single_trial_even_repeated_gives_a_model(trials: list[Trial], count: int):
    trained = train(trials[:1] * count, SMALL, inducing=100)
    assert trained.emotions == (trials[0].emotion,)
    assert trained.settings["inducing"] == min(100, len(trained.trial))
    at = np.arange(0.5, 2.0, 0.2)
    expected = output_channels(trials[0], at)[:, : trained.joints]
    history = hand_history(trials[0], at, SMALL.history)
    got = trained.generate(trained.back_project(history)[:, : SMALL.interaction_dims], np.ones(1))[:, : trained.joints]
    assert np.abs(got - expected).mean() < 0.3 * expected.std()

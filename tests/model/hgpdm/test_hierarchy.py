from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from highfive.model.hgpdm.dataset import training_set
from highfive.model.hgpdm.hierarchy import latents, objective, problem
from highfive.model.hgpdm.initial import initial_parameters, principal_components
from highfive.model.hgpdm.presets import DEFAULT, PAPER
from highfive.model.hgpdm.trials import Trial


@pytest.mark.slow
@pytest.mark.parametrize(
    "preset", [DEFAULT, pytest.param(PAPER, marks=pytest.mark.slow)], ids=lambda preset: preset.name
)
def test_gradient_of_the_joint_objective_equals_finite_differences(trials: list[Trial], preset):
    task = problem(training_set(trials, replace(preset, points=150)), preset)
    start = initial_parameters(task, 15, np.random.default_rng(0))
    flat, unravel = ravel_pytree(start)
    both = jax.jit(jax.value_and_grad(lambda vector: objective(unravel(vector), task)))
    for seed in range(3):
        direction = np.random.default_rng(seed).normal(size=flat.shape)
        direction = jnp.asarray(direction / np.linalg.norm(direction))
        # A wide, fourth-order stencil: rounding is magnified by nearly singular inducing covariances.
        ahead = [both(flat + n * 3e-4 * direction)[0] for n in (-2, -1, 1, 2)]
        slope = (ahead[0] - 8.0 * ahead[1] + 8.0 * ahead[2] - ahead[3]) / (12.0 * 3e-4)
        np.testing.assert_allclose(both(flat)[1] @ direction, slope, rtol=1e-3)


@pytest.mark.slow
def test_scale_of_free_latents_is_a_gauge(trials: list[Trial]):
    task = problem(training_set(trials, replace(PAPER, points=150)), PAPER)
    start = initial_parameters(task, 15, np.random.default_rng(0))
    larger = start._replace(avatar_latent=7.0 * start.avatar_latent + 3.0)
    value = jax.jit(lambda parameters: objective(parameters, task))
    np.testing.assert_allclose(value(larger), value(start), rtol=1e-9)


def test_back_constrained_latents_have_unit_variance_and_step_from_point_to_point(trials: list[Trial]):
    task = problem(training_set(trials, replace(DEFAULT, points=150)), DEFAULT)
    found = latents(initial_parameters(task, 15, np.random.default_rng(0)), task)
    for latent in (found.avatar, found.human, found.interaction):
        np.testing.assert_allclose(np.std(latent, axis=0), 1.0, rtol=1e-6)
    for back in range(3):
        np.testing.assert_array_equal(found.steps[back][task.successors], found.interaction[task.successors - back])
    assert np.all(task.data.trial[task.successors] == task.data.trial[task.successors - 2])


def test_principal_components_never_start_constant():
    line = np.outer(np.linspace(-1.0, 1.0, 50), np.ones(4))
    scores = principal_components(line, 3)
    np.testing.assert_allclose(scores.std(axis=0), 1.0)

"""A trained layer as a prior: laws of the update, against a fit to all points at once."""

import jax.numpy as jnp
import numpy as np
import pytest

from highfive.model.gp import sparse
from highfive.model.gp.coregionalisation import initial_style
from highfive.model.gp.kernels import MotionKernel
from highfive.model.gp.posterior import Posterior
from highfive.model.gp.sparse import Layer
from highfive.model.gp.streaming import evidence, function_variance, means, updated

NOISE = 0.01


def layer(inducing: np.ndarray, styles: np.ndarray | None) -> Layer:
    style = None if styles is None else initial_style(2, jnp.asarray(styles))
    return Layer(MotionKernel.initial(2), jnp.asarray(inducing), jnp.asarray(0.0), style)


def points(rng: np.random.Generator, count: int, styled: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    inputs = rng.normal(size=(count, 2))
    values = np.stack([np.sin(inputs.sum(axis=1)), np.cos(inputs[:, 0]), inputs[:, 1]], axis=1)
    return inputs, values, np.eye(2)[rng.integers(2, size=count)] if styled else None


def fitted(inducing, inducing_styles, inputs, values, styles, weights=None) -> Posterior:
    given = None if weights is None else jnp.asarray(weights)
    styles = None if styles is None else jnp.asarray(styles)
    scale, offset = jnp.array([1.0, 2.0, 0.5]), jnp.array([0.3, 0.0, -0.2])
    own = (jnp.asarray(values) - offset) / scale
    chosen = layer(inducing, inducing_styles)
    return sparse.fit(chosen, jnp.asarray(inputs), own, jnp.asarray(NOISE), styles, offset, scale, given)


@pytest.mark.slow
@pytest.mark.parametrize("styled", [False, True])
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_update_is_the_fit_to_old_and_new_points_with_the_old_ones_weighted_by_the_share(styled, share) -> None:
    rng = np.random.default_rng(0)
    inducing = rng.normal(size=(12, 2))
    inducing_styles = np.eye(2)[rng.integers(2, size=12)] if styled else None
    old, new = points(rng, 60, styled), points(rng, 20, styled)
    before = fitted(inducing, inducing_styles, *old)
    counts = rng.uniform(0.1, 1.0, 20)
    found = updated(before, evidence(before), new[0], new[1], counts, new[2], share)
    both = [None if a is None else np.concatenate([a, b]) for a, b in zip(old, new, strict=True)]
    expected = fitted(inducing, inducing_styles, *both, weights=np.concatenate([np.full(60, share), counts]))
    at, _, styles = points(rng, 30, styled)
    np.testing.assert_allclose(means(found, at, styles), sparse.means(expected, at, styles), atol=1e-5)
    np.testing.assert_allclose(function_variance(found, at, styles), function_variance(expected, at, styles), atol=1e-6)


@pytest.mark.slow
def test_further_inducing_inputs_alone_change_nothing() -> None:
    rng = np.random.default_rng(1)
    inputs, values, styles = points(rng, 50, True)
    before = fitted(inputs[:15], styles[:15], inputs, values, styles)
    new = points(rng, 10, True)
    after = updated(before, evidence(before), new[0], new[1], np.zeros(10), new[2], 1.0, np.arange(10))
    assert len(after.inducing) == 25
    np.testing.assert_allclose(means(after, inputs, styles), means(before, inputs, styles), atol=1e-4)
    variances = (function_variance(layer, inputs, styles) for layer in (after, before))
    np.testing.assert_allclose(*variances, atol=1e-4)


@pytest.mark.slow
def test_what_is_forgotten_and_not_seen_again_is_the_prior() -> None:
    rng = np.random.default_rng(2)
    inputs, values, _ = points(rng, 40, False)
    before = fitted(inputs[:10], None, inputs, values, None)
    nothing = updated(before, evidence(before), inputs, values, np.zeros(40), None, 0.0)
    np.testing.assert_allclose(means(nothing, inputs), np.tile(before.offset, (40, 1)), atol=1e-8)

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from model import kernels, sparse
from model.kernels import MotionKernel, initial_style
from model.predictor import Predictor
from model.sparse import Layer, Posterior

STYLES = {"plain": None, "styled": np.array([0.25, 0.75])}


def posterior_of(styled: bool) -> Posterior:
    """A layer of 3 inputs and 5 channels with an offset and unequal scales."""
    rng = np.random.default_rng(3)
    inputs, styles = jnp.asarray(rng.normal(size=(40, 3))), jnp.asarray(np.eye(2)[rng.integers(0, 2, 40)])
    values = jnp.sin(inputs @ rng.normal(size=(3, 5)))
    lengthscale, linear = np.log([1.0, 1.5, 2.0]), np.log([0.2, 0.1, 0.4])
    kernel = MotionKernel(
        jnp.asarray(lengthscale), jnp.asarray(np.log(1.7)), jnp.asarray(linear), jnp.asarray(np.log(0.3))
    )
    style = initial_style(2, styles[:12]) if styled else None
    layer = Layer(kernel, inputs[:12], jnp.zeros(()), style)
    offset, scale = jnp.asarray(rng.normal(size=5)), jnp.asarray(rng.uniform(0.5, 2.0, 5))
    return sparse.fit(layer, inputs, values, jnp.asarray(0.05), styles if styled else None, offset, scale)


def mean(posterior: Posterior, point: jax.Array, style: np.ndarray | None) -> jax.Array:
    return sparse.means(posterior, point[None], None if style is None else jnp.asarray(style)[None])[0]


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_mean_and_slope_are_those_of_the_batch_prediction(style: np.ndarray | None):
    posterior = posterior_of(style is not None)
    for point in np.random.default_rng(5).normal(size=(4, 3)):
        got = Predictor(posterior)(point, style)
        np.testing.assert_allclose(got.mean, mean(posterior, jnp.asarray(point), style), atol=1e-11)
        slope = jax.jacrev(lambda p: mean(posterior, p, style))(jnp.asarray(point))
        np.testing.assert_allclose(got.slope(), slope, atol=1e-10)
        np.testing.assert_allclose(got.slope(slice(2, 4)), slope[2:4], atol=1e-10)


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_variance_is_what_the_reduction_leaves(style: np.ndarray | None):
    posterior = posterior_of(style is not None)
    for point in np.random.default_rng(6).normal(size=(4, 3)):
        cross = kernels.cross(posterior.kernel, point[None], posterior.inducing)[0]
        own = kernels.diagonal(posterior.kernel, point[None])[0]
        if style is not None:
            cross, own = cross * (posterior.style @ style), own * (style @ posterior.style_covariance @ style)
        variance = own - cross @ posterior.reduction @ cross
        np.testing.assert_allclose(Predictor(posterior)(point, style).variance(), variance, atol=1e-10)


def test_doubt_passes_through_the_slope_and_noise_is_added():
    posterior = posterior_of(styled=False)
    point, factor = np.array([0.3, -0.2, 0.5]), np.random.default_rng(7).normal(size=(3, 3))
    prediction, spread = Predictor(posterior)(point), factor @ factor.T
    doubt = (prediction.variance() + 0.05) * np.asarray(posterior.scale) ** 2
    carried = prediction.slope() @ spread @ prediction.slope().T
    np.testing.assert_allclose(prediction.covariance(spread, 3.0), carried + 3.0 * np.diag(doubt), atol=1e-12)
    np.testing.assert_allclose(prediction.variances(spread), np.diag(carried) + doubt, atol=1e-12)
    np.testing.assert_allclose(prediction.variances(spread, slice(1, 3)), (np.diag(carried) + doubt)[1:3], atol=1e-12)

import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from highfive.model.gp import kernels
from highfive.model.gp.kernels import StyleFactor, motion_kernel

seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_motion_times_style_is_positive_semi_definite_for_any_weights(seed: int):
    rng = np.random.default_rng(seed)
    inputs, weights = rng.normal(size=(30, 4)), 3.0 * rng.normal(size=(30, 3))
    between = kernels.style_covariance(StyleFactor(jnp.asarray(rng.normal(size=(3, 3))), jnp.zeros((1, 3))))
    kernel = motion_kernel(np.exp(rng.normal(size=4)), linear=0.3, bias=0.2)
    gram = np.asarray(kernels.cross(kernel, inputs, inputs) * (weights @ between @ weights.T))
    assert np.linalg.eigvalsh(gram).min() > -1e-9 * np.trace(gram)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_kernel_equals_its_formula_and_its_diagonal(seed: int):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(5, 3)), rng.normal(size=(7, 3))
    lengthscale = np.exp(rng.normal(size=3))
    kernel = motion_kernel(lengthscale, rbf=1.7, linear=0.4, bias=0.2)
    expected = np.empty((5, 7))
    for i, x in enumerate(a):
        for j, z in enumerate(b):
            expected[i, j] = 1.7 * np.exp(-0.5 * np.sum(((x - z) / lengthscale) ** 2)) + 0.4 * (x @ z) + 0.2
    np.testing.assert_allclose(kernels.cross(kernel, a, b), expected, rtol=1e-10)
    np.testing.assert_allclose(kernels.diagonal(kernel, a), np.diag(kernels.cross(kernel, a, a)), rtol=1e-10)


def test_style_covariance_has_unit_mean_diagonal():
    factor = np.random.default_rng(0).normal(size=(4, 4))
    between = kernels.style_covariance(StyleFactor(jnp.asarray(factor), jnp.zeros((1, 4))))
    assert np.isclose(np.trace(between), 4.0)

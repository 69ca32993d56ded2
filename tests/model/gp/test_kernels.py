"""The laws of every kernel: each that is registered is held to them, and their sums and products."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from highfive.model.errors import HighFiveError
from highfive.model.gp.coregionalisation import StyleFactor, style_covariance
from highfive.model.gp.kernels import KERNELS, RBF, Constant, Kernel, Linear, MotionKernel, motion_kernel
from highfive.model.gp.kernels.kernel import register_kernel
from highfive.model.hgpdm.stored_kernel import kernel_arrays, kernel_of

DIMS = 3
MADE = {
    **{name: cls.initial for name, cls in KERNELS.items()},
    "Sum": lambda dims: RBF.initial(dims) + Linear.initial(dims),
    "Product": lambda dims: MotionKernel.initial(dims) * Linear.initial(dims),
    "Sum of products": lambda dims: (
        Constant.initial(dims) * RBF.initial(dims) + Linear.initial(dims) * RBF.initial(dims)
    ),
}


@pytest.fixture(params=MADE)
def kernel(request: pytest.FixtureRequest) -> Kernel:
    """Some kernel of the name with random parameters: any real vector is valid."""
    flat, unravel = ravel_pytree(MADE[request.param](DIMS))
    return unravel(flat + 0.5 * np.random.default_rng(len(request.param)).normal(size=flat.shape))


@pytest.fixture
def a() -> jax.Array:
    return jnp.asarray(np.random.default_rng(1).normal(size=(30, DIMS)))


@pytest.fixture
def b() -> jax.Array:
    return jnp.asarray(np.random.default_rng(2).normal(size=(7, DIMS)))


@pytest.mark.slow
def test_symmetric(kernel: Kernel, a: jax.Array, b: jax.Array):
    np.testing.assert_allclose(kernel.cross(a, b), kernel.cross(b, a).T, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(kernel.pair(a[0], b[0]), kernel.pair(b[0], a[0]), rtol=1e-12)


def test_positive_semi_definite_for_any_parameters(kernel: Kernel, a: jax.Array):
    flat, unravel = ravel_pytree(kernel)
    for seed in range(10):
        moved = unravel(flat + np.random.default_rng(seed).normal(size=flat.shape))
        gram = np.asarray(moved.cross(a, a))
        assert np.linalg.eigvalsh(gram).min() > -1e-9 * np.trace(gram)


def test_batch_is_the_form_for_one_pair(kernel: Kernel, a: jax.Array, b: jax.Array):
    pairs = [[kernel.pair(x, z) for z in b] for x in a[:5]]
    np.testing.assert_allclose(kernel.cross(a[:5], b), pairs, rtol=1e-9)
    np.testing.assert_allclose(kernel.diagonal(a), np.diag(kernel.cross(a, a)), rtol=1e-9)
    assert kernel.diagonal(a).shape == (30,)


@pytest.mark.slow
def test_derivative_is_that_of_finite_differences(kernel: Kernel, a: jax.Array, b: jax.Array):
    """By parameters and both inputs, of the fast form; and where inputs are the same."""
    weights = np.random.default_rng(3).normal(size=(30, 7 + 30))
    flat, unravel = ravel_pytree((kernel, a, b))

    @jax.jit
    def value(vector: jax.Array) -> jax.Array:
        some, left, right = unravel(vector)
        return jnp.sum(weights * jnp.concatenate([some.cross(left, right), some.cross(left, left)], axis=1))

    gradient = jax.grad(value)(flat)
    assert np.all(np.isfinite(gradient))
    for seed in range(3):
        direction = np.random.default_rng(seed).normal(size=flat.shape)
        slope = (value(flat + 1e-5 * direction) - value(flat - 1e-5 * direction)) / 2e-5
        np.testing.assert_allclose(gradient @ direction, slope, rtol=1e-5, atol=1e-6)


def test_kernels_are_values_that_files_keep(kernel: Kernel, a: jax.Array, b: jax.Array):
    arrays = kernel_arrays("layer.kernel", kernel)
    np.testing.assert_array_equal(kernel_of("layer.kernel", arrays).cross(a, b), kernel.cross(a, b))
    with pytest.raises(AttributeError):
        kernel.log_variance = jnp.zeros(())  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("missing", ["layer.kernel.log_bias", "layer.kernel.log_lengthscale"])
def test_kernel_with_a_parameter_missing_is_refused(missing: str):
    arrays = kernel_arrays("layer.kernel", MotionKernel.initial(DIMS))
    del arrays[missing]
    with pytest.raises(KeyError, match=missing):
        kernel_of("layer.kernel", arrays)
    with pytest.raises(KeyError, match="Unheard"):
        kernel_of("layer.kernel", {"layer.kernel.Unheard.log_variance": np.zeros(())})


def test_sum_and_product_are_what_they_say(a: jax.Array, b: jax.Array):
    left, right = RBF.initial(DIMS), motion_kernel(np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose((left + right).cross(a, b), left.cross(a, b) + right.cross(a, b), rtol=1e-12)
    np.testing.assert_allclose((left * right).cross(a, b), left.cross(a, b) * right.cross(a, b), rtol=1e-12)
    with pytest.raises(TypeError):
        left + 1.0  # pyright: ignore[reportOperatorIssue, reportUnusedExpression]


def test_motion_kernel_is_rbf_and_linear_and_constant(a: jax.Array, b: jax.Array):
    lengthscale = np.array([0.5, 1.0, 2.0])
    motion = motion_kernel(lengthscale, rbf=1.7, linear=0.4, bias=0.2)
    parts = RBF(motion.log_lengthscale, motion.log_rbf) + Linear(motion.log_linear) + Constant(motion.log_bias)
    np.testing.assert_allclose(motion.cross(a, b), parts.cross(a, b), rtol=1e-10)
    expected = np.empty((30, 7))
    for i, x in enumerate(np.asarray(a)):
        for j, z in enumerate(np.asarray(b)):
            expected[i, j] = 1.7 * np.exp(-0.5 * np.sum(((x - z) / lengthscale) ** 2)) + 0.4 * (x @ z) + 0.2
    np.testing.assert_allclose(motion.cross(a, b), expected, rtol=1e-10)


def test_two_kernels_of_one_name_are_both_named():
    class RBF(Kernel):
        log_variance: jax.Array

    with pytest.raises(
        HighFiveError, match=r"named RBF: one in highfive\.model\.gp\.kernels\.rbf, one in .*test_kernel"
    ):
        register_kernel(RBF)
    assert KERNELS["RBF"].__module__.endswith("rbf")


@pytest.mark.parametrize("seed", range(5))
def test_motion_times_style_is_positive_semi_definite_for_any_weights(seed: int):
    rng = np.random.default_rng(seed)
    inputs, weights = rng.normal(size=(30, 4)), 3.0 * rng.normal(size=(30, 3))
    between = style_covariance(StyleFactor(jnp.asarray(rng.normal(size=(3, 3))), jnp.zeros((1, 3))))
    kernel = motion_kernel(np.exp(rng.normal(size=4)), linear=0.3, bias=0.2)
    gram = np.asarray(kernel.cross(jnp.asarray(inputs), jnp.asarray(inputs)) * (weights @ between @ weights.T))
    assert np.linalg.eigvalsh(gram).min() > -1e-9 * np.trace(gram)


def test_style_covariance_has_unit_mean_diagonal():
    factor = np.random.default_rng(0).normal(size=(4, 4))
    between = style_covariance(StyleFactor(jnp.asarray(factor), jnp.zeros((1, 4))))
    assert np.isclose(np.trace(between), 4.0)

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from highfive.model.errors import HighFiveError
from highfive.model.gp import exact, sparse
from highfive.model.gp.coregionalisation import initial_style, style_covariance
from highfive.model.gp.kernels import RBF, Constant, Linear, motion_kernel
from highfive.model.gp.sparse import Layer, Targets
from highfive.model.hgpdm.store import load_layer, save_layer
from highfive.model.online.belief import packed
from highfive.model.online.layer import predict_layer

NOISE = 0.05


@pytest.fixture
def setting():
    rng = np.random.default_rng(3)
    inputs = rng.normal(size=(40, 3))
    styles = np.eye(2)[rng.integers(0, 2, 40)]
    values = np.sin(inputs @ rng.normal(size=(3, 5))) + 0.1 * rng.normal(size=(40, 5))
    kernel = motion_kernel(np.array([1.0, 1.5, 2.0]), linear=0.2, bias=0.3)
    return inputs, styles, values, kernel


def layer(kernel, inputs, styles, chosen) -> Layer:
    return Layer(kernel, jnp.asarray(inputs[chosen]), jnp.zeros(()), initial_style(2, jnp.asarray(styles[chosen])))


def dense(kernel, style, a, a_styles, b, b_styles) -> np.ndarray:
    return np.asarray(kernel.cross(a, b) * (a_styles @ style_covariance(style) @ b_styles.T))


@pytest.mark.slow
def test_dtc_value_equals_the_naive_dense_one(setting):
    inputs, styles, values, kernel = setting
    some = layer(kernel, inputs, styles, slice(0, 12))
    k_uu = np.asarray(sparse.inducing_covariance(some))
    k_uf, k_ff = (np.asarray(k) for k in sparse.cross_covariance(some, jnp.asarray(inputs), jnp.asarray(styles)))
    low_rank = k_uf.T @ np.linalg.solve(k_uu, k_uf)
    targets = Targets(jnp.asarray(values), 5, 0.0)
    got = sparse.negative_log_likelihood(some, inputs, targets, jnp.asarray(NOISE), jnp.asarray(styles))
    expected = exact.negative_log_likelihood(low_rank + NOISE * np.eye(40), values)
    np.testing.assert_allclose(got, expected, rtol=1e-9)
    bound = sparse.negative_log_likelihood(some, inputs, targets, jnp.asarray(NOISE), jnp.asarray(styles), True)
    np.testing.assert_allclose(bound, expected + 0.5 * 5 / NOISE * np.sum(k_ff - np.diag(low_rank)), rtol=1e-9)
    full = dense(kernel, some.style, inputs, styles, inputs, styles)
    assert float(bound) >= exact.negative_log_likelihood(full + NOISE * np.eye(40), values)


@pytest.mark.slow
def test_all_points_inducing_is_the_exact_process(setting):
    inputs, styles, values, kernel = setting
    every = layer(kernel, inputs, styles, slice(None))
    full = dense(kernel, every.style, inputs, styles, inputs, styles)
    targets = Targets(jnp.asarray(values), 5, 0.0)
    got = sparse.negative_log_likelihood(every, inputs, targets, jnp.asarray(NOISE), jnp.asarray(styles), True)
    np.testing.assert_allclose(got, exact.negative_log_likelihood(full + NOISE * np.eye(40), values), rtol=1e-3)

    rng = np.random.default_rng(4)
    new, weights = rng.normal(size=(6, 3)), rng.dirichlet([1.0, 1.0], 6)
    posterior = sparse.fit(every, jnp.asarray(inputs), jnp.asarray(values), jnp.asarray(NOISE), jnp.asarray(styles))
    cross = dense(kernel, every.style, new, weights, inputs, styles)
    own = np.diag(dense(kernel, every.style, new, weights, new, weights))
    means, variances = exact.predict(full, cross, own, NOISE, values)
    np.testing.assert_allclose(sparse.means(posterior, jnp.asarray(new), jnp.asarray(weights)), means, atol=1e-4)
    ready = packed(posterior)
    doubts = [predict_layer(ready, *pair)[2] for pair in zip(new, weights, strict=True)]
    np.testing.assert_allclose(doubts, np.tile(variances[:, None] + NOISE, 5), atol=1e-4)


def test_points_of_their_own_noise_are_the_exact_process_with_that_noise(setting):
    inputs, styles, values, kernel = setting
    every = layer(kernel, inputs, styles, slice(None))
    full = dense(kernel, every.style, inputs, styles, inputs, styles)
    weights = np.random.default_rng(6).uniform(0.1, 9.0, 40)
    weights[::7] = 0.0
    known = weights > 0.0
    noise = np.diag(NOISE / weights[known])
    arguments = every, inputs, Targets(jnp.asarray(values), 5, 0.0), jnp.asarray(NOISE), jnp.asarray(styles), True
    got = sparse.negative_log_likelihood(*arguments, weights=jnp.asarray(weights))
    expected = exact.negative_log_likelihood(full[known][:, known] + noise, values[known])
    np.testing.assert_allclose(got, expected + 2.5 * np.log(weights[known]).sum(), rtol=1e-3)

    new, mixed = np.random.default_rng(7).normal(size=(6, 3)), np.tile([0.5, 0.5], (6, 1))
    posterior = sparse.fit(every, *map(jnp.asarray, (inputs, values, NOISE, styles)), weights=jnp.asarray(weights))
    cross = dense(kernel, every.style, new, mixed, inputs[known], styles[known])
    means = cross @ np.linalg.solve(full[known][:, known] + noise, values[known])
    np.testing.assert_allclose(sparse.means(posterior, jnp.asarray(new), jnp.asarray(mixed)), means, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("weights", [None, np.linspace(0.0, 3.0, 40)])
def test_gradient_equals_finite_differences(setting, weights):
    inputs, styles, values, kernel = setting
    some, targets = layer(kernel, inputs, styles, slice(0, 12)), Targets(jnp.asarray(values), 5, 0.3)
    flat, unravel = jax.flatten_util.ravel_pytree((some, jnp.asarray(inputs)))

    def value(vector):
        parameters, points = unravel(vector)
        noise = sparse.noise_variance(parameters.raw_noise, (0.05, 0.5))
        return sparse.negative_log_likelihood(parameters, points, targets, noise, jnp.asarray(styles), True, weights)

    value = jax.jit(value)
    gradient = jax.grad(value)(flat)
    for seed in range(4):
        direction = np.random.default_rng(seed).normal(size=flat.shape)
        slope = (value(flat + 1e-5 * direction) - value(flat - 1e-5 * direction)) / 2e-5
        np.testing.assert_allclose(gradient @ direction, slope, rtol=1e-5)


def test_thin_targets_give_the_value_of_the_full_ones(setting):
    inputs, styles, values, kernel = setting
    some, wide = layer(kernel, inputs, styles, slice(0, 12)), values @ np.random.default_rng(5).normal(size=(5, 30))
    left, singular, _ = np.linalg.svd(wide, full_matrices=False)
    thin = Targets(jnp.asarray((left * singular)[:, :5]), 30, 0.0)
    arguments = jnp.asarray(NOISE), jnp.asarray(styles)
    full = sparse.negative_log_likelihood(some, inputs, Targets(jnp.asarray(wide), 30, 0.0), *arguments)
    np.testing.assert_allclose(sparse.negative_log_likelihood(some, inputs, thin, *arguments), full, rtol=1e-10)


def test_a_mixture_of_styles_is_the_same_mixture_of_motions(setting):
    inputs, styles, values, kernel = setting
    some = layer(kernel, inputs, styles, slice(0, 12))
    posterior = sparse.fit(some, jnp.asarray(inputs), jnp.asarray(values), jnp.asarray(NOISE), jnp.asarray(styles))
    first, second, mixed = (
        np.asarray(sparse.means(posterior, jnp.asarray(inputs), jnp.tile(jnp.asarray(weights), (40, 1))))
        for weights in ([1.0, 0.0], [0.0, 1.0], [0.3, 0.7])
    )
    np.testing.assert_allclose(mixed, 0.3 * first + 0.7 * second, atol=1e-10)


def test_noise_stays_in_bounds_and_inverts():
    bounds = (0.03, 0.06)
    for raw in (-1e3, -1.0, 0.0, 1.0, 1e3):
        assert 0.03 - 1e-12 <= np.sqrt(sparse.noise_variance(jnp.asarray(raw), bounds)) <= 0.06 + 1e-12
    assert np.isclose(np.sqrt(sparse.noise_variance(sparse.raw_noise(0.04, bounds), bounds)), 0.04)


@pytest.mark.slow
def test_likelihood_posterior_and_its_file_take_any_kernel(setting, tmp_path):
    inputs, styles, values, _ = setting
    some = layer(RBF.initial(3) * Linear.initial(3) + Constant.initial(3), inputs, styles, slice(0, 12))
    k_uu = np.asarray(sparse.inducing_covariance(some))
    k_uf, _ = (np.asarray(k) for k in sparse.cross_covariance(some, jnp.asarray(inputs), jnp.asarray(styles)))
    low_rank = k_uf.T @ np.linalg.solve(k_uu, k_uf)
    targets = Targets(jnp.asarray(values), 5, 0.0)
    got = sparse.negative_log_likelihood(some, inputs, targets, jnp.asarray(NOISE), jnp.asarray(styles))
    np.testing.assert_allclose(got, exact.negative_log_likelihood(low_rank + NOISE * np.eye(40), values), rtol=1e-9)

    posterior = sparse.fit(some, jnp.asarray(inputs), jnp.asarray(values), jnp.asarray(NOISE), jnp.asarray(styles))
    save_layer(posterior, tmp_path / "layer.safetensors")
    again = load_layer(tmp_path / "layer.safetensors")
    at = jnp.asarray(inputs), jnp.asarray(styles)
    np.testing.assert_array_equal(sparse.means(again, *at), sparse.means(posterior, *at))
    with pytest.raises(HighFiveError, match="MotionKernel only, this layer has a Sum"):
        packed(posterior, 2)

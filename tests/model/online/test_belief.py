from dataclasses import replace

import jax.numpy as jnp
import naive_filter
import numpy as np
import pytest

from highfive.model.errors import HighFiveError
from highfive.model.gp.kernels import MotionKernel
from highfive.model.gp.sparse import Posterior
from highfive.model.hgpdm.dynamics import VELOCITY_UNIT, dynamics_mean
from highfive.model.hgpdm.features import FeatureMap
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online import belief, tick
from highfive.model.online.belief import Filter
from highfive.model.online.belief_settings import BELIEF

NOISE = 0.01


def linear_layer(matrix: np.ndarray) -> Posterior:
    """A layer whose mean is ``input @ matrix`` and whose only doubt is its noise: a linear kernel on unit vectors."""
    inputs, outputs = matrix.shape
    kernel = MotionKernel(jnp.zeros(inputs), jnp.asarray(-1e4), jnp.zeros(inputs), jnp.asarray(-1e4))
    identity = jnp.eye(inputs)
    zeros, ones = jnp.zeros(outputs), jnp.ones(outputs)
    return Posterior(kernel, identity, None, None, jnp.asarray(matrix), zeros, identity, jnp.asarray(NOISE), ones)


@pytest.fixture(scope="module")
def linear(model: HGPDM) -> HGPDM:
    dims = model.preset.interaction_dims
    matrix = 0.1 * np.random.default_rng(0).normal(size=(2 * dims, dims))
    return replace(model, dynamics=linear_layer(matrix))


def transition(model: HGPDM) -> np.ndarray:
    """Matrix (2 q, 2 q) of one lag of a linear model, from the definition of its dynamics."""
    dims = model.preset.interaction_dims
    rows = []
    for unit in np.eye(2 * dims):
        now, before = unit[:dims], unit[dims:]
        inputs = np.concatenate([now, (now - before) * VELOCITY_UNIT / model.lag])
        ahead = np.asarray(dynamics_mean(now, before, model.lag, model.preset)) + inputs @ model.dynamics.weights
        rows.append(np.concatenate([ahead, now]))
    return np.array(rows).T


def test_filter_equals_conditioning_the_joint_gaussian(linear: HGPDM):
    """x_n = A x_{n-1} + w, y_n = x_n[:q] + v, against one big Gaussian over all x and y."""
    dims, steps = linear.preset.interaction_dims, 4
    rng = np.random.default_rng(1)
    mean, covariance = rng.normal(size=2 * dims), np.eye(2 * dims) + 0.3
    noises = [0.05 * np.eye(dims) * (n + 1) for n in range(steps)]
    values = rng.normal(size=(steps, dims))

    filtered, spread, moving = mean, covariance, Filter(linear, 60.0)
    for value, noise in zip(values, noises, strict=True):
        filtered, spread = moving.predict(filtered, spread, linear.lag)
        filtered, spread = tick.update(filtered, spread, value, noise)

    matrix = transition(linear)
    process = np.diag(np.concatenate([np.full(dims, NOISE), np.zeros(dims)]))
    means, blocks = [], {}
    current, own = mean, covariance
    for n in range(steps):
        current, own = matrix @ current, matrix @ own @ matrix.T + process
        means.append(current)
        for later in range(n, steps):
            blocks[later, n] = np.linalg.matrix_power(matrix, later - n) @ own
            blocks[n, later] = blocks[later, n].T
    size = 2 * dims
    joint = np.block([[blocks[i, j] for j in range(steps)] for i in range(steps)])
    seen = np.concatenate([np.arange(n * size, n * size + dims) for n in range(steps)])
    last = np.arange((steps - 1) * size, steps * size)
    observed = joint[np.ix_(seen, seen)] + np.kron(np.diag(np.arange(1, steps + 1)), 0.05 * np.eye(dims))
    gain = joint[np.ix_(last, seen)] @ np.linalg.inv(observed)
    residual = values.reshape(-1) - np.concatenate([m[:dims] for m in means])
    np.testing.assert_allclose(filtered, means[-1] + gain @ residual, atol=1e-9)
    np.testing.assert_allclose(spread, joint[np.ix_(last, last)] - gain @ joint[np.ix_(seen, last)], atol=1e-9)


@pytest.fixture(scope="module")
def linear_throughout(linear: HGPDM) -> HGPDM:
    """Every layer is linear, the hand at this moment is all that the back projection sees."""
    rng, preset = np.random.default_rng(3), linear.preset
    dims, below = preset.interaction_dims, preset.avatar_dims + preset.human_dims
    return replace(
        linear,
        preset=replace(preset, history=()),
        ensemble=None,
        feature_map=FeatureMap(np.eye(6), np.zeros(6)),
        back=(linear_layer(0.5 * rng.normal(size=(6, dims))),),
        interaction=linear_layer(rng.normal(size=(dims, below))),
        human=linear_layer(rng.normal(size=(preset.human_dims, 6))),
        avatar=linear_layer(rng.normal(size=(preset.avatar_dims, linear.channels.size))),
    )


def test_ticks_of_a_linear_model_are_the_posterior_of_its_joint_gaussian(linear_throughout: HGPDM):
    """Every variable is a linear map of independent unit normals; the pose is conditioned on all hands at once."""
    model, rate, variance, count = linear_throughout, 60.0, np.linspace(0.001, 0.01, 6), 5
    dims, split = model.preset.interaction_dims, model.preset.avatar_dims
    hands, style = np.random.default_rng(4).normal(size=(count, 6)), np.array([0.4, 0.6])
    moving = Filter(model, rate)
    state = moving.initial(style)
    for hand in hands:
        state, answer = moving.step(state, hand, variance, style)

    back, below = np.asarray(model.back[0].weights).T, np.asarray(model.interaction.weights).T
    values = hands @ back.T
    doubt = back @ np.diag(variance) @ back.T + max(1.0, model.lag * rate) * NOISE * np.eye(dims)
    units, root = np.eye(2 * dims), np.linalg.cholesky(doubt)
    step = np.stack([naive_filter.moved(model, unit, units, 1.0 / rate)[0] for unit in units], axis=1)
    # Columns of loadings: the beginning (2 q), then in each tick the dynamics' noise (q) and the measurement's (q).
    mean, loading = np.tile(values[0], 2), np.zeros((2 * dims, 2 * dims * count))
    loading[:, : 2 * dims] = np.kron(np.eye(2), root)
    seen_means, seen_loadings = [], []
    for n in range(1, count):
        mean, loading, begin = step @ mean, step @ loading, 2 * dims * n
        loading[:dims, begin : begin + dims] = np.sqrt(NOISE / rate / model.lag) * np.eye(dims)
        seen = loading[:dims].copy()
        seen[:, begin + dims : begin + 2 * dims] = root
        seen_means.append(mean[:dims])
        seen_loadings.append(seen)
    seen, surprise = np.concatenate(seen_loadings), np.concatenate(values[1:] - np.array(seen_means))
    gain = loading @ seen.T @ np.linalg.inv(seen @ seen.T)
    mean, covariance = mean + gain @ surprise, loading @ loading.T - gain @ seen @ loading.T
    np.testing.assert_allclose(state.latent, mean, atol=1e-9)
    np.testing.assert_allclose(state.covariance, covariance, atol=1e-9)
    for layer, part, got, deviations in (
        (model.avatar, slice(0, split), answer.avatar, answer.avatar_deviations),
        (model.human, slice(split, None), answer.human, answer.human_deviations),
    ):
        weights = np.asarray(layer.weights).T
        down = weights @ below[part]
        spread = down @ covariance[:dims, :dims] @ down.T + NOISE * weights @ weights.T + NOISE * np.eye(len(down))
        np.testing.assert_allclose(got, down @ mean[:dims], atol=1e-9)
        np.testing.assert_allclose(deviations, np.sqrt(np.diag(spread)), atol=1e-9)


def test_update_is_josephs_form():
    rng = np.random.default_rng(2)
    factor, half = rng.normal(size=(6, 6)), rng.normal(size=(3, 3))
    covariance, noise = factor @ factor.T, half @ half.T + 0.1 * np.eye(3)
    measured = np.eye(3, 6)
    gain = covariance @ measured.T @ np.linalg.inv(measured @ covariance @ measured.T + noise)
    remaining = np.eye(6) - gain @ measured
    _, got = tick.update(np.zeros(6), covariance, np.ones(3), noise)
    np.testing.assert_allclose(got, remaining @ covariance @ remaining.T + gain @ noise @ gain.T, atol=1e-9)


def test_history_is_interpolated_between_ticks():
    """A hand that moves evenly is where it was that long ago, whether or not a tick fell there."""
    weights = belief.tick_weights((0.1, 0.25), 66.0)
    ages = np.arange(weights.shape[1]) / 66.0
    np.testing.assert_allclose(weights @ (2.0 - 3.0 * ages), [2.0, 1.7, 1.25])


def test_parabola_through_three_latents_is_exact():
    for fraction in (-1.0, -0.3, 0.0, 0.25, 1.0):
        weights = belief.lagrange(fraction)
        for power in range(3):
            assert np.isclose(weights @ np.array([-1.0, 0.0, 1.0]) ** power, fraction**power)


def test_prediction_hardly_depends_on_the_tick_rate(model: HGPDM):
    start = np.concatenate([model.start_mean + 0.05, model.start_mean])
    moving, ends = Filter(model, 60.0), []
    for ticks in (1, 4):
        latent, covariance = start, 1e-4 * np.eye(start.size)
        for _ in range(3 * ticks):
            latent, covariance = moving.predict(latent, covariance, model.lag / ticks)
        ends.append((np.asarray(latent), np.sqrt(np.diag(covariance))))
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=0.05)


def test_covariance_grows_without_measurement_and_stays_a_covariance(model: HGPDM):
    moving = Filter(model, 60.0)
    latent, covariance = np.tile(model.start_mean, 2), 1e-4 * np.eye(2 * model.preset.interaction_dims)
    traces = []
    for _ in range(40):
        latent, covariance = moving.predict(latent, covariance, model.lag / 4)
        traces.append(float(np.trace(covariance)))
        assert np.linalg.eigvalsh(covariance).min() > -1e-9
    assert np.all(np.diff(traces[:10]) > 0.0)
    assert np.all(np.diag(covariance) <= BELIEF.covariance_limit * (1.0 + 1e-9))


@pytest.mark.parametrize("hidden", [1, 7, 25])
def test_what_was_made_up_of_a_hand_is_forgotten_when_it_is_back(model: HGPDM, hidden: int):
    """A hand at a steady pace that was away for a while leaves the memory of one that never was."""
    moving, style, variance = Filter(model, 60.0), np.array([0.5, 0.5]), np.full(6, 4e-6)
    hands = np.linspace([0.9, 0.0, 0.9] * 2, [0.6, 0.1, 1.4] * 2, 100)
    never = away = moving.initial(style)
    for number, hand in enumerate(hands):
        never, _ = moving.step(never, hand, variance, style)
        away, _ = moving.step(away, None if 50 <= number < 50 + hidden else hand, variance, style)
        if number == 50 + hidden:
            np.testing.assert_allclose(away.hands[:, 0], never.hands[:, 0], atol=1e-9)
            assert np.all(away.hands[1:-1, 1] >= never.hands[1:-1, 1])
            assert np.any(away.hands[:, 1] > never.hands[:, 1])
    # Some ticks later the latents are nearly those of one that never was.
    np.testing.assert_allclose(away.latent, never.latent, atol=0.1)


def test_shapes_that_do_not_fit_are_named(model: HGPDM):
    """Compiled code would read past their ends."""
    moving, style, variance = Filter(model, 60.0), np.array([0.5, 0.5]), np.full(6, 1e-6)
    state = moving.initial(style)
    with pytest.raises(HighFiveError, match=r"\(9,\) where the model needs \(6,\)"):
        moving.step(state, np.zeros(9), variance, style)
    with pytest.raises(HighFiveError, match=r"needs \(6,\)"):
        moving.step(state, np.zeros(6), np.zeros(3), style)
    with pytest.raises(HighFiveError, match=r"needs \(2,\)"):
        moving.step(state, np.zeros(6), variance, np.ones(1))
    with pytest.raises(HighFiveError, match="needs"):
        moving.predict(state.latent[:3], state.covariance, 0.1)


@pytest.mark.parametrize("rate", [30.0, 120.0])
def test_a_hand_at_rest_is_no_strangers_whatever_the_model_and_rate(model: HGPDM, rate: float) -> None:
    """How sure a belief can be is each model's own: one with steeper features is never surer than 0.18."""
    lost = []
    for steeper in (1.0, 4.0):
        features = FeatureMap(steeper * model.feature_map.matrix, steeper * model.feature_map.offset)
        moving = Filter(replace(model, feature_map=features), rate)
        style = np.full(len(model.emotions), 1.0 / len(model.emotions))
        now = moving.initial(style)
        hand, variance = now.generated_hand, np.full(len(now.generated_hand), belief.HAND_VARIANCE)
        for _ in range(round(2.0 * rate)):
            now, _ = moving.step(now, hand, variance, style)
        assert moving.deviation(now.covariance) < moving.lost
        lost.append(moving.lost)
        for _ in range(round(2.0 * rate)):
            now, _ = moving.step(now, hand + 3.0, variance, style)  # where nobody's hand was
        assert moving.deviation(now.covariance) > moving.lost
    assert lost[0] == BELIEF.out_of_distribution < lost[1] <= BELIEF.never_known

"""The compiled tick against its formulas, layer by layer and as a whole."""

from dataclasses import replace

import jax.numpy as jnp
import naive_filter
import numpy as np
import pytest

from highfive.model.gp import sparse
from highfive.model.gp.coregionalisation import initial_style
from highfive.model.gp.kernels import MotionKernel
from highfive.model.gp.sparse import Layer, Posterior
from highfive.model.hgpdm.features import fit_feature_map
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.belief import Filter, packed
from highfive.model.online.layer import predict_layer

STYLES = {"plain": None, "styled": np.array([0.25, 0.75])}
RATE = 60.0


def posterior_of(inputs: int, channels: int, styled: bool = False, seed: int = 3) -> Posterior:
    """A layer with an offset and unequal scales."""
    rng = np.random.default_rng(seed)
    points, styles = jnp.asarray(rng.normal(size=(60, inputs))), jnp.asarray(np.eye(2)[rng.integers(0, 2, 60)])
    values = jnp.sin(points @ rng.normal(size=(inputs, channels)))
    kernel = MotionKernel(
        jnp.asarray(np.log(rng.uniform(1.0, 2.0, inputs))),
        jnp.asarray(np.log(1.7)),
        jnp.asarray(np.log(rng.uniform(0.1, 0.4, inputs))),
        jnp.asarray(np.log(0.3)),
    )
    layer = Layer(kernel, points[:22], jnp.zeros(()), initial_style(2, styles[:22]) if styled else None)
    offset, scale = jnp.asarray(rng.normal(size=channels)), jnp.asarray(rng.uniform(0.5, 2.0, channels))
    return sparse.fit(layer, points, values, jnp.asarray(0.05), styles if styled else None, offset, scale)


@pytest.fixture(scope="module")
def chained(model: HGPDM) -> HGPDM:
    """A model in the manner of the paper: the hand as it is now, two back projections in a row, no memory of speed."""
    dims = model.preset.interaction_dims
    preset = replace(model.preset, history=(), velocity_decay=0.0)
    hands = np.random.default_rng(4).normal(size=(50, 1, 6)) * 0.3
    back = (posterior_of(6, 2, seed=5), posterior_of(2, dims, seed=6))
    return replace(model, preset=preset, feature_map=fit_feature_map(hands), back=back)


@pytest.mark.slow
@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_layer_is_that_of_the_batch_prediction(style: np.ndarray | None):
    posterior = posterior_of(3, 5, style is not None)
    layer = packed(posterior)
    for point in np.random.default_rng(5).normal(size=(4, 3)):
        got = predict_layer(layer, point, np.ones(1) if style is None else style)
        for ours, plain in zip(got, naive_filter.predicted(posterior, point, style), strict=True):
            np.testing.assert_allclose(ours, plain, atol=1e-10)


def test_a_layer_without_styles_does_not_mind_their_weights():
    posterior, point = posterior_of(3, 5), np.array([0.3, -0.2, 0.5])
    got = predict_layer(packed(posterior, 3), point, np.array([0.2, 0.5, 0.3]))
    for ours, plain in zip(got, naive_filter.predicted(posterior, point), strict=True):
        np.testing.assert_allclose(ours, plain, atol=1e-10)


@pytest.mark.parametrize("name", ["model", "chained"])
def test_every_tick_is_that_of_the_formulas(name: str, trials: list[Trial], request: pytest.FixtureRequest):
    """Of the hierarchy alone, from the first sight of the hand through a gap and back, while the style changes."""
    subject: HGPDM = replace(request.getfixturevalue(name), ensemble=None)
    moving, styles = Filter(subject, RATE), (np.array([1.0, 0.0]), np.array([0.3, 0.7]))
    belief = moving.initial(styles[0])
    hidden = {0, 1, *range(20, 30), 33}
    for number, hand in enumerate(trials[0].hand_points[30:72].reshape(-1, 6)):
        given = None if number in hidden else hand
        inputs = belief, given, np.linspace(1e-6, 1e-5, 6), styles[number > 10]
        plain_belief, plain = naive_filter.ticked(subject, RATE, *inputs)
        belief, answer = moving.step(*inputs)
        for ours, theirs in zip((*belief, *answer), (*plain_belief, *plain), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


def test_other_layouts_of_the_same_numbers_give_the_same_answer(model: HGPDM, trials: list[Trial]):
    moving, style = Filter(model, RATE), np.array([0.5, 0.5])
    belief, variance = moving.initial(style), np.full(6, 2.0**-20)  # the same number in single precision
    hand = trials[0].hand_points[0].reshape(6)
    _, plain = moving.step(belief, hand, variance, style)
    strided = np.repeat(hand, 2)[::2]
    strided.setflags(write=False)
    _, other = moving.step(belief, strided, variance.astype(np.float32).astype(float), np.float32([0.5, 0.5]))
    for ours, theirs in zip(plain, other, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)


def test_nothing_that_was_given_is_written_to(model: HGPDM, trials: list[Trial]):
    moving, style = Filter(model, RATE), np.array([0.5, 0.5])
    belief = moving.initial(style)
    for hand in trials[0].hand_points[:5].reshape(-1, 6):
        kept = [np.copy(part) for part in belief]
        later, _ = moving.step(belief, hand, np.full(6, 1e-6), style)
        for before, after in zip(kept, belief, strict=True):
            np.testing.assert_array_equal(before, after)
        belief = later


def test_covariance_of_channels_is_carried_from_the_latents(model: HGPDM):
    moving, style = Filter(model, RATE), np.array([0.3, 0.7])
    start = moving.initial(style)
    got = moving.generate(start.latent, start.covariance, style)
    inputs, split = (start.latent, start.covariance, start.residual, style), model.preset.avatar_dims
    plain = naive_filter.generated(model, *inputs)
    carried = np.array(plain.avatar_slope @ plain.spread[:split, :split] @ plain.avatar_slope.T)
    np.fill_diagonal(carried, plain.avatar_deviations**2)
    np.testing.assert_allclose(got.covariance(slice(2, 6)), carried[2:6, 2:6], atol=1e-9)

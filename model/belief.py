"""The online state as a Gaussian belief, and how one tick moves it: predict, measure, generate.

An extended Kalman filter over the last two interaction latents. The covariance of the previous tick passes through the
dynamics; with the one-step variance alone, the prediction would get nearly all the weight and drift (the product of
experts of the paper's "expected posterior", measured: 0.217 m against 0.125 m at contact on real people).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from model import sparse
from model.dataset import HAND_DIMS
from model.hgpdm import HGPDM
from model.hierarchy import VELOCITY_UNIT, dynamics_input, dynamics_mean
from model.sparse import Posterior

TRUST_TIME = 0.1  # s over which a hand that comes back regains its full weight
STYLE_TIME = 0.1  # s, time constant of each of the two smoothings of the style weights
COVARIANCE_LIMIT = 10.0  # variance of a latent beyond which more doubt means nothing (the data have variance 1)


class Belief(NamedTuple):
    """What is carried from tick to tick.

    Attributes:
        latent: (2 q,) mean of I now and one lag ago.
        covariance: (2 q, 2 q).
        hand: (L, 6) m, the hand of the last L ticks, newest first; predicted where it was not seen.
        hand_variance: (L, 6) m².
        generated_hand: (6,) m, the hand as the human layer generates it.
        style: (2, K) the style weights after one and after two smoothings.
        trust: () from 0 (the hand has been away) to 1 (it is in steady view).
        started: () bool, a hand has been seen.
    """

    latent: jax.Array
    covariance: jax.Array
    hand: jax.Array
    hand_variance: jax.Array
    generated_hand: jax.Array
    style: jax.Array
    trust: jax.Array
    started: jax.Array


class Generated(NamedTuple):
    """What a belief generates: avatar channels (channels,) and their variances, hand (6,) and its variances."""

    channels: jax.Array
    channel_variance: jax.Array
    hand: jax.Array
    hand_variance: jax.Array


def lagrange(fraction: float) -> np.ndarray:
    """Weights (3,) of the values at −1, 0 and 1 in the parabola through them, at ``fraction``."""
    s = fraction
    return np.array([0.5 * s * (s - 1.0), 1.0 - s * s, 0.5 * s * (s + 1.0)])


def buffer_length(model: HGPDM, rate_hz: float) -> int:
    """Ticks of hand history that the features reach back."""
    return math.ceil(max(model.preset.history, default=0.0) * rate_hz) + 2


def initial_belief(model: HGPDM, style: np.ndarray, rate_hz: float) -> Belief:
    """The belief before any hand was seen: where training trials begin."""
    length, dims = buffer_length(model, rate_hz), model.preset.interaction_dims
    start = jnp.asarray(np.tile(model.start_mean, 2))
    still = jnp.asarray(np.kron(np.ones((2, 2)), model.start_covariance) + 1e-6 * np.eye(2 * dims))
    hand = sparse.mean(model.human, sparse.mean(model.interaction, start[:dims])[model.preset.avatar_dims :])
    return Belief(
        start,
        still,
        jnp.tile(hand, (length, 1)),
        jnp.full((length, HAND_DIMS), 1e-2),
        hand,
        jnp.tile(jnp.asarray(style), (2, 1)),
        jnp.asarray(1.0),
        jnp.asarray(False),
    )


def predict(model: HGPDM, latent: jax.Array, covariance: jax.Array, seconds: float) -> tuple[jax.Array, jax.Array]:
    """The belief over (I now, I one lag ago) a time later: the dynamics, linearised, in steps of at most one lag.

    Between a lag ago, now, and the dynamics' answer one lag ahead lies a parabola; its noise grows with time.
    """
    substeps = max(1, math.ceil(seconds / model.lag - 1e-9))
    fraction = seconds / model.lag / substeps
    dims = model.preset.interaction_dims
    now_weights, lag_weights = lagrange(fraction), lagrange(fraction - 1.0)
    identity = jnp.eye(dims)
    for _ in range(substeps):
        now, before = latent[:dims], latent[dims:]
        change, slope, variance = sparse.predict(model.dynamics, dynamics_input(now, before, model.lag))
        ahead = dynamics_mean(now, before, model.lag, model.preset) + change
        decay = dynamics_mean(jnp.ones(()), jnp.zeros(()), model.lag, model.preset)  # of the velocity, plus one
        by_velocity = slope[:, dims:] * (VELOCITY_UNIT / model.lag)
        ahead_now = decay * identity + slope[:, :dims] + by_velocity
        ahead_before = dynamics_mean(jnp.zeros(()), jnp.ones(()), model.lag, model.preset) * identity - by_velocity
        ahead_both = jnp.concatenate([ahead_now, ahead_before], axis=1)
        rows, means = [], []
        for weights in (now_weights, lag_weights):
            means.append(weights[0] * before + weights[1] * now + weights[2] * ahead)
            rows.append(
                jnp.concatenate([weights[1] * identity, weights[0] * identity], axis=1) + weights[2] * ahead_both
            )
        transition = jnp.concatenate(rows, axis=0)
        noise = jnp.concatenate([jnp.full(dims, fraction), jnp.zeros(dims)]) * (variance + model.dynamics.noise)
        latent = jnp.concatenate(means)
        covariance = transition @ covariance @ transition.T + jnp.diag(noise)
        largest = jnp.max(jnp.diag(covariance))
        covariance = covariance * jnp.minimum(1.0, COVARIANCE_LIMIT / largest)
    return latent, covariance


def measure(model: HGPDM, hand: jax.Array, hand_variance: jax.Array, rate_hz: float) -> tuple[jax.Array, jax.Array]:
    """I as the back projections see it: mean (q,) and covariance (q, q) from the hand's last ticks (L, 6).

    The uncertainty of the hand passes through; the back projection adds its own, which is large far from the training
    data. That part stays the same from tick to tick, so it is counted once a lag and not once a tick.
    """
    ticks = np.array([0.0, *model.preset.history]) * rate_hz
    low = np.floor(ticks + 1e-9).astype(int)
    fraction = (ticks - low)[:, None]
    history = (1.0 - fraction) * hand[low] + fraction * hand[low + 1]
    spread = (1.0 - fraction) * hand_variance[low] + fraction * hand_variance[low + 1]
    matrix = jnp.asarray(model.feature_map.matrix)
    value = matrix @ history.reshape(-1) + model.feature_map.offset
    covariance = (matrix * spread.reshape(-1)) @ matrix.T
    repeats = max(1.0, model.lag * rate_hz)
    for stage in model.back:
        value, slope, variance = sparse.predict(stage, value)
        own = (variance + stage.noise) * stage.scale**2 * repeats
        covariance = slope @ covariance @ slope.T + jnp.diag(own)
    return value, covariance


def update(
    latent: jax.Array, covariance: jax.Array, value: jax.Array, noise: jax.Array, trust: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Kalman update of (I now, I one lag ago) by a measurement of I now, with the gain scaled by ``trust``.

    Joseph's form, which is right for any gain.
    """
    dims = value.shape[0]
    cross = covariance[:, :dims]
    gain = trust * jnp.linalg.solve(cross[:dims] + noise, cross.T).T
    remaining = jnp.eye(2 * dims) - jnp.concatenate([gain, jnp.zeros((2 * dims, dims))], axis=1)
    return latent + gain @ (value - latent[:dims]), remaining @ covariance @ remaining.T + gain @ noise @ gain.T


def descend(model: HGPDM, latent: jax.Array, covariance: jax.Array) -> tuple[jax.Array, jax.Array]:
    """X¹ and X², side by side (q_1 + q_2,), and their covariance, from I (q,) and its covariance (q, q)."""
    below, slope, variance = sparse.predict(model.interaction, latent)
    own = (variance + model.interaction.noise) * model.interaction.scale**2
    return below, slope @ covariance @ slope.T + jnp.diag(own)


def emit(
    layer: Posterior, latent: jax.Array, covariance: jax.Array, style: jax.Array | None = None
) -> tuple[jax.Array, jax.Array]:
    """Channels (D,) of a layer and their variances, noise included, from a latent (q,) and its covariance (q, q)."""
    mean, slope, variance = sparse.predict(layer, latent, style)
    return mean, jnp.sum((slope @ covariance) * slope, axis=1) + (variance + layer.noise) * layer.scale**2


def generate(model: HGPDM, latent: jax.Array, covariance: jax.Array, style: jax.Array) -> Generated:
    """Down the hierarchy from I (q,) and its covariance (q, q): I → X¹, X² → Y¹, Y², linearised, with all variances."""
    split = model.preset.avatar_dims
    below, spread = descend(model, latent, covariance)
    channels = emit(model.avatar, below[:split], spread[:split, :split], style)
    return Generated(*channels, *emit(model.human, below[split:], spread[split:, split:]))


def step(
    model: HGPDM,
    rate_hz: float,
    belief: Belief,
    hand: jax.Array,
    hand_variance: jax.Array,
    seen: jax.Array,
    style: jax.Array,
) -> tuple[Belief, Generated]:
    """One tick: predict, measure if the hand (6,) was seen, and generate in the smoothed style."""
    seconds, dims = 1.0 / rate_hz, model.preset.interaction_dims
    predicted, spread = predict(model, belief.latent, belief.covariance, seconds)
    predicted = jnp.where(belief.started, predicted, belief.latent)
    spread = jnp.where(belief.started, spread, belief.covariance)

    # An unseen hand moves on as the human layer generates it, from where it was last seen.
    split = model.preset.avatar_dims
    below, below_spread = descend(model, predicted[:dims], spread[:dims, :dims])
    generated, generated_variance = emit(model.human, below[split:], below_spread[split:, split:])
    moved = belief.hand[0] + generated - belief.generated_hand
    first = seen & ~belief.started
    change = seconds / TRUST_TIME
    trust = jnp.clip(belief.trust + jnp.where(seen, change, -change), 0.0, 1.0)
    trust = jnp.where(first, 1.0, trust)
    # A hand that comes back is blended in, value and doubt: otherwise each of the features' earlier times would meet
    # the edge of the gap in one tick, and the pose would jump each time.
    weight = jnp.where(seen, trust**2 * (3.0 - 2.0 * trust), 0.0)
    newest = weight * hand + (1.0 - weight) * moved
    newest_variance = weight * hand_variance + (1.0 - weight) * generated_variance
    hands = jnp.concatenate([newest[None], belief.hand[:-1]])
    variances = jnp.concatenate([newest_variance[None], belief.hand_variance[:-1]])
    hands = jnp.where(first, hand, hands)
    variances = jnp.where(first, hand_variance, variances)

    value, noise = measure(model, hands, variances, rate_hz)
    updated, covariance = update(predicted, spread, value, noise, trust**2)
    latent = jnp.where(seen, updated, predicted)
    covariance = jnp.where(seen, covariance, spread)
    latent = jnp.where(first, jnp.tile(value, 2), latent)
    covariance = jnp.where(first, jnp.kron(jnp.eye(2), noise), covariance)
    covariance = 0.5 * (covariance + covariance.T)

    share = 1.0 - math.exp(-seconds / STYLE_TIME)
    once = belief.style[0] + share * (style - belief.style[0])
    twice = belief.style[1] + share * (once - belief.style[1])
    answer = generate(model, latent[:dims], covariance[:dims, :dims], twice)
    following = Belief(
        latent, covariance, hands, variances, answer.hand, jnp.stack([once, twice]), trust, belief.started | seen
    )
    return following, answer

"""The online state as a Gaussian belief, and how one tick moves it: predict, measure, generate.

An extended Kalman filter over the last two interaction latents. The covariance of the previous tick passes through the
dynamics; with the one-step variance alone, the prediction would get nearly all the weight and drift (the product of
experts of the paper's "expected posterior", measured: 0.217 m against 0.125 m at contact on real people).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.linalg import get_lapack_funcs

from model.hgpdm import HGPDM
from model.hierarchy import dynamics_input, dynamics_mean
from model.predictor import ALL, Prediction, Predictor
from model.rotations import Array

TRUST_TIME = 0.1  # s over which a hand that comes back regains its full weight
STYLE_TIME = 0.1  # s, time constant of each of the two smoothings of the style weights
COVARIANCE_LIMIT = 10.0  # variance of a latent beyond which more doubt means nothing (the data have variance 1)
(_solve_positive,) = get_lapack_funcs(("posv",))  # the checks of NumPy's solve take longer than the solution


class Belief(NamedTuple):
    """What is carried from tick to tick; no array of it is ever written to.

    Attributes:
        latent: (2 q,) mean of I now and one lag ago.
        covariance: (2 q, 2 q).
        hands: (L, 2, 6) the hand of the last L ticks, m, and its variances, m², newest first; predicted where unseen.
        generated_hand: (6,) m, the hand as the human layer generates it.
        style: (2, K) the style weights after one and after two smoothings.
        trust: from 0 (the hand has been away) to 1 (it is in steady view).
        started: a hand has been seen.
    """

    latent: Array
    covariance: Array
    hands: Array
    generated_hand: Array
    style: Array
    trust: float
    started: bool


class Generated(NamedTuple):
    """What a belief generates.

    Attributes:
        avatar, human: the two lowest layers at the means of their latents.
        avatar_spread, human_spread: covariances of those latents.
    """

    avatar: Prediction
    avatar_spread: Array
    human: Prediction
    human_spread: Array

    def channel_deviations(self, channels: slice = ALL) -> Array:
        """Standard deviations of the avatar channels, or of some of them."""
        return np.sqrt(self.avatar.variances(self.avatar_spread, channels))

    def hand_deviations(self) -> Array:
        """Standard deviations (6,) of the hand, m."""
        return np.sqrt(self.human.variances(self.human_spread))


def lagrange(fraction: float) -> Array:
    """Weights (3,) of the values at −1, 0 and 1 in the parabola through them, at ``fraction``."""
    s = fraction
    return np.array([0.5 * s * (s - 1.0), 1.0 - s * s, 0.5 * s * (s + 1.0)])


def tick_weights(history: tuple[float, ...], rate_hz: float) -> Array:
    """Matrix (H + 1, L) that interpolates the hand now and at each ``history`` s ago from its last L ticks."""
    ticks = np.array([0.0, *history]) * rate_hz
    low = np.floor(ticks + 1e-9).astype(int)
    weights = np.zeros((len(ticks), math.ceil(ticks.max()) + 2))
    rows = np.arange(len(ticks))
    weights[rows, low], weights[rows, low + 1] = 1.0 - (ticks - low), ticks - low
    return weights


def update(latent: Array, covariance: Array, value: Array, noise: Array, trust: float) -> tuple[Array, Array]:
    """Kalman update of (I now, I one lag ago) by a measurement of I now, with the gain scaled by ``trust``.

    With S the covariance of the surprise and K = trust · P S⁻¹ the gain, Joseph's form, which is right for any gain, is
    covariance − (2 − trust) K Pᵀ.
    """
    dims = len(value)
    cross = covariance[:, :dims]
    _, solved, _ = _solve_positive(cross[:dims] + noise, cross.T)
    gain = trust * solved.T
    return latent + gain.dot(value - latent[:dims]), covariance - (2.0 - trust) * gain.dot(cross.T)


class Filter:
    """A model at a tick rate, ready to move beliefs; it holds no belief itself."""

    def __init__(self, model: HGPDM, rate_hz: float) -> None:
        """Works out what does not change from tick to tick."""
        preset, dims = model.preset, model.preset.interaction_dims
        self.dims, self.lag = dims, model.lag
        self._seconds, self._split = 1.0 / rate_hz, preset.avatar_dims
        self._dynamics, self._interaction = Predictor(model.dynamics), Predictor(model.interaction)
        self._human, self._avatar = Predictor(model.human), Predictor(model.avatar)
        self._back = [Predictor(stage) for stage in model.back]
        now, before = jnp.split(jnp.eye(2 * dims), 2, axis=1)
        # Both are linear in (I now, I one lag ago): these are their matrices.
        self._inputs = np.asarray(dynamics_input(now, before, model.lag)).T
        self._carry_on = np.asarray(dynamics_mean(now, before, model.lag, preset)).T
        self._between: dict[float, tuple[Array, Array]] = {}
        self._features, self._feature_offset = model.feature_map.matrix, model.feature_map.offset
        self._ticks = tick_weights(preset.history, rate_hz)
        self._style_share = 1.0 - math.exp(-self._seconds / STYLE_TIME)
        self._repeats = max(1.0, model.lag * rate_hz)
        self._start = np.tile(model.start_mean, 2)
        self._start_covariance = np.kron(np.ones((2, 2)), model.start_covariance) + 1e-6 * np.eye(2 * dims)

    def initial(self, style: Array) -> Belief:
        """The belief before any hand was seen: where training trials begin."""
        below = self._interaction(self._start[: self.dims]).mean
        hand = self._human(below[self._split :]).mean
        hands = np.tile(np.stack([hand, np.full(len(hand), 1e-2)]), (self._ticks.shape[1], 1, 1))
        return Belief(self._start, self._start_covariance, hands, hand, np.tile(style, (2, 1)), 1.0, False)

    def predict(self, latent: Array, covariance: Array, seconds: float) -> tuple[Array, Array]:
        """The belief over (I now, I one lag ago) a time later: the dynamics, linearised, in steps of at most one lag.

        Between a lag ago, now, and the dynamics' answer one lag ahead lies a parabola; its noise grows with time.
        """
        dims, substeps = self.dims, max(1, math.ceil(seconds / self.lag - 1e-9))
        fraction = seconds / self.lag / substeps
        if fraction not in self._between:
            self._between[fraction] = self._between_lags(fraction)
        steady, share = self._between[fraction]
        for _ in range(substeps):
            change = self._dynamics(self._inputs.dot(latent))
            transition = steady + share.dot(change.slope().dot(self._inputs))
            latent = steady.dot(latent) + share.dot(change.mean)
            covariance = transition.dot(covariance).dot(transition.T)
            diagonal = covariance.reshape(-1)[:: 2 * dims + 1]
            diagonal[:dims] += fraction * (change.variance() + self._dynamics.noise)
            if (largest := diagonal.max()) > COVARIANCE_LIMIT:
                covariance *= COVARIANCE_LIMIT / largest
        return latent, covariance

    def _between_lags(self, fraction: float) -> tuple[Array, Array]:
        """What ``fraction`` of a lag makes of (I now, I one lag ago): (2 q, 2 q), and of the learned change: (2 q, q).

        ``fraction`` later, I now and I one lag ago lie on the parabola through I one lag ago, now and one lag ahead.
        """
        weights = np.array([lagrange(fraction), lagrange(fraction - 1.0)], dtype=float)
        identity = np.eye(self.dims)
        share = np.kron(weights[:, 2:], identity)
        steady = np.kron(weights[:, 1::-1], identity) + share @ self._carry_on
        return np.asarray(steady, dtype=float), np.asarray(share, dtype=float)

    def measure(self, hands: Array) -> tuple[Array, Array]:
        """I as the back projections see it: mean (q,) and covariance (q, q) from the hand's last ticks (L, 2, 6).

        The uncertainty of the hand passes through; the back projection adds its own, which is large far from the
        training data. That part stays the same from tick to tick, so it is counted once a lag and not once a tick.
        """
        history = self._ticks.dot(hands.reshape(len(hands), -1)).reshape(-1, 2, hands.shape[-1])
        value = self._features.dot(history[:, 0].reshape(-1)) + self._feature_offset
        covariance = (self._features * history[:, 1].reshape(-1)).dot(self._features.T)
        for stage in self._back:
            projected = stage(value)
            value, covariance = projected.mean, projected.covariance(covariance, self._repeats)
        return value, covariance

    def generate(self, latent: Array, covariance: Array, style: Array) -> Generated:
        """Down the hierarchy from I and its covariance: I → X¹, X² → Y¹, Y², linearised."""
        human, human_spread, below, spread = self._down(latent, covariance)
        split = self._split
        return Generated(self._avatar(below[:split], style), spread[:split, :split], human, human_spread)

    def step(self, belief: Belief, hand: Array | None, hand_variance: Array, style: Array) -> tuple[Belief, Generated]:
        """One tick: predict, measure the hand (6,), of variances (6,), if it was seen, and generate."""
        dims, seen = self.dims, hand is not None
        first = seen and not belief.started
        latent, covariance = belief.latent, belief.covariance
        if belief.started:
            latent, covariance = self.predict(latent, covariance, self._seconds)
        change = self._seconds / TRUST_TIME
        trust = 1.0 if first else min(max(belief.trust + (change if seen else -change), 0.0), 1.0)
        hands = np.empty_like(belief.hands)
        hands[1:] = belief.hands[:-1]
        hands[0, 0], hands[0, 1] = self._newest(belief, latent, covariance, hand, hand_variance, trust)
        if first:
            hands[1:] = hands[0]
        if seen:
            value, noise = self.measure(hands)
            if first:
                latent, covariance = np.tile(value, 2), np.kron(np.eye(2), noise)
            else:
                latent, covariance = update(latent, covariance, value, noise, trust**2)
        covariance = 0.5 * (covariance + covariance.T)

        styles = belief.style.copy()
        styles[0] += self._style_share * (style - styles[0])
        styles[1] += self._style_share * (styles[0] - styles[1])
        generated = self.generate(latent[:dims], covariance[:dims, :dims], styles[1])
        started = belief.started or seen
        return Belief(latent, covariance, hands, generated.human.mean, styles, trust, started), generated

    def _down(self, latent: Array, covariance: Array) -> tuple[Prediction, Array, Array, Array]:
        """The human layer and the covariance of X²; X¹ and X², side by side (q_1 + q_2,), and their covariance."""
        below, split = self._interaction(latent[: self.dims]), self._split
        spread = below.covariance(covariance[: self.dims, : self.dims])
        return self._human(below.mean[split:]), spread[split:, split:], below.mean, spread

    def _newest(
        self, belief: Belief, latent: Array, covariance: Array, hand: Array | None, variance: Array, trust: float
    ) -> tuple[Array, Array]:
        """The hand (6,), m, and its variances (6,), m², that this tick adds to the history.

        An unseen hand moves on as the human layer generates it at the predicted I, from where it was last seen. A hand
        that comes back is blended in, value and doubt: otherwise each of the features' earlier times would meet the
        edge of the gap in one tick, and the pose would jump each time.
        """
        if hand is not None and trust == 1.0:
            return hand, variance
        human, spread, _, _ = self._down(latent, covariance)
        moved, doubt = belief.hands[0, 0] + human.mean - belief.generated_hand, human.variances(spread)
        if hand is None:
            return moved, doubt
        weight = trust**2 * (3.0 - 2.0 * trust)
        return weight * hand + (1.0 - weight) * moved, weight * variance + (1.0 - weight) * doubt

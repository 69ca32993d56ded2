"""What a tick is computed from and what it gives, as compiled code sees it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from highfive.model.geometry.rotations import Array


class Moving(NamedTuple):
    """How time passes: ``substeps`` times ``fraction`` of a lag, at most one.

    Attributes:
        steady: (2 q, 2 q) what a substep makes of (I now, I one lag ago).
        share: (2 q, q) what it makes of the learned change.
        fraction, substeps: as said.
    """

    steady: Array
    share: Array
    fraction: float
    substeps: int


class Plan(NamedTuple):
    """What does not change from tick to tick.

    Attributes:
        dynamics, interaction, human, avatar: the layers, each as :func:`highfive.model.online.belief.packed`.
        back: the back projections, one after the other; the last gives I and, where X¹ has one, X¹.
        inputs: (2 q, 2 q) from (I now, I one lag ago) to the dynamics' input.
        features, feature_offset: (F, P (H + 1)) and (F,), the feature map.
        ticks, earlier: (H + 1, L) interpolate the hand's history, and that of one lag ago, from its last L ticks.
        repeats: ticks a lag: how often a back projection's own variance is met.
        human_first: where X² begins in the interaction layer's output, after X¹.
        tick: one tick.
        style_share: how far each smoothing of the style goes in a tick.
        residual_left: how much of what X¹ has beyond I is left after a tick.
        speed_span, covariance_limit: as in :class:`highfive.model.online.belief_settings.BeliefSettings`.
    """

    dynamics: Array
    interaction: Array
    human: Array
    avatar: Array
    back: Array
    inputs: Array
    features: Array
    feature_offset: Array
    ticks: Array
    earlier: Array
    repeats: float
    human_first: int
    tick: Moving
    style_share: float
    residual_left: float
    speed_span: int
    covariance_limit: float


class Belief(NamedTuple):
    """What is carried from tick to tick; no array of it is ever written to.

    Attributes:
        latent: (2 q,) mean of I now and one lag ago.
        covariance: (2 q, 2 q).
        residual: (2, q_1) what X¹ has beyond what I says, and its variance as a share of the interaction layer's.
        hands: (L, 2, P) the hand of the last L ticks, m, and its variances, m², newest first; predicted while unseen.
        away: ticks since the hand was last seen.
        generated_hand: (P,) m, the hand as the human layer generates it.
        style: (2, K) the style weights after one and after two smoothings.
        beyond: (2, channels) what the pool has beyond the hierarchy's answer, after one and after two smoothings.
        started: a hand has been seen.
    """

    latent: Array
    covariance: Array
    residual: Array
    hands: Array
    away: int
    generated_hand: Array
    style: Array
    beyond: Array
    started: bool


class Generated(NamedTuple):
    """What a belief generates.

    Attributes:
        avatar, avatar_deviations: (channels,) mean and standard deviation, noise included.
        avatar_slope: (channels, q_1) derivative of the mean by X¹.
        human, human_deviations: (P,) m, mean and standard deviation of the hand.
        spread: (q_1 + q_2, q_1 + q_2) covariance of X¹ and X².
        factors: (channels,) of the deviations, by which those of a pool differ from the hierarchy's.
    """

    avatar: Array
    avatar_deviations: Array
    avatar_slope: Array
    human: Array
    human_deviations: Array
    spread: Array
    factors: Array

    def covariance(self, channels: slice) -> Array:
        """Covariance (D', D') of some avatar channels: what they share through X¹, and the variance of each."""
        slope = self.avatar_slope[channels] * self.factors[channels, None]
        dims = slope.shape[1]
        covariance = slope @ self.spread[:dims, :dims] @ slope.T
        np.fill_diagonal(covariance, self.avatar_deviations[channels] ** 2)
        return covariance

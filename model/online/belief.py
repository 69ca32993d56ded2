"""The online state as a Gaussian belief, and how one tick moves it: predict, measure, generate.

An extended Kalman filter over the last two interaction latents. The covariance of the previous tick passes through the
dynamics; with the one-step variance alone, the prediction would get nearly all the weight and drift (the product of
experts of the paper's "expected posterior", measured: 0.217 m against 0.125 m at contact on real people).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.gp.posterior import Posterior, motion_parameters
from highfive.model.hgpdm.contact_layer import SPEED_SPAN
from highfive.model.hgpdm.dataset import KNUCKLES
from highfive.model.hgpdm.dynamics import dynamics_input, dynamics_mean
from highfive.model.hgpdm.intent_features import HISTORY
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.belief_settings import BELIEF, BeliefSettings
from highfive.model.online.contact_forecast import ContactForecast, contact_forecast
from highfive.model.online.direct_answers import NO_ARM, Looking, PoseByArm, direct_of, pooled
from highfive.model.online.tick import forecast, generate, observe, predict, step
from highfive.model.online.tick_values import Belief, Generated, Moving, Plan

HAND_VARIANCE = 2e-3**2
"""m², of each coordinate of a measured hand point, where nobody says it."""
SETTLED = 1.0
"""s, in which a belief about a hand at rest settles."""


def lagrange(fraction: float) -> Array:
    """Weights (3,) of the values at −1, 0 and 1 in the parabola through them, at ``fraction``."""
    s = fraction
    return np.array([0.5 * s * (s - 1.0), 1.0 - s * s, 0.5 * s * (s + 1.0)])


def tick_weights(history: tuple[float, ...], rate_hz: float, ago: float = 0.0, span: float = 0.0) -> Array:
    """Matrix (H + 1, L) that interpolates the hand ``ago`` s ago and each ``history`` s before that.

    From its last L ticks, which reach back ``span`` s, or as far as needed if that is more.
    """
    ticks = (ago + np.array([0.0, *history])) * rate_hz
    low = np.floor(ticks + 1e-9).astype(int)
    weights = np.zeros((len(ticks), math.ceil(max(ticks.max(), span * rate_hz)) + 2))
    rows = np.arange(len(ticks))
    weights[rows, low], weights[rows, low + 1] = 1.0 - (ticks - low), ticks - low
    return weights


def packed(posterior: Posterior, styles: int = 1) -> Array:
    """A layer for :func:`highfive.model.online.layer.predict_layer`, with all that does not depend on the input worked
    out, in one vector.

    One argument a layer: compiled code counts the references to every array that it is given, which at eleven arrays a
    layer took longer than some layers do. The first number is the vector's length. A layer without styles has
    ``styles`` equal ones.

    Raises:
        HighFiveError: a layer with another kernel than ``MotionKernel``.
    """
    kernel, inducing = motion_parameters(posterior.kernel), np.asarray(posterior.inducing).T
    (dims, size), channels = inducing.shape, len(posterior.offset)
    shares, between = np.ones((styles, size)), np.ones((styles, styles))
    if posterior.style is not None and posterior.style_covariance is not None:
        shares, between = np.asarray(posterior.style).T, np.asarray(posterior.style_covariance)
    linear = np.exp(np.asarray(kernel.log_linear))
    scalars = kernel.log_rbf.item(), math.exp(kernel.log_bias.item())
    reduction = np.asarray(posterior.reduction)
    reduction = reduction + reduction.T - np.diag(np.diag(reduction))  # its quadratic form needs one triangle
    parts = [
        np.array([0, dims, size, len(shares), channels, *scalars]),
        np.exp(-2.0 * np.asarray(kernel.log_lengthscale)),
        linear,
        np.asarray(posterior.offset),
        np.asarray(posterior.scale) ** 2,
        np.broadcast_to(posterior.noise, channels),
        between,
        inducing,
        inducing * linear[:, None],
        shares,
        np.asarray(posterior.weights).T,
        reduction[np.tril_indices(size)],
    ]
    layer = np.concatenate([part.reshape(-1) for part in parts])
    layer[0] = len(layer)
    return layer


class Filter:
    """A model at a tick rate, ready to move beliefs; it holds no belief itself.

    Attributes:
        settings: of the belief.
        ticks: so many of a hand a belief holds.
        lost: deviation of the interaction latents, all together, beyond which a hand is unlike those of training.
    """

    def __init__(self, model: HGPDM, rate_hz: float, settings: BeliefSettings = BELIEF) -> None:
        """Works out what does not change from tick to tick, and compiles what moves a belief."""
        self.settings = settings
        preset, dims = model.preset, model.preset.interaction_dims
        back = max((0.0, *preset.history, *(HISTORY if model.intent is not None else ())))
        self.lag, self._seconds = model.lag, 1.0 / rate_hz
        self._coordinates, self._styles = len(model.human.offset), len(model.emotions)
        now, before = np.split(np.eye(2 * dims), 2, axis=1)
        # Both are linear in (I now, I one lag ago): these are their matrices.
        inputs = np.asarray(dynamics_input(now, before, model.lag)).T
        self._carry_on = np.asarray(dynamics_mean(now, before, model.lag, preset)).T
        self._moving: dict[float, Moving] = {}
        self._plan = Plan(
            dynamics=packed(model.dynamics),
            interaction=packed(model.interaction),
            human=packed(model.human),
            avatar=packed(model.avatar, self._styles),
            back=np.concatenate([packed(stage) for stage in model.back]),
            inputs=np.array(inputs, order="C"),
            features=np.array(model.feature_map.matrix, order="C"),
            feature_offset=np.array(model.feature_map.offset),
            ticks=tick_weights(preset.history, rate_hz, span=model.lag + back),
            earlier=tick_weights(preset.history, rate_hz, ago=model.lag),
            repeats=max(1.0, model.lag * rate_hz),
            human_first=preset.avatar_dims,
            tick=self._moving_by(self._seconds),
            style_share=1.0 - math.exp(-self._seconds / settings.style_time),
            residual_left=math.exp(-self._seconds / settings.residual_time),
            speed_span=settings.speed_span,
            covariance_limit=settings.covariance_limit,
        )
        self.ticks = self._plan.ticks.shape[1]
        self._unknown = np.stack([np.zeros(preset.avatar_dims), np.ones(preset.avatar_dims)])
        self._start = np.tile(model.start_mean, 2)
        self._start_covariance = np.kron(np.ones((2, 2)), model.start_covariance) + 1e-6 * np.eye(2 * dims)
        self._contact = model.contact
        self._contact_layer = None if model.contact is None else packed(model.contact.posterior)
        self._channels, self._direct = len(model.avatar.offset), None
        if model.ensemble is not None:
            share = 1.0 - math.exp(-self._seconds / settings.pool_time)
            regression = packed(model.ensemble.regression, self._styles)
            self._direct = direct_of(model.ensemble, regression, share)
            self._looking = Looking(self._plan.features, self._plan.feature_offset, self._plan.ticks)
            self._factors = np.array(model.ensemble.spread, dtype=float)
        self._compile()
        usual = min(settings.beyond_usual * self._at_rest(), settings.never_known)
        self.lost = max(settings.out_of_distribution, usual)

    def deviation(self, covariance: Array) -> float:
        """Of the interaction latents now and a lag ago, all together, of a belief's ``covariance`` (2 q, 2 q)."""
        return math.sqrt(covariance.trace())

    def _at_rest(self) -> float:
        style = np.full(self._styles, 1.0 / self._styles)
        belief = self.initial(style)
        hand, variance = belief.generated_hand, np.full(self._coordinates, HAND_VARIANCE)
        for _ in range(math.ceil(SETTLED / self._seconds)):
            belief, _ = self.step(belief, hand, variance, style)
        return self.deviation(belief.covariance)

    def _compile(self) -> None:
        """Calls once what will be called: nothing is left to compile when a hand is there."""
        style = np.full(self._styles, 1.0 / self._styles)
        belief = self.initial(style)
        self.predict(belief.latent, belief.covariance, self.lag)
        self.observe(belief.hands)
        self.step(belief, belief.generated_hand, np.ones(self._coordinates), style)
        self.forecast_contact(belief)

    def initial(self, style: Array) -> Belief:
        """The belief before any hand was seen: where training trials begin."""
        hand = self.generate(self._start, self._start_covariance, style).human
        hands = np.tile(np.stack([hand, np.full(len(hand), 1e-2)]), (self._plan.ticks.shape[1], 1, 1))
        styles, beyond = np.tile(style, (2, 1)), np.zeros((2, self._channels))
        return Belief(self._start, self._start_covariance, self._unknown, hands, 0, hand, styles, beyond, False)

    def predict(self, latent: Array, covariance: Array, seconds: float) -> tuple[Array, Array]:
        """The belief over (I now, I one lag ago) a time later: the dynamics, linearised, in steps of at most one lag.

        Between a lag ago, now, and the dynamics' answer one lag ahead lies a parabola; its noise grows with time.
        """
        size = len(self._start)
        return predict(self._plan, self._moving_by(seconds), _own(latent, size), _own(covariance, size, size))

    def observe(self, hands: Array) -> tuple[Array, Array]:
        """What the back projections make of the hand's last ticks (L, 2, P): mean (B,) and covariance (B, B).

        First I (q), then X¹ where it is projected, too. The uncertainty of the hand passes through; the back projection
        adds its own, which is large far from the training data. That part stays the same from tick to tick, so it is
        counted once a lag and not once per tick.
        """
        return observe(self._plan, self._plan.ticks, _own(hands, self._plan.ticks.shape[1], 2, self._coordinates))

    def generate(
        self, latent: Array, covariance: Array, style: Array, known: Belief | None = None, ahead: float = 0.0
    ) -> Generated:
        """Down the hierarchy from a belief over (I now, I one lag ago): I → X¹, X² → Y¹, Y², linearised.

        Args:
            latent: (2 q,).
            covariance: (2 q, 2 q).
            style: (K,) weights.
            known: the last tick's belief: what X¹ has beyond I, and the pool beyond the hierarchy; by default unknown.
            ahead: s that have passed since then.
        """
        size, left = len(self._start), math.exp(-ahead / self.settings.residual_time)
        residual = _own(self._unknown if known is None else known.residual, *self._unknown.shape)
        residual = np.stack([left * residual[0], left**2 * residual[1] + 1.0 - left**2])
        layers = _own(latent, size), _own(covariance, size, size), residual
        answer = generate(self._plan, *layers, _own(style, self._styles))
        return answer if self._direct is None or known is None else self._with(answer, left * known.beyond[1])

    def step(
        self,
        belief: Belief,
        hand: Array | None,
        hand_variance: Array,
        style: Array,
        arm: PoseByArm = NO_ARM,
        anew: bool = False,
    ) -> tuple[Belief, Generated]:
        """One tick: predict, measure the hand (P,), of variances (P,), if it was seen, and generate.

        What the whole ``arm`` says of the pose is pooled with it. A hand that is seen ``anew`` is believed at once: the
        pool is not smoothed then.
        """
        seen = belief.generated_hand if hand is None else _own(hand, self._coordinates)
        variance, weights = _own(hand_variance, self._coordinates), _own(style, self._styles)
        moved, answer = step(self._plan, belief, hand is not None, seen, variance, weights)
        if self._direct is None:
            return moved, answer
        if hand is None:
            beyond = self._plan.residual_left * belief.beyond
        else:
            looking, first = self._looking, anew or not belief.started
            style = moved.style[1]
            beyond = pooled(looking, self._direct, belief.beyond, first, moved.hands, style, answer.avatar, *arm)
        return moved._replace(beyond=beyond), self._with(answer, beyond[1])

    def _with(self, answer: Generated, beyond: Array) -> Generated:
        """The pool's answer: the hierarchy's, and what the pool has beyond it, (channels,)."""
        deviations = answer.avatar_deviations * self._factors
        return answer._replace(avatar=answer.avatar + beyond, avatar_deviations=deviations, factors=self._factors)

    def skip(self, belief: Belief, ticks: int) -> Belief:
        """The belief some ticks later, of which nothing was heard: one prediction, however many there are.

        The hand's history moves on by as many ticks, in which the hand counts as hidden.
        """
        if not belief.started:
            return belief
        seconds = ticks * self._seconds
        latent, covariance = self.predict(belief.latent, belief.covariance, seconds)
        left = math.exp(-seconds / self.settings.residual_time)
        share = 1.0 - math.exp(-seconds / self.settings.style_time)
        residual = np.stack([left * belief.residual[0], left**2 * belief.residual[1] + 1.0 - left**2])
        style = belief.style + share * (belief.style[:1] - belief.style)
        answer = self.generate(latent, covariance, style[1], belief, seconds)
        hidden = np.stack([belief.hands[0, 0] + answer.human - belief.generated_hand, answer.human_deviations**2])
        kept = max(len(belief.hands) - ticks, 0)
        hands = np.concatenate([np.tile(hidden, (len(belief.hands) - kept, 1, 1)), belief.hands[:kept]])
        away, beyond = belief.away + ticks, left * belief.beyond
        return Belief(latent, covariance, residual, hands, away, answer.human, style, beyond, True)

    def forecast_contact(self, belief: Belief) -> ContactForecast | None:
        """Where and when the palms will meet, as the hand's last ticks say; None where nothing was learned of it."""
        if self._contact is None or (found := self.contact_left(belief)) is None:
            return None
        return contact_forecast(belief.hands[0, 0, KNUCKLES], self.knuckle_speed(belief), *found, self._contact)

    def knuckle_speed(self, belief: Belief) -> float:
        """m/s, over :data:`~highfive.model.hgpdm.contact_layer.SPEED_SPAN`, in whole ticks."""
        back = min(max(1, round(SPEED_SPAN / self._seconds)), len(belief.hands) - 1)
        way = belief.hands[0, 0, KNUCKLES] - belief.hands[back, 0, KNUCKLES]
        return float(np.linalg.norm(way)) / (max(back, 1) * self._seconds)

    def contact_left(self, belief: Belief) -> tuple[Array, Array] | None:
        """Way, m, and time, s, that are left by the contact layer, (4,) and (4, 4), not calibrated."""
        return None if self._contact_layer is None else forecast(self._plan, self._contact_layer, belief.hands)

    def _moving_by(self, seconds: float) -> Moving:
        """How ``seconds`` pass: in steps of at most one lag.

        A ``fraction`` later, I now and I one lag ago lie on the parabola through I one lag ago, now and one lag ahead.
        """
        if seconds not in self._moving:
            substeps = max(1, math.ceil(seconds / self.lag - 1e-9))
            fraction = seconds / self.lag / substeps
            weights = np.array([lagrange(fraction), lagrange(fraction - 1.0)], dtype=float)
            identity = np.eye(len(self._carry_on))
            share = np.kron(weights[:, 2:], identity)
            steady = np.kron(weights[:, 1::-1], identity) + share @ self._carry_on
            steady, share = (np.array(matrix, dtype=float, order="C") for matrix in (steady, share))
            self._moving[seconds] = Moving(steady, share, fraction, substeps)
        return self._moving[seconds]


def _own(values: ArrayLike, *shape: int) -> Array:
    """A copy of its own. Compiled code reads past the end of a wrong shape, and is made anew for another layout."""
    copy = np.array(values, dtype=float, order="C")
    if copy.shape != shape:
        raise HighFiveError(f"an array of shape {copy.shape} where the model needs {shape}")
    return copy

"""The online response: one hand measurement in, one avatar pose out, in one compiled call."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from model import belief
from model.dataset import CLOCK_SCALE, HAND_DIMS
from model.errors import HighFiveError
from model.hgpdm import HGPDM
from model.rotations import Array
from model.style import style_weights

HAND_DEVIATION = 2e-3  # m, of a measured hand point where the caller gives no covariance
CLOCK_LIMIT = 0.98  # the contact clock is cut here: beyond 2.3 CLOCK_SCALE it tells nothing
MAXIMUM_FORECAST = 5.0  # s


@dataclass(frozen=True)
class Response:
    """What the model answers at one time; each ``_std`` is a predictive standard deviation in the same unit.

    Attributes:
        joints, joints_std: (D,) rad, rotation vectors relative to the rest pose.
        root, root_std: (3,) m, pelvis in the world.
        palm, palm_std: (3,) m, the avatar's palm as generated directly (beside what the joints give).
        contact_point, contact_point_std: (3,) m, where the palms will meet, or met last.
        time_to_contact, time_to_contact_std: s, negative after contact; informative within about ±0.9 s.
        hand, hand_std: (2, 3) m, the person's hand as the human layer generates it.
        latent, latent_covariance: (q,) and (q, q) of the interaction latent I.
        ahead: s, how far after the last tick this holds; 0 for the answer of a tick.
    """

    joints: Array
    joints_std: Array
    root: Array
    root_std: Array
    palm: Array
    palm_std: Array
    contact_point: Array
    contact_point_std: Array
    time_to_contact: float
    time_to_contact_std: float
    hand: Array
    hand_std: Array
    latent: Array
    latent_covariance: Array
    ahead: float


class Responder:
    """Answers a person's hand with an avatar's pose, tick by tick.

    The state is a Gaussian belief over the interaction latents (see :mod:`model.belief`).
    """

    def __init__(
        self, model: HGPDM, style_weights: str | Mapping[str, float] | ArrayLike, rate_hz: float = 120.0
    ) -> None:
        """Compiles the tick, so that the first one is as fast as the others.

        Args:
            model: the trained model.
            style_weights: an emotion's name, a mapping of names to weights, or (K,) weights that sum to one.
            rate_hz: ticks a second.
        """
        if not (math.isfinite(rate_hz) and rate_hz > 0.0):
            raise HighFiveError(f"a rate of {rate_hz} Hz; expected a positive number of ticks a second")
        self._model, self._rate_hz = model, float(rate_hz)
        self._style = _checked(style_weights, model)
        self._step = jax.jit(self._pack_step)
        self._ahead: dict[int, jax.stages.Wrapped] = {}
        self.reset()
        self.step(np.zeros((2, 3)))
        self.step(None)
        self.reset()

    @property
    def model(self) -> HGPDM:
        """The model that answers."""
        return self._model

    def reset(self) -> None:
        """Forgets the person: the next hand seen begins a new interaction."""
        self._belief = belief.initial_belief(self._model, self._style, self._rate_hz)

    def set_style(self, weights: str | Mapping[str, float] | ArrayLike) -> None:
        """Changes the style; the answer moves there smoothly within a few tenths of a second."""
        self._style = _checked(weights, self._model)

    def step(self, hand_points: ArrayLike | None, covariance: ArrayLike | None = None) -> Response:
        """One tick.

        Args:
            hand_points: (2, 3) m, the person's wrist and knuckle centre in the world, or None where the hand is hidden.
            covariance: (2, 3, 3) m², of the two points; by default 2 mm in each direction.

        Raises:
            HighFiveError: the points have another shape or are not finite.
        """
        seen = hand_points is not None
        hand = np.zeros(HAND_DIMS) if hand_points is None else np.asarray(hand_points, dtype=float)
        variance = np.full(HAND_DIMS, HAND_DEVIATION**2)
        if covariance is not None:
            variance = np.diagonal(np.asarray(covariance, dtype=float), axis1=-2, axis2=-1)
        if hand.size != HAND_DIMS or variance.size != HAND_DIMS:
            raise HighFiveError(
                f"hand points of shape {hand.shape}; expected (2, 3): wrist and knuckles, and (2, 3, 3)"
            )
        if not math.isfinite(hand.sum() + variance.sum()):
            raise HighFiveError("the hand points hold NaN or infinity; pass None while the hand is hidden")
        self._belief, packed = self._step(
            self._belief, hand.reshape(HAND_DIMS), variance.reshape(HAND_DIMS), seen, self._style
        )
        return self._unpack(np.asarray(packed), 0.0)

    def forecast(self, horizon_s: float) -> list[Response]:
        """Responses ahead of the last tick, one each model lag up to ``horizon_s``, if no hand is seen from now on."""
        if not 0.0 < horizon_s <= MAXIMUM_FORECAST:
            raise HighFiveError(f"a forecast of {horizon_s} s; expected more than 0 and at most {MAXIMUM_FORECAST:g} s")
        count = math.ceil(horizon_s / self._model.lag - 1e-9)
        if count not in self._ahead:
            self._ahead[count] = jax.jit(lambda state: self._pack_forecast(state, count))
        packed = np.asarray(self._ahead[count](self._belief))
        return [self._unpack(row, (number + 1) * self._model.lag) for number, row in enumerate(packed)]

    def _pack(self, latent: jax.Array, covariance: jax.Array, generated: belief.Generated) -> jax.Array:
        """One vector, because one transfer out of the compiled call is cheaper than ten."""
        dims = self._model.preset.interaction_dims
        deviations = jnp.sqrt(generated.channel_variance), jnp.sqrt(generated.hand_variance)
        latents = latent[:dims], covariance[:dims, :dims].reshape(-1)
        return jnp.concatenate([generated.channels, deviations[0], generated.hand, deviations[1], *latents])

    def _pack_step(
        self, state: belief.Belief, hand: jax.Array, variance: jax.Array, seen: jax.Array, style: jax.Array
    ) -> tuple[belief.Belief, jax.Array]:
        following, generated = belief.step(self._model, self._rate_hz, state, hand, variance, seen, style)
        return following, self._pack(following.latent, following.covariance, generated)

    def _pack_forecast(self, state: belief.Belief, count: int) -> jax.Array:
        dims = self._model.preset.interaction_dims

        def advance(carry: tuple[jax.Array, jax.Array], _: None) -> tuple[tuple[jax.Array, jax.Array], jax.Array]:
            latent, covariance = belief.predict(self._model, *carry, self._model.lag)
            generated = belief.generate(self._model, latent[:dims], covariance[:dims, :dims], state.style[1])
            return (latent, covariance), self._pack(latent, covariance, generated)

        return jax.lax.scan(advance, (state.latent, state.covariance), None, length=count)[1]

    def _unpack(self, packed: Array, ahead: float) -> Response:
        where, dims = self._model.channels, self._model.preset.interaction_dims
        size = where.size
        mean, deviation = packed[:size], packed[size : 2 * size]
        hand = packed[2 * size : 2 * size + 2 * HAND_DIMS].reshape(2, 2, 3)
        clock = min(max(float(mean[where.clock]), -CLOCK_LIMIT), CLOCK_LIMIT)
        return Response(
            joints=mean[: where.joints],
            joints_std=deviation[: where.joints],
            root=mean[where.root],
            root_std=deviation[where.root],
            palm=mean[where.palm],
            palm_std=deviation[where.palm],
            contact_point=mean[where.contact],
            contact_point_std=deviation[where.contact],
            time_to_contact=CLOCK_SCALE * math.atanh(clock),
            time_to_contact_std=CLOCK_SCALE * float(deviation[where.clock]) / (1.0 - clock**2),
            hand=hand[0],
            hand_std=hand[1],
            latent=packed[-dims * (dims + 1) : -dims * dims],
            latent_covariance=packed[-dims * dims :].reshape(dims, dims),
            ahead=ahead,
        )


def _checked(weights: str | Mapping[str, float] | ArrayLike, model: HGPDM) -> Array:
    return style_weights(weights, model.emotions)

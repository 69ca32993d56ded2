"""The online response: one hand measurement in, one avatar pose out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from highfive.model.compiled import compiled_entry
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.gp.mixture import GaussianMixture
from highfive.model.hgpdm.dataset import CLOCK_SCALE, HAND_DIMS, KNUCKLES, Channels
from highfive.model.hgpdm.style import style_weights
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.arm_track import ArmPoints, ArmTrack, LastArm
from highfive.model.online.belief import HAND_VARIANCE, Filter
from highfive.model.online.belief_settings import BELIEF, BeliefSettings
from highfive.model.online.contact_forecast import ContactForecast
from highfive.model.online.direct_answers import NO_ARM
from highfive.model.online.inertialization import Inertializer
from highfive.model.online.intent import Intent
from highfive.model.online.leading import Leading
from highfive.model.online.tick_values import Belief, Generated

HAND_SHAPE, ARM_SHAPE = (2, 3), (3, 3)
FURTHEST = 1e6
"""m, and m²: what is larger is no hand, and its square spoils a belief by rounding."""
CLOCK_LIMIT = 0.98  # the contact clock is cut here: beyond 2.3 CLOCK_SCALE it tells nothing
MAXIMUM_FORECAST = 5.0  # s
RETURNS = 3.0
"""Times the deviation of a hand point: who knows the hand so much better than a tick before sees it again."""
_LED = 0.3  # s, in which the palm's lead dies away in an answer ahead


@dataclass(frozen=True)
class Response:
    """What the model answers at one time.

    The predictive standard deviations ``joints_std``, ``root_std``, ``palm_std``, ``contact_point_std`` and
    ``hand_std`` have the shape and the unit of what they belong to.

    Attributes:
        joints: (D,) rad, rotation vectors relative to the rest pose.
        root: (3,) m, pelvis in the world.
        palm: (3,) m, the avatar's palm as generated directly (beside what the joints give).
        contact_point: (3,) m, where the palms will meet, or met last, as the avatar layer has it beside the pose.
        time_to_contact, time_to_contact_std: s, negative after contact, from the same layer; within about ±0.9 s.
        hand: (2, 3) m, the person's hand as the human layer generates it.
        latent, latent_covariance: (q,) and (q, q) of the interaction latent I.
        ahead: s, how far after the last tick this holds; 0 for the answer of a tick.
        in_distribution: the hand does what hands did in training, as the latents' covariance says.
        generated: the channels and the hand, with their deviations.
        forecast_contact: makes :attr:`contact`.
        contact_probability: that a contact is coming, 0 to 1; None before a hand was seen, or where the model has not
            learned it. While the hand is hidden it stays what it was.
        places: where reaches go, as it was learned; None where it was not.
    """

    joints: Array
    root: Array
    palm: Array
    contact_point: Array
    time_to_contact: float
    time_to_contact_std: float
    hand: Array
    latent: Array
    latent_covariance: Array
    ahead: float
    in_distribution: bool
    generated: Generated = field(repr=False, compare=False)
    forecast_contact: Callable[[], ContactForecast | None] = field(repr=False, compare=False)
    contact_probability: float | None = None
    places: GaussianMixture | None = None

    @property
    def contact(self) -> ContactForecast | None:
        """Where and when the palms will meet, as the contact layer forecasts it: better, and with a covariance.

        None in a forecast of responses, or where the model has no such layer. Worked out when it is first requested.
        """
        return self._forecast_once

    @cached_property
    def _forecast_once(self) -> ContactForecast | None:
        return self.forecast_contact()

    @property
    def hypotheses(self) -> GaussianMixture | None:
        """Where the palms may meet, (K, 3) m, and how likely each place is: as learned while the hand rests, as the
        forecast weighs them once it rises; in between by the probability that a contact is coming. A forecast is of
        hands that do come: of one that rests it only says where those go that are raised soon."""
        found = self.contact
        if self.places is None or found is None:
            return self.places
        probability = 1.0 if self.contact_probability is None else self.contact_probability
        return self.places.told(found.point, found.covariance[:3, :3], probability)

    @property
    def joints_std(self) -> Array:
        """(D,) rad."""
        return self.generated.avatar_deviations[: len(self.joints)]

    @property
    def root_std(self) -> Array:
        """(3,) m."""
        return self.generated.avatar_deviations[Channels(len(self.joints)).root]

    @property
    def palm_std(self) -> Array:
        """(3,) m."""
        return self.generated.avatar_deviations[Channels(len(self.joints)).palm]

    @property
    def contact_point_std(self) -> Array:
        """(3,) m."""
        return self.generated.avatar_deviations[Channels(len(self.joints)).contact]

    @property
    def hand_std(self) -> Array:
        """(2, 3) m."""
        return self.generated.human_deviations.reshape(2, 3)


class Responder:
    """Answers a person's hand with an avatar's pose, tick by tick.

    The state is a Gaussian belief over the interaction latents (see :mod:`highfive.model.online.belief`).
    """

    def __init__(
        self,
        model: HGPDM,
        style_weights: str | Mapping[str, float] | ArrayLike,
        rate_hz: float = 120.0,
        settings: BeliefSettings = BELIEF,
    ) -> None:
        """Works out what does not change from tick to tick, and compiles: nothing has to wait later.

        Args:
            model: the trained model.
            style_weights: an emotion's name, a mapping of names to weights, or (K,) weights that sum to one.
            rate_hz: ticks per second.
            settings: of the belief.
        """
        if not (math.isfinite(rate_hz) and rate_hz > 0.0):
            raise HighFiveError(f"a rate of {rate_hz} Hz; expected a positive number of ticks per second")
        self._model, self._where = model, model.channels
        self._style = _checked(style_weights, model)
        self._filter, self._inertializer = Filter(model, rate_hz, settings), Inertializer(1.0 / rate_hz)
        answer = None if model.ensemble is None else model.ensemble.arm
        styles = len(model.emotions)
        self._arm = None if model.arm_contact is None else ArmTrack(model.arm_contact, rate_hz, answer, styles)
        self._leading = None if model.task_space is None else Leading(model.task_space, self._where, rate_hz)
        self._intent = None if model.intent is None else Intent(model.intent, rate_hz, self._filter.ticks)
        self.reset()

    @property
    def model(self) -> HGPDM:
        """The model that answers."""
        return self._model

    @property
    def style(self) -> Array:
        """The style weights (K,) of the last answer, on their way to those that were set."""
        return self._belief.style[1]

    def reset(self) -> None:
        """Forgets the person: the next hand seen begins a new interaction."""
        self._belief = self._filter.initial(self._style)
        self._inertializer.reset()
        self._probability: float | None = None
        self._widest = 0.0
        if self._arm is not None:
            self._arm.reset()
        if self._leading is not None:
            self._leading.reset()
        self._forecast_contact = partial(self._forecast_of, self._belief, None)

    def set_style(self, weights: str | Mapping[str, float] | ArrayLike) -> None:
        """Changes the style; the answer moves there smoothly within a few tenths of a second."""
        self._style = _checked(weights, self._model)

    def step(
        self, hand_points: ArrayLike | None, covariance: ArrayLike | None = None, arm: ArmPoints | None = None
    ) -> Response:
        """One tick.

        Args:
            hand_points: (2, 3) m, the person's wrist and knuckle centre in the world, or None where the hand is hidden.
            covariance: (2, 3, 3) m², of the two points; by default 2 mm in each direction.
            arm: elbow, shoulder and head, which tell earlier where and when the palms will meet; None where one of
                them is not known.

        A belief that rounding has spoilt, by points that no hand can have, is given up: the hand begins anew.

        Raises:
            HighFiveError: points or covariance, of hand or arm, have another shape, are not finite or beyond
                :data:`FURTHEST`, or a variance is negative. The state is as before.
        """
        hand = None if hand_points is None else _finite("hand points", hand_points, HAND_SHAPE)
        variance = np.full(HAND_DIMS, HAND_VARIANCE)
        if covariance is not None:
            variance = _finite("hand covariance", covariance, (*HAND_SHAPE, 3)).diagonal(0, 1, 2).reshape(-1)
            if (least := min(variance.tolist())) < 0.0:
                raise HighFiveError(f"a variance of {least:g} m² of the hand points; expected 0 or more")
        if arm is not None and not isinstance(arm, ArmPoints):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise HighFiveError(f"the arm is a {type(arm).__name__}; expected ArmPoints(points, covariance)")
        if arm is not None and self._arm is not None:  # a model that sees the hand alone looks at nothing else
            points = _finite("arm points", arm.points, ARM_SHAPE)
            spread = _finite("arm covariance", arm.covariance, (*ARM_SHAPE, 3))
            if (least := float(spread.diagonal(0, 1, 2).min())) < 0.0:
                raise HighFiveError(f"a variance of {least:g} m² of the arm points; expected 0 or more")
            arm = ArmPoints(points, spread)
        hand = None if hand is None else hand.reshape(HAND_DIMS)
        surer = self._widest > RETURNS * RETURNS * (widest := float(variance.max()))  # a tracker followed it unseen
        changed = self._belief.started and (surer or (hand is None) == (self._belief.away == 0))
        last = None if self._arm is None else self._arm.step(hand, variance, arm)
        told = NO_ARM if self._arm is None else self._arm.pose(last, self._belief.style[1])
        belief, generated = self._filter.step(self._belief, hand, variance, self._style, told, changed)
        if not _usable(belief, generated):
            self.reset()
            changed = False
            last = None
            belief, generated = self._filter.step(self._belief, None, np.full(HAND_DIMS, HAND_VARIANCE), self._style)
        self._belief, self._widest = belief, widest
        if self._intent is not None and belief.away == 0:
            self._probability = self._intent.probability(belief.hands)
        self._forecast_contact = partial(self._forecast_of, belief, last)
        if self._leading is not None:
            found = None
            if hand is not None and math.isfinite(self._leading.time(generated.avatar)):
                found = self._forecast_contact()
                self._forecast_contact = partial(_already, found)
            generated = generated._replace(avatar=self._leading.step(generated.avatar, found))
        # The filter believes at once what it sees of a hand that comes back; the pose gets there without a jerk.
        generated = generated._replace(avatar=self._inertializer.step(generated.avatar, changed))
        forecast_contact = self._forecast_contact
        return self._response(self._belief.latent, self._belief.covariance, generated, forecast_contact, 0.0)

    def skip(self, ticks: int) -> None:
        """Goes on by some ticks in which nothing was heard of the person, at the cost of about one.

        Raises:
            HighFiveError: fewer than none.
        """
        if ticks < 0:
            raise HighFiveError(f"{ticks} ticks cannot be skipped; expected 0 or more")
        self._belief = self._filter.skip(self._belief, ticks)
        if self._arm is not None:
            self._arm.hide(ticks)
        self._forecast_contact = partial(self._forecast_of, self._belief, None)

    def ahead(self, seconds: float) -> Response:
        """The answer some ``seconds`` after the last tick, from what was known then; the state stays as it is.

        Raises:
            HighFiveError: the time is negative or beyond :data:`MAXIMUM_FORECAST`.
        """
        if not 0.0 <= seconds <= MAXIMUM_FORECAST:
            raise HighFiveError(f"an answer in {seconds} s; expected 0 to {MAXIMUM_FORECAST:g} s")
        belief = self._belief
        latent, covariance = belief.latent, belief.covariance
        if belief.started and seconds > 0.0:
            latent, covariance = self._filter.predict(latent, covariance, seconds)
        generated = self._filter.generate(latent, covariance, belief.style[1], belief, seconds)
        if self._leading is not None:
            generated = generated._replace(avatar=self._leading.led(generated.avatar, math.exp(-seconds / _LED)))
        generated = generated._replace(avatar=self._inertializer.ahead(generated.avatar, seconds))

        def forecast_contact(
            known: Callable[[], ContactForecast | None] = self._forecast_contact,
        ) -> ContactForecast | None:
            found = known()
            return None if found is None else found.later(seconds)

        return self._response(latent, covariance, generated, forecast_contact, seconds, belief.covariance)

    def forecast(self, horizon_s: float) -> list[Response]:
        """Responses ahead of the last tick, one each model lag up to ``horizon_s``, if no hand is seen from now on."""
        if not 0.0 < horizon_s <= MAXIMUM_FORECAST:
            raise HighFiveError(f"a forecast of {horizon_s} s; expected more than 0 and at most {MAXIMUM_FORECAST:g} s")
        lag, latent, covariance = self._model.lag, self._belief.latent, self._belief.covariance
        responses: list[Response] = []
        for number in range(1, math.ceil(horizon_s / lag - 1e-9) + 1):
            latent, covariance = self._filter.predict(latent, covariance, lag)
            style = self._belief.style[1]
            generated = self._filter.generate(latent, covariance, style, self._belief, number * lag)
            responses.append(self._response(latent, covariance, generated, lambda: None, number * lag))
        return responses

    def _forecast_of(self, belief: Belief, arm: LastArm | None) -> ContactForecast | None:
        """By the whole arm where all of it is known, else by the hand."""
        hand = None if self._arm is None or arm is None else self._filter.contact_left(belief)
        if self._arm is None or arm is None or hand is None:
            return self._filter.forecast_contact(belief)
        return self._arm.forecast(arm, belief.hands[0, 0, KNUCKLES], self._filter.knuckle_speed(belief), hand)

    def _in_distribution(self, covariance: Array) -> bool:
        return self._filter.deviation(covariance) < self._filter.lost

    def _response(
        self,
        latent: Array,
        covariance: Array,
        generated: Generated,
        forecast_contact: Callable[[], ContactForecast | None],
        ahead: float,
        known: Array | None = None,
    ) -> Response:
        """The response; ``known`` is the covariance of the last tick, where a prediction has widened it."""
        where, dims, mean = self._where, self._model.preset.interaction_dims, generated.avatar
        clock = min(max(float(mean[where.clock]), -CLOCK_LIMIT), CLOCK_LIMIT)
        deviation = float(generated.avatar_deviations[where.clock])
        return Response(
            joints=mean[: where.joints],
            root=mean[where.root],
            palm=mean[where.palm],
            contact_point=mean[where.contact],
            time_to_contact=CLOCK_SCALE * math.atanh(clock),
            time_to_contact_std=CLOCK_SCALE * deviation / (1.0 - clock**2),
            hand=generated.human.reshape(2, 3),
            latent=latent[:dims],
            latent_covariance=covariance[:dims, :dims],
            ahead=ahead,
            in_distribution=self._in_distribution(covariance if known is None else known),
            generated=generated,
            forecast_contact=forecast_contact,
            contact_probability=self._probability,
            places=self._model.places,
        )


def _already(found: ContactForecast | None) -> ContactForecast | None:
    """A forecast that was worked out before."""
    return found


def _finite(what: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.array(values, dtype=float)
    if array.shape != shape:
        order = "wrist, then knuckles" if what.startswith("hand") else "elbow, shoulder, head"
        raise HighFiveError(f"{what} of shape {array.shape}; expected {shape}: {order}")
    largest = _largest(array.reshape(-1))
    if not math.isfinite(largest):
        raise HighFiveError(f"the {what} hold NaN or infinity; pass None while it is hidden")
    if largest > FURTHEST:
        raise HighFiveError(f"the {what} hold {largest:g}; expected metres of a room")
    return array


@compiled_entry
def _largest(values: Array) -> float:
    """The largest magnitude in (N,) numbers; infinite where one is none."""
    largest = 0.0
    for value in values:
        if not math.isfinite(value):
            return math.inf
        largest = max(largest, abs(value))
    return largest


def _usable(belief: Belief, generated: Generated) -> bool:
    """One number that is none spoils a belief."""
    parts = (belief.latent, belief.covariance, belief.hands, belief.residual, generated.avatar, generated.human)
    return all(math.isfinite(_largest(part.reshape(-1))) for part in parts)


def _checked(weights: str | Mapping[str, float] | ArrayLike, model: HGPDM) -> Array:
    return style_weights(weights, model.emotions)

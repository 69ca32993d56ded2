"""A responder for a session, whichever model answers; a model of somebody else's is looked at in every tick."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.style import style_weights
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.arm_track import ArmPoints
from highfive.model.online.contact_forecast import ContactForecast
from highfive.model.online.reaction import (
    OnlineResponder,
    Reaction,
    ReactionModel,
    SimpleReaction,
    hypotheses_of_contact,
    probability_of_contact,
)
from highfive.model.online.responder import Responder
from highfive.model.plugins import PluginError, fault

Value = TypeVar("Value")


@dataclass(frozen=True)
class Patience:
    """How long a plug-in may take in a tick.

    Attributes:
        single_s: s, one step. A garbage collection of a large heap takes some tens of milliseconds; whoever takes
            longer than this leaves the avatar standing.
        window_s: s, over which the median step has to keep to the period of the ticks.
    """

    single_s: float = 0.5
    window_s: float = 1.0


PATIENCE = Patience()


class ContinuousResponder(OnlineResponder, Protocol):
    """A responder that also answers between its steps, and jumps over many of them."""

    def step(
        self, hand_points: Array | None, covariance: Array | None = None, arm: ArmPoints | None = None
    ) -> Reaction:
        """One tick; ``arm`` is what is known of the arm beside the hand."""
        ...

    def ahead(self, seconds: float) -> Reaction:
        """The reaction some ``seconds`` after the last step; the state stays as it is."""
        ...

    def skip(self, ticks: int) -> None:
        """Goes on by some steps in which nothing was heard of the person, at the cost of about one."""
        ...


def open_responder(
    model: HGPDM | ReactionModel,
    style: str | Mapping[str, float] | ArrayLike,
    rate_hz: float,
    patience: Patience | None = PATIENCE,
    clock: Clock = MACHINE,
) -> ContinuousResponder:
    """The model at work in a style, at ``rate_hz`` ticks per second; nothing is left to compile.

    Args:
        model: the model.
        style: an emotion's name, weights by name, or (K,) weights.
        rate_hz: ticks per second.
        patience: how long a model of somebody else's may take; None lets it take its time.
        clock: that the session goes by; in virtual time what a model computes takes none.

    Raises:
        PluginError: a model of somebody else's raises, or answers with arrays of another shape.
        HighFiveError: the model was trained for another skeleton, or the style does not fit it.
    """
    expected = avatar_skeleton().hash
    if model.skeleton_hash != expected:
        raise HighFiveError(
            f"the model is for skeleton {model.skeleton_hash or '(none given)'}, the avatar is {expected}; "
            "train a model on this avatar"
        )
    if isinstance(model, HGPDM):
        return Responder(model, style, rate_hz)
    return _Guarded(model, style_weights(style, model.emotions), rate_hz, patience, clock)


def model_title(model: object) -> str:
    """A model of somebody else's in messages."""
    return f"the model {type(model).__module__}.{type(model).__qualname__}"


def guarded_rest(model: ReactionModel, style: Array) -> tuple[Array, Array]:
    """Root (3,), m, and joints (D,), rad, in which a model waits; checked.

    Raises:
        PluginError: it raises, or gives arrays of another shape.
    """
    title = model_title(model)
    root, joints = _called(title, "rest", lambda: model.rest(style))
    size = 3 * len(avatar_skeleton())
    return _array(title, "rest: root", root, 3), _array(title, "rest: joints", joints, size)


class _Guarded:
    """A plug-in's responder: what it raises, another shape, and taking too long are named in one line."""

    def __init__(
        self, model: ReactionModel, style: Array, rate_hz: float, patience: Patience | None, clock: Clock
    ) -> None:
        self._clock = clock
        self._title, self._emotions, self._patience = model_title(model), model.emotions, patience
        self._period_s, self._joints = 1.0 / rate_hz, 3 * len(avatar_skeleton())
        self._inner = _called(self._title, "start", lambda: model.start(style, rate_hz))
        self._took: deque[float] = deque(maxlen=1 if patience is None else max(3, round(patience.window_s * rate_hz)))
        # What compiles at its first call does so here, and not while somebody waits.
        hand = np.array([[0.6, -0.2, 1.2], [0.6, -0.2, 1.3]])
        for points in (None, hand, hand):
            self._checked(_called(self._title, "step", lambda points=points: self._inner.step(points, None)))
        self.reset()

    @property
    def style(self) -> Array:
        style = _called(self._title, "style", lambda: self._inner.style)
        return _array(self._title, "style", style, len(self._emotions))

    def set_style(self, weights: str | Mapping[str, float] | ArrayLike) -> None:
        checked = style_weights(weights, self._emotions)
        _called(self._title, "set_style", lambda: self._inner.set_style(checked))

    def reset(self) -> None:
        self._took.clear()
        self._last: Reaction | None = None
        _called(self._title, "reset", self._inner.reset)

    def step(
        self, hand_points: Array | None, covariance: Array | None = None, arm: ArmPoints | None = None
    ) -> Reaction:  # which sees the hand alone
        start = self._clock.now()
        reaction = _called(self._title, "step", lambda: self._inner.step(hand_points, covariance))
        self._in_time(1e-9 * (self._clock.now() - start))
        self._checked(reaction)
        self._last = reaction
        return reaction

    def ahead(self, seconds: float) -> Reaction:
        """The last reaction, its times counted from then: nobody knows how the model's poses go on."""
        last = self.step(None) if self._last is None else self._last
        return SimpleReaction(
            last.joints,
            last.root,
            last.palm,
            last.contact_point,
            last.time_to_contact - seconds,
            last.time_to_contact_std,
            None if last.contact is None else last.contact.later(seconds),
            last.in_distribution,
            probability_of_contact(last),
            hypotheses_of_contact(last),
        )

    def skip(self, ticks: int) -> None:
        """One step without a hand: a model of somebody else's takes its own time for each."""
        self.step(None)

    def _in_time(self, took: float) -> None:
        if self._patience is None:
            return
        self._took.append(took)
        if took > self._patience.single_s:
            raise PluginError(
                f"{self._title} took {1e3 * took:.0f} ms for one tick; at most {1e3 * self._patience.single_s:.0f} ms"
            )
        if len(self._took) == self._took.maxlen and (median := float(np.median(self._took))) > self._period_s:
            raise PluginError(
                f"{self._title} is too slow: its median tick takes {1e3 * median:.1f} ms, "
                f"ticks come every {1e3 * self._period_s:.1f} ms"
            )

    def _checked(self, reaction: Reaction) -> None:
        for name, size in (("joints", self._joints), ("root", 3), ("palm", 3), ("contact_point", 3)):
            _array(self._title, name, _called(self._title, name, lambda name=name: getattr(reaction, name)), size)
        clock = _called(self._title, "time_to_contact", lambda: float(reaction.time_to_contact))
        spread = _called(self._title, "time_to_contact_std", lambda: float(reaction.time_to_contact_std))
        if not np.isfinite(clock):
            raise PluginError(f"{self._title}: time_to_contact is {clock}; expected seconds")
        if not (np.isfinite(spread) and spread >= 0.0):
            raise PluginError(f"{self._title}: time_to_contact_std is {spread}; expected seconds, 0 or more")
        contact: Any = _called(self._title, "contact", lambda: reaction.contact)
        if contact is not None and not isinstance(contact, ContactForecast):
            raise PluginError(f"{self._title}: contact is {type(contact).__name__}; expected a ContactForecast or None")
        chance: Any = _called(self._title, "contact_probability", lambda: probability_of_contact(reaction))
        if chance is not None and not (isinstance(chance, float | int) and 0.0 <= chance <= 1.0):
            raise PluginError(f"{self._title}: contact_probability is {chance!r}; expected 0 to 1, or None")
        familiar: Any = _called(self._title, "in_distribution", lambda: reaction.in_distribution)
        if not isinstance(familiar, bool | np.bool_):
            raise PluginError(f"{self._title}: in_distribution is {type(familiar).__name__}; expected True or False")


def _called(title: str, what: str, function: Callable[[], Value]) -> Value:
    try:
        return function()
    except (Exception, SystemExit) as error:
        raise PluginError(f"{title}: {what} raised {fault(error)}") from error


def _array(title: str, what: str, values: ArrayLike, size: int) -> Array:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise PluginError(f"{title}: {what} is {type(values).__name__}, not an array of {size} numbers") from None
    if array.shape != (size,):
        raise PluginError(f"{title}: {what} has shape {array.shape}; expected ({size},)")
    if not np.all(np.isfinite(array)):
        raise PluginError(f"{title}: {what} holds NaN or infinity")
    return array

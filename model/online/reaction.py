"""What a session needs of a model that answers: the points at which a model of your own plugs in.

The hierarchical model (:class:`highfive.model.hgpdm.trained.HGPDM`) answers through
:class:`highfive.model.online.responder.Responder`. Anything else that has these methods is played, recorded, reported
and scored in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike

from highfive.model.geometry.rotations import Array
from highfive.model.gp.mixture import GaussianMixture
from highfive.model.hgpdm.contact_layer import BEGIN, END
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.contact_forecast import ContactForecast


class Reaction(Protocol):
    """What a model answers in a tick; :class:`SimpleReaction` is one to fill in."""

    @property
    def joints(self) -> Array:
        """(D,) rad, rotation vectors relative to the avatar's rest pose."""
        ...

    @property
    def root(self) -> Array:
        """(3,) m, pelvis in the world."""
        ...

    @property
    def palm(self) -> Array:
        """(3,) m, the avatar's palm, as the model has it beside the joints."""
        ...

    @property
    def contact_point(self) -> Array:
        """(3,) m, where the palms will meet, or met last."""
        ...

    @property
    def time_to_contact(self) -> float:
        """Time until then, s; negative after contact."""
        ...

    @property
    def time_to_contact_std(self) -> float:
        """Its standard deviation, s."""
        ...

    @property
    def contact(self) -> ContactForecast | None:
        """Where and when, with a covariance, if the model says how sure it is."""
        ...

    @property
    def in_distribution(self) -> bool:
        """The hand does what hands did in training; otherwise the avatar goes on waiting."""
        ...


@dataclass(frozen=True)
class SimpleReaction:
    """A reaction as a value; the fields are those of :class:`Reaction`."""

    joints: Array
    root: Array
    palm: Array
    contact_point: Array
    time_to_contact: float
    time_to_contact_std: float = 0.05
    contact: ContactForecast | None = None
    in_distribution: bool = True
    contact_probability: float | None = None
    hypotheses: GaussianMixture | None = None


def current_forecast(reaction: Reaction) -> ContactForecast | None:
    """The forecast while a hand approaches by the avatar layer's clock; the contact layer knows nothing else."""
    return reaction.contact if END < reaction.time_to_contact < BEGIN else None


def probability_of_contact(reaction: Reaction) -> float | None:
    """That a contact is coming, 0 to 1, where a model says it as ``contact_probability``; it need not."""
    found: float | None = getattr(reaction, "contact_probability", None)
    return found


def hypotheses_of_contact(reaction: Reaction) -> GaussianMixture | None:
    """Where the palms may meet, m, where a model says it as ``hypotheses``; it need not."""
    found = getattr(reaction, "hypotheses", None)
    return found if isinstance(found, GaussianMixture) and found.points.shape[1:] == (3,) else None


class OnlineResponder(Protocol):
    """A model at work: one hand measurement in, one reaction out."""

    @property
    def style(self) -> Array:
        """(K,) style weights of the last answer."""
        ...

    def set_style(self, weights: str | Mapping[str, float] | ArrayLike) -> None:
        """Changes the style: an emotion's name, weights by name, or (K,) weights."""
        ...

    def reset(self) -> None:
        """A new trial: nobody is there yet."""
        ...

    def step(self, hand_points: Array | None, covariance: Array | None = None) -> Reaction:
        """One tick.

        Args:
            hand_points: (2, 3) m, the person's wrist and knuckle centre in the world; None where the hand is hidden.
            covariance: (2, 3, 3) m², of the two points; None where it is not known.
        """
        ...


class ReactionModel(Protocol):
    """A trained model that is ready to be played."""

    @property
    def emotions(self) -> tuple[str, ...]:
        """K names, the order of the style weights."""
        ...

    @property
    def skeleton_hash(self) -> str:
        """Hash of the skeleton whose joints it gives, :attr:`highfive.model.geometry.skeleton.Skeleton.hash`."""
        ...

    def rest(self, style: Array) -> tuple[Array, Array]:
        """Root (3,), m, and joints (D,), rad, in which an avatar of style weights (K,) waits."""
        ...

    def start(self, style: Array, rate_hz: float) -> OnlineResponder:
        """A responder at ``rate_hz`` ticks per second, with nothing left to compile."""
        ...


FitReactionModel = Callable[[Sequence[Trial]], ReactionModel]
"""Learns a model from training trials; what a plug-in offers in the entry-point group ``highfive.models``."""

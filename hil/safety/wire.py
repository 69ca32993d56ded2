"""The rules for the person, held by what goes on the wire: the reference and what goals lead it by, together.

The body follows the reference where the servos give way as planned, and the goal where nothing loads them: both have
to keep the rules. What breaks them is taken from the offset first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from highfive.hil.safety import people
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.motion import kept_fraction
from highfive.hil.safety.people import Human, Points, Remembered
from highfive.hil.safety.rules import Rule
from highfive.model.geometry.rotations import Array


class Rates(NamedTuple):
    """What moves in a tick.

    Attributes:
        reference: (J,) rad/s.
        offset: (J,) rad/s, of the goals beside the reference.
        closing_speed: m/s, of plate and hand as the goals have it; None where it is not known.
    """

    reference: Array
    offset: Array
    closing_speed: float | None


def within_rules(
    limits: Limits,
    seen: Remembered,
    human: Human | None,
    goals: Points,
    reference: Array,
    offset: Array,
    bounds: tuple[Array, Array],
    dt: float,
) -> tuple[Rates, set[Rule]]:
    """Rates (J,), rad/s, of reference and offset with which the goals keep the rules for hand and face.

    Args:
        limits: all of them.
        seen: what is known of the person.
        human: the person; None where nobody knows where they are: then only the offset has to be slow, since the
            reference may be braking.
        goals: the arm's points if the joints were where the goals are.
        reference: (J,) rad/s, which keeps the rules by itself.
        offset: (J,) rad/s.
        bounds: (J,) rad/s each, lowest and highest rates of the offset.
        dt: s, of the tick.
    """
    if human is None:
        fraction = people.unseen_fraction(limits, goals.jacobians * (reference + offset))
        # A reference that brakes may still be faster by itself: then goals lead it by no more than before.
        return Rates(reference, fraction * offset if fraction == 1.0 else 0.0 * offset, None), (
            {Rule.FEED_FORWARD} if fraction < 1.0 else set()
        )
    limited, closing = people.limit_closing_speed(limits.contact, seen, human, goals, reference + offset, dt)
    excess = reference + offset - limited
    if too_fast := bool(excess.any()):
        if seen.line is None or human.palm is None or human.palm_velocity is None:  # all of it is slower
            fraction = kept_fraction(reference + offset, limited)
            reference, offset = fraction * reference, fraction * offset
        else:
            offset = np.clip(offset - _part_along(excess, offset), *bounds)
            reference = limited - offset
    fraction, closing, _ = people.points_fraction(limits, seen, human, goals, reference + offset, closing, dt)
    acted: set[Rule] = {Rule.FEED_FORWARD} if too_fast or fraction < 1.0 else set()
    return Rates(fraction * reference, fraction * offset, closing), acted


def _part_along(excess: Array, offset: Array) -> Array:
    """What of the ``excess`` (J,), rad/s, the ``offset`` (J,), rad/s, adds to it."""
    size = float(np.linalg.norm(excess))
    direction = excess / size
    return min(max(float(direction @ offset), 0.0), size) * direction

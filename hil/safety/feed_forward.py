"""How far goals go beyond where the joints shall be, because a loaded servo stands off its goal.

Gravity compensation by position: the goal leads the reference by compliance times torque. The offset has rules of its
own, and what the reference itself leaves of the joints' limits; :mod:`highfive.hil.safety.envelope` holds the sum of
both to the rules for the person.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.hil.safety.limits import Limits
from highfive.hil.safety.motion import NO_TIME, Motion
from highfive.model.geometry.rotations import Array

RISE_S = 0.03
"""Time constant with which the offset follows its request, s: planned torques jump, goals must not."""


@dataclass(frozen=True)
class FeedForward:
    """The offset of the goals from the reference.

    Attributes:
        offsets: (J,) rad.
        rates: (J,) rad/s, with which they came there.
    """

    offsets: Array
    rates: Array


def no_lead(joints: int) -> FeedForward:
    """Goals that do not lead."""
    return FeedForward(np.zeros(joints), np.zeros(joints))


def next_rates(
    limits: Limits,
    before: FeedForward,
    requested: Array | None,
    reference: Motion,
    velocities: Array,
    within: tuple[Array, Array],
    dt: float,
) -> Array:
    """Rates (J,), rad/s, of the offset in a tick of ``dt`` s in which the reference moves with ``velocities``.

    With what the reference (J,), rad/s, does by itself, the goal stays inside the speed and acceleration limits of the
    joints, and the offset ``within`` its :func:`bounds` there. An offset that nobody requests (None) stays.
    """
    if dt <= 0.0:
        return np.zeros_like(before.rates)
    own, most = limits.feed_forward, limits.acceleration
    target = before.offsets if requested is None else np.clip(requested, -own.largest, own.largest)
    accelerations = (velocities - reference.velocities) / dt
    displacement = target - before.offsets
    distance = np.abs(displacement)
    braking = np.sqrt(dt**2 + 2.0 * distance / own.acceleration)  # as motion.braking_speed: no overshoot
    fastest = np.minimum(np.minimum(distance / RISE_S, 2.0 * distance / (dt + braking)), own.speed)
    rates = np.sign(displacement) * fastest
    down = np.clip(-most - accelerations, -own.acceleration, 0.0)
    up = np.clip(most - accelerations, 0.0, own.acceleration)
    rates = before.rates + np.clip(rates - before.rates, dt * down, dt * up)
    rates = np.clip(rates, np.minimum(-limits.speed - velocities, 0.0), np.maximum(limits.speed - velocities, 0.0))
    return np.clip(rates, *within)


def bounds(limits: Limits, before: FeedForward, reference: Array, dt: float) -> tuple[Array, Array]:
    """Lowest and highest rates (J,), rad/s, with which the offset stays within its limit, and the goal within the
    joints' range about the ``reference`` (J,), rad, after a tick of ``dt`` s.

    Where a joint's stop, or the largest offset, is near, position comes before acceleration.
    """
    most = limits.feed_forward.largest
    low = np.maximum(np.minimum(limits.lowest - reference, 0.0), -most)
    high = np.minimum(np.maximum(limits.highest - reference, 0.0), most)
    return (low - before.offsets) / max(dt, NO_TIME), (high - before.offsets) / max(dt, NO_TIME)


def moved(limits: Limits, before: FeedForward, rates: Array, reference: Array, dt: float) -> FeedForward:
    """The offset after a tick of ``dt`` s, about the ``reference`` (J,), rad, as it is then."""
    kept = np.clip(rates, *bounds(limits, before, reference, dt))
    return FeedForward(before.offsets + dt * kept, kept)

"""What a joint may be told next: towards what is wanted of it, within position, speed and acceleration.

In every tick the joints have a commanded position q and velocity v. The next velocity v' is chosen, and q' = q + v' dt
is sent. A joint is *viable* if it can still brake inside its limits: v² / (2 a) ≤ room, the distance to the limit it
moves towards. The bounds below keep it so: from a viable joint, v' = v - a dt (or 0) is within them, whatever dt is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hil.safety.limits import Limits
from hil.safety.rules import Rule
from model.rotations import Array

SAME = 1e-9
"""rad/s: velocities that differ by less are the same."""


@dataclass(frozen=True)
class Motion:
    """Where the joints were last told to be.

    Attributes:
        positions: (J,) rad, as sent.
        velocities: (J,) rad/s, with which they came there.
        wanted: (J,) rad, where they were wanted then; None where nothing was.
    """

    positions: Array
    velocities: Array
    wanted: Array | None = None


def at_rest(positions: Array) -> Motion:
    """Joints that stand where they are."""
    return Motion(positions, np.zeros_like(positions))


def braking_speed(room: Array, acceleration: Array, dt: float) -> Array:
    """Largest speed, rad/s, for this tick with which there is room to brake afterwards.

    That is the root of v dt + v² / (2 a) = room. Braking by a dt a tick takes less way than v² / (2 a): the sum of
    falling speeds, each taken at its tick's end, is below their integral.

    Args:
        room: (J,) rad; where it is negative the answer is 0.
        acceleration: (J,) rad/s².
        dt: s.
    """
    room = np.maximum(room, 0.0)
    # not a (√(dt² + 2 room / a) - dt), which loses its digits where there is little room; the tiny number is for dt = 0
    return 2.0 * room / (dt + np.sqrt(dt * dt + 2.0 * room / acceleration) + 1e-300)


def position_wanted(limits: Limits, wanted: Array) -> tuple[Array, set[Rule]]:
    """What is wanted, (J,) rad, brought within the limits of position."""
    within = np.minimum(np.maximum(wanted, limits.lowest), limits.highest)
    return within, {Rule.POSITION} if (within != wanted).any() else set()


def towards(limits: Limits, motion: Motion, wanted: Array, dt: float) -> tuple[Array, set[Rule]]:
    """Velocities (J,), rad/s, that bring the joints to where they are wanted and along with it.

    Joints that are where they were wanted go on exactly as they are wanted. Where one is behind, all make up for it in
    step, none faster than :attr:`hil.safety.limits.Motion.catch_up`, and so that each can brake when it is there.
    """
    before = motion.wanted if motion.wanted is not None else wanted
    pace = np.minimum(np.maximum((wanted - before) / max(dt, 1e-6), -limits.speed), limits.speed)
    behind = wanted - pace * dt - motion.positions
    distance = np.abs(behind) + 1e-300
    rate = float((braking_speed(distance, limits.acceleration, dt) / distance).min())
    slower = min(rate, limits.motion.catch_up / float(distance.max()))
    return pace + slower * behind, {Rule.CATCH_UP} if slower < rate else set()


def within_limits(limits: Limits, motion: Motion, velocities: Array, dt: float) -> tuple[Array, set[Rule]]:
    """The velocities (J,), rad/s, nearest to those asked for that acceleration, speed and position allow."""
    acted = set()
    step = limits.acceleration * dt
    result = np.minimum(np.maximum(velocities, motion.velocities - step), motion.velocities + step)
    if np.abs(result - velocities).max() > SAME:
        acted.add(Rule.ACCELERATION)
    slower = np.minimum(np.maximum(result, -limits.speed), limits.speed)
    if np.abs(result - slower).max() > SAME:
        acted.add(Rule.SPEED)
    up = braking_speed(limits.highest - motion.positions, limits.acceleration, dt)
    down = braking_speed(motion.positions - limits.lowest, limits.acceleration, dt)
    result = np.minimum(np.maximum(slower, -down), up)
    if np.abs(result - slower).max() > SAME:
        acted.add(Rule.POSITION)
    return result, acted


def moved(motion: Motion, velocities: Array, wanted: Array | None, dt: float) -> Motion:
    """The joints after a tick of dt s with these velocities (J,), rad/s."""
    return Motion(motion.positions + velocities * dt, velocities, wanted)

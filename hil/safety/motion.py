"""What a joint may be commanded next: towards what is requested of it, within position, speed and acceleration.

In every tick the joints have a commanded position q and velocity v. The next velocity v' is chosen, and q' = q + v' dt
is sent. A joint is *viable* if it can still brake inside its limits: v² / (2 b) ≤ room, the distance to the limit it
moves towards. The bounds below keep it so: from a viable joint, v' = v - b dt (or 0) is within them, whatever dt is,
since b is no more than the acceleration that bounds the change of v.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from highfive.hil.safety.limits import Limits
from highfive.hil.safety.rules import Rule
from highfive.model.geometry.rotations import Array

SAME = 1e-9
"""rad/s: velocities that differ by less are the same."""

NO_TIME = 1e-6
"""s: shorter ticks are taken for as long, where something is divided by them."""


@dataclass(frozen=True)
class Motion:
    """Where the joints were last commanded to be: the reference.

    Attributes:
        positions: (J,) rad, as sent.
        velocities: (J,) rad/s, with which they came there.
        target: (J,) rad, what was requested then, within the limits of position; None where nothing was.
    """

    positions: Array
    velocities: Array
    target: Array | None = None


def at_rest(positions: Array) -> Motion:
    """Joints that stand where they are."""
    return Motion(positions, np.zeros_like(positions))


def braking_speed(room: float, braking: float, dt: float) -> float:
    """Largest speed, rad/s, for this tick with which there is room to brake afterwards.

    That is the root of v dt + v² / (2 b) = room. Braking by b dt per tick takes less distance than v² / (2 b): the sum
    of falling speeds, each taken at its tick's end, is below their integral.

    Args:
        room: rad; where it is not positive the answer is 0.
        braking: rad/s², b.
        dt: s.
    """
    if room <= 0.0:
        return 0.0
    # not b (√(dt² + 2 room / b) - dt), which loses its digits where there is little room
    return 2.0 * room / (dt + math.sqrt(dt * dt + 2.0 * room / braking))


def target_position(limits: Limits, requested: Array) -> tuple[Array, set[Rule]]:
    """What is ``requested``, (J,) rad, brought within the limits of position."""
    values = requested.tolist()
    within = [clamp(q, joint.lowest, joint.highest) for joint, q in zip(limits.joints, values, strict=True)]
    return np.array(within), {Rule.POSITION} if within != values else set()


def towards(limits: Limits, reference: Motion, target: Array, dt: float) -> tuple[Array, set[Rule]]:
    """Velocities (J,), rad/s, that bring the joints to the ``target`` (J,), rad, and along with it.

    Joints that are at the target of the tick before go on exactly as the target does. Where one is behind, all make up
    for it in step, none faster than :attr:`highfive.hil.safety.limits.Motion.catch_up`, and so that each can brake when
    it is there.
    """
    before = reference.target if reference.target is not None else target
    paces: list[float] = []
    behind: list[float] = []
    rate, furthest = 1.0 / max(dt, NO_TIME), 0.0
    for joint, goal, last, q in zip(
        limits.joints, target.tolist(), before.tolist(), reference.positions.tolist(), strict=True
    ):
        pace = clamp((goal - last) / max(dt, NO_TIME), -joint.speed, joint.speed)
        displacement = goal - pace * dt - q
        if displacement:
            rate = min(rate, braking_speed(abs(displacement), joint.braking, dt) / abs(displacement))
            furthest = max(furthest, abs(displacement))
        paces.append(pace)
        behind.append(displacement)
    slower = min(rate, limits.motion.catch_up / furthest) if furthest else rate
    velocities = [pace + slower * displacement for pace, displacement in zip(paces, behind, strict=True)]
    return np.array(velocities), {Rule.CATCH_UP} if slower < rate else set()


def braked(limits: Limits, reference: Motion, dt: float) -> Array:
    """Velocities (J,), rad/s, a tick of dt s nearer to standing still."""
    change = limits.braking * dt
    return reference.velocities - np.minimum(np.maximum(reference.velocities, -change), change)


def within_limits(limits: Limits, reference: Motion, velocities: Array, dt: float) -> tuple[Array, set[Rule]]:
    """The velocities (J,), rad/s, nearest to those requested that acceleration, speed and position allow."""
    results: list[float] = []
    acted: set[Rule] = set()
    for joint, q, v, requested in zip(
        limits.joints, reference.positions.tolist(), reference.velocities.tolist(), velocities.tolist(), strict=True
    ):
        step = joint.acceleration * dt
        reached = clamp(requested, v - step, v + step)
        slower = clamp(reached, -joint.speed, joint.speed)
        up = braking_speed(joint.highest - q, joint.braking, dt)
        down = braking_speed(q - joint.lowest, joint.braking, dt)
        result = clamp(slower, -down, up)
        if result != requested:
            acted |= {Rule.ACCELERATION} if abs(reached - requested) > SAME else set()
            acted |= {Rule.SPEED} if abs(slower - reached) > SAME else set()
            acted |= {Rule.POSITION} if abs(result - slower) > SAME else set()
        results.append(result)
    return np.array(results), acted


def fraction_within(limits: Limits, reference: Motion, velocities: Array, dt: float) -> float:
    """Largest fraction, 0 to 1, of velocities (J,), rad/s, that keeps every joint's speed, and its room to brake."""
    fraction = 1.0
    for joint, q, v in zip(limits.joints, reference.positions.tolist(), velocities.tolist(), strict=True):
        room = joint.highest - q if v > 0.0 else q - joint.lowest
        most = min(joint.speed, braking_speed(room, joint.braking, dt))
        if abs(v) > most:
            fraction = min(fraction, most / abs(v))
    return fraction


def kept_fraction(whole: Array, kept: Array) -> float:
    """How much of the speed (J,), rad/s, of the ``whole`` is left in what is ``kept``; 1 where there was none."""
    before = float(np.linalg.norm(whole))
    return min(1.0, float(np.linalg.norm(kept)) / before) if before > 0.0 else 1.0


def moved(reference: Motion, velocities: Array, target: Array | None, dt: float) -> Motion:
    """The joints after a tick of dt s with these velocities (J,), rad/s."""
    return Motion(reference.positions + velocities * dt, velocities, target)


def clamp(value: float, least: float, most: float) -> float:
    """The nearest value between two others."""
    return least if value < least else most if value > most else value

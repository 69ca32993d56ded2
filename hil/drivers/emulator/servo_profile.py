"""The profile generator of a servo: on which course it goes from where it is to its goal. Pure.

Source: the maker's manual, "What is the Profile": without a profile velocity a step; without an acceleration a
rectangle of velocity; otherwise a trapezoid, or a triangle where the way is too short to reach the profile velocity. A
new goal begins at the velocity that the course before it has reached.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SHORTEST = 1e-3
"""s, the unit in which time-based profiles count."""

STEP, RECTANGLE, TRIANGLE, TRAPEZOID = 0, 1, 2, 3
"""Kinds, as the register "moving status" names them in its bits 4 and 5."""


@dataclass(frozen=True)
class Profile:
    """A course of constant accelerations, one after another, and constant velocity after the last.

    Attributes:
        kind: one of :data:`STEP`, :data:`RECTANGLE`, :data:`TRIANGLE`, :data:`TRAPEZOID`.
        start: rad, at time 0.
        velocity: rad/s, at time 0.
        phases: (duration s, acceleration rad/s²) each.
        goal: rad, where it ends; None where it goes on for ever.
    """

    kind: int
    start: float
    velocity: float
    phases: tuple[tuple[float, float], ...]
    goal: float | None

    @property
    def duration(self) -> float:
        """s until it is at its goal, or its last velocity."""
        return sum(duration for duration, _ in self.phases)

    def at(self, time: float) -> tuple[float, float]:
        """Position, rad, and velocity, rad/s, ``time`` s after its start."""
        position, velocity = self.start, self.velocity
        for duration, acceleration in self.phases:
            step = min(time, duration)
            position += velocity * step + 0.5 * acceleration * step * step
            velocity += acceleration * step
            time -= step
            if time <= 0.0:
                return position, velocity
        if self.goal is not None:
            return self.goal, 0.0
        return position + velocity * time, velocity


def to_position(
    start: float, velocity: float, goal: float, fastest: float, acceleration: float, *, timed: bool = False
) -> Profile:
    """The course to a position.

    Args:
        start: rad.
        velocity: rad/s, at the start.
        goal: rad.
        fastest: rad/s, the profile velocity, or s, the whole time where ``timed``; 0 for a step.
        acceleration: rad/s², or s of accelerating where ``timed``; 0 for a rectangle.
        timed: the drive mode asks for a time-based profile.
    """
    way = goal - start
    if fastest <= 0.0:
        return Profile(STEP, start, velocity, (), goal)
    if timed:
        return _timed(start, velocity, goal, fastest, min(acceleration, fastest / 2.0))
    if acceleration <= 0.0:
        return Profile(RECTANGLE, start, math.copysign(fastest, way), ((abs(way) / fastest, 0.0),), goal)
    # Seen along the way, so that what is left after stopping from the first velocity lies ahead.
    sign = math.copysign(1.0, way - velocity * abs(velocity) / (2.0 * acceleration))
    way, first = sign * way, sign * velocity
    peak = math.sqrt(max(0.0, acceleration * way + first * first / 2.0))
    kind = TRIANGLE if peak < fastest else TRAPEZOID
    peak = min(peak, fastest)
    push = math.copysign(acceleration, peak - first)
    speeding = (peak - first) / push
    braking = peak / acceleration
    cruise = way - (peak * peak - first * first) / (2.0 * push) - peak * peak / (2.0 * acceleration)
    phases = ((speeding, sign * push), (max(0.0, cruise) / peak if peak else 0.0, 0.0), (braking, -sign * acceleration))
    return Profile(kind, start, velocity, phases, goal)


def _timed(start: float, velocity: float, goal: float, whole: float, speeding: float) -> Profile:
    """Accelerating, cruising and braking so that all three take ``whole`` s, the first and the last ``speeding`` s."""
    if speeding < 0.5 * SHORTEST:
        return Profile(RECTANGLE, start, (goal - start) / whole, ((whole, 0.0),), goal)
    peak = (goal - start - velocity * speeding / 2.0) / (whole - speeding)
    cruise = whole - 2.0 * speeding
    phases = ((speeding, (peak - velocity) / speeding), (cruise, 0.0), (speeding, -peak / speeding))
    return Profile(TRAPEZOID if cruise > 0.0 else TRIANGLE, start, velocity, phases, goal)


def to_velocity(start: float, velocity: float, goal: float, acceleration: float, *, timed: bool = False) -> Profile:
    """The course to a velocity, rad/s, which goes on; ``acceleration`` as in :func:`to_position`, 0 for at once."""
    if acceleration <= 0.0:
        return Profile(STEP, start, goal, (), None)
    taking = acceleration if timed else abs(goal - velocity) / acceleration
    if taking <= 0.0:
        return Profile(STEP, start, goal, (), None)
    return Profile(TRAPEZOID, start, velocity, ((taking, (goal - velocity) / taking),), None)

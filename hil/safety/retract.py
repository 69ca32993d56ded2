"""The way back: slowly along a path that is known to be safe, to where the arm rests."""

from __future__ import annotations

import numpy as np

from highfive.hil.safety.limits import Limits
from highfive.hil.safety.motion import Motion, braking_speed
from highfive.model.geometry.rotations import Array

ARRIVED = 0.01
"""rad: a way point nearer than this is reached."""

STANDS = 1e-3
"""rad/s: a joint slower than this stands."""


def nearest(limits: Limits, positions: Array) -> int:
    """The way point nearest to the joints (J,), rad, by the joint that is furthest from it."""
    return int(np.abs(limits.way_points - positions).max(axis=1).argmin())


def retracting(limits: Limits, reference: Motion, way_point: int, dt: float) -> tuple[Array, int]:
    """Velocities (J,), rad/s, towards the next way point, all joints in step; and which one that is."""
    displacement = limits.way_points[way_point] - reference.positions
    if np.abs(displacement).max() < ARRIVED and way_point + 1 < len(limits.way_points):
        way_point += 1
        displacement = limits.way_points[way_point] - reference.positions
    longest = float(np.abs(displacement).max())
    braking = min(braking_speed(longest, joint.braking, dt) for joint in limits.joints)
    speed = min(limits.motion.retract, braking)
    return displacement * (speed / max(longest, 1e-9)), way_point


def rests(limits: Limits, reference: Motion, way_point: int) -> bool:
    """The arm is at the end of the path, and stands."""
    if way_point + 1 < len(limits.way_points) or np.abs(reference.velocities).max() > STANDS:
        return False
    return bool(np.abs(limits.way_points[-1] - reference.positions).max() < ARRIVED)

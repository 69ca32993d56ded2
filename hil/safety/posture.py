"""Whether the arm can stand where its servos say that it stands: a zero that was lost makes them claim what cannot be.

An arm at rest is in balance: what gravity asks of a joint is given by its servos, by friction, by its stop, or by what
the arm lies on.
"""

from __future__ import annotations

import numpy as np

from highfive.hil.drivers.values import JointState
from highfive.hil.safety.limits import Limits
from highfive.model.geometry.rotations import Array

STANDS = 0.05
"""rad/s: an arm whose joints are slower stands."""

_WHY = "a zero is lost (homing offset, slipped horn), or something holds or pushes the arm"


def posture_mismatches(
    limits: Limits, arm: JointState, gravity: Array, strength: Array, given: Array, clearance: float, *, held: bool
) -> tuple[str, ...]:
    """What speaks against the posture that the servos claim, a line each; nothing if it can be.

    Args:
        limits: all of them.
        arm: what the servos say.
        gravity: (J,) N·m, that the joints need to stand still there, by the model of the arm.
        strength: (J,) N·m, stall torques of the joints' servos.
        given: (J,) N·m, that their currents make.
        clearance: m between the arm there and floor, mount and itself; negative where it goes through them.
        held: the arm may be held in the pose in which it rests, by a hand or a stand.
    """
    own, positions = limits.posture, arm.positions
    names, (low, high) = limits.names, np.array(limits.ceilings.mechanical).T
    lines = [
        f"{names[joint]} says {np.degrees(positions[joint]):.0f}°, beyond its stops "
        f"({np.degrees(low[joint]):.0f} to {np.degrees(high[joint]):.0f}°): its zero is lost"
        for joint in np.flatnonzero((positions < low - own.stop) | (positions > high + own.stop))
    ]
    if clearance < -own.through:
        lines.append(f"the joints say that the arm is {-1e3 * clearance:.0f} mm inside floor, mount or itself: {_WHY}")
    if lines:
        return tuple(lines)
    if np.abs(arm.velocities).max() > STANDS:
        return ("the arm moves; let it come to rest",)
    if clearance < own.touch or (held and np.abs(positions - limits.way_points[-1]).max() < own.rest):
        return ()
    missing = gravity - given
    stopped = ((positions > high - own.stop) & (missing < 0.0)) | ((positions < low + own.stop) & (missing > 0.0))
    off = (np.abs(missing) > own.friction * strength + own.model * np.abs(gravity)) & ~stopped
    return tuple(
        f"{names[joint]}: where it says that it is, at {np.degrees(positions[joint]):.0f}°, gravity asks for "
        f"{gravity[joint]:.1f} N·m, and its servos give {given[joint]:.1f}: {_WHY}"
        for joint in np.flatnonzero(off)
    )

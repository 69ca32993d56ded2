"""What a joint's friction takes: torques over one range of angles, up and down at one speed."""

from __future__ import annotations

import numpy as np

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

FEWEST = 30
"""Samples either way."""
STEADY = 0.3
"""Share of the commanded speed by which a sample's may differ: at the turns it tells nothing."""


def friction_torque(angles: Array, speeds: Array, torques: Array, speed: float) -> float:
    """N·m, that friction takes at a joint's ``speed``: half of what lies between the torques up and down.

    What depends on the angle alone (gravity and its errors) cancels: it is fitted with them, to the second power.

    Args:
        angles, speeds: (N,) rad and rad/s.
        torques: (N,) N·m, that the servos gave.
        speed: rad/s, at which it was led both ways.

    Raises:
        HighFiveError: too few samples of steady motion either way.
    """
    steady = np.abs(np.abs(speeds) - speed) < STEADY * speed
    up, down = steady & (speeds > 0.0), steady & (speeds < 0.0)
    if min(up.sum(), down.sum()) < FEWEST:
        raise HighFiveError(
            f"{up.sum()} samples of steady motion up and {down.sum()} down, at least {FEWEST} of each; does it stick?"
        )
    at = angles[steady] - np.mean(angles[steady])
    columns = np.stack([np.ones_like(at), at, at**2, np.sign(speeds[steady])], axis=1)
    return float(np.linalg.lstsq(columns, torques[steady], rcond=None)[0][3])

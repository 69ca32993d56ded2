"""Where shoulders and elbows may be, of somebody of whom only head and hands are seen.

The shoulder hangs below the neck, which the head turns about; the trunk looks where the head looks, on the level. The
elbow follows from shoulder, wrist and the lengths of the bones (two-bone inverse kinematics), down and to the side.
Against simulated people with a raised hand the shoulder is 6 cm off, the elbow 9 (medians): good enough to draw an arm,
and to keep a tracker's arm where arms are, if it is told how little that says.
"""

from __future__ import annotations

import math

import numpy as np

from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

EYE_HEIGHT = 1.674
"""m, of the body to which the lengths below belong; people are scaled by it."""
SIZES = (0.75, 1.25)
"""Smallest and largest person: who sits or bends down is not taken for a child."""
NECK_FROM_EYES = np.array([-0.09, 0.0, -0.09])
"""(3,) m, in the head's frame (x forward, y left, z up): what the head turns about."""
SHOULDER_FROM_NECK = np.array([-0.018, 0.187, -0.1575])
"""(3,) m, of the left one, in the trunk's frame."""
UPPER_ARM, FOREARM = 0.3255, 0.2555
OUTWARD = 0.45
"""How far the elbow points to the side, over how far it points down."""


def shoulder_of(eyes: Array, forward: Array, up: Array, side: str, size: float) -> Array:
    """A shoulder's centre (3,), m.

    Args:
        eyes: (3,) m, the point between them, in a world with z up.
        forward, up: (3,) unit vectors of the head.
        side: ``left`` or ``right``.
        size: of the person, over that of the body described here.
    """
    left = np.cross(up, forward)
    neck = eyes + size * (np.stack([forward, left, up], axis=1) @ NECK_FROM_EYES)
    # Who looks straight up or down shows by the top of the head where the trunk faces.
    ahead = forward if abs(forward[2]) < 0.9 else -np.sign(forward[2]) * up
    trunk = rotations.from_axis_angle("z", math.atan2(ahead[1], ahead[0]))
    offset = SHOULDER_FROM_NECK * np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])
    return neck + size * rotations.rotate(trunk, offset)


def elbow_of(shoulder: Array, wrist: Array, side: str, forward: Array, size: float) -> Array:
    """An elbow's centre (3,), m: on the circle that bones of that length leave it, down and to the side.

    Args:
        shoulder, wrist: (3,) m.
        side: ``left`` or ``right``.
        forward: (3,) unit vector of the head.
        size: see :func:`shoulder_of`.
    """
    along = wrist - shoulder
    distance = float(np.linalg.norm(along))
    upper, fore = size * UPPER_ARM, size * FOREARM
    if distance < 1e-6:
        return shoulder - np.array([0.0, 0.0, upper])
    along = along / distance
    reached = min(max(distance, abs(upper - fore) + 1e-6), upper + fore)
    middle = (reached**2 + upper**2 - fore**2) / (2.0 * reached)
    aside = math.sqrt(max(upper**2 - middle**2, 0.0))
    leftward = np.array([-forward[1], forward[0], 0.0])
    pole = np.array([0.0, 0.0, -1.0]) + (OUTWARD if side == "left" else -OUTWARD) * leftward
    pole = pole - (pole @ along) * along
    return shoulder + middle * along + aside * pole / max(float(np.linalg.norm(pole)), 1e-6)

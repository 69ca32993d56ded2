"""Turns of one direction, compiled: what :mod:`highfive.model.geometry.rotations` does with three numbers at a time."""

from __future__ import annotations

import math

import numpy as np

from highfive.model.compiled import compiled_entry
from highfive.model.geometry.rotations import Array


@compiled_entry
def turned(turn: Array, vector: Array) -> Array:
    """A vector (3,), turned by a rotation vector (3,), rad."""
    half = 0.5 * math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    scale = 0.5 * math.sin(half) / half if half > 1e-12 else 0.5
    w, (x, y, z), (a, b, c) = math.cos(half), scale * turn, vector
    i, j, k = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return np.array([a + w * i + y * k - z * j, b + w * j + z * i - x * k, c + w * k + x * j - y * i])


@compiled_entry
def turn_between(one: Array, other: Array) -> Array:
    """Rotation vector (3,), rad, of the smallest turn of a unit vector (3,) into another.

    Where they are opposite, half a turn about any axis across.
    """
    (a, b, c), (d, e, f) = one, other
    w = 1.0 + a * d + b * e + c * f
    x, y, z = b * f - c * e, c * d - a * f, a * e - b * d
    if w < 1e-9:
        w = 0.0
        x, y, z = (0.0, c, -b) if abs(a) < 0.6 else (-c, 0.0, a)
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 1e-9 * w else 2.0 / w
    return np.array([scale * x, scale * y, scale * z])

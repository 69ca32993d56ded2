"""Hinge angles of one pose, compiled: fifty-odd joints take NumPy a dozen calls on small arrays."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from highfive.model.compiled import exactly_compiled_entry
from highfive.model.geometry.rotations import Array

SMALL = 1e-12
"""rad: below half of this angle the sine is taken for its argument."""


@exactly_compiled_entry
def hinges_within(
    vectors: Array, rest: Array, axes: NDArray[np.int64], sign: Array, middle: Array, limits: Array
) -> Array:
    """Hinge angles (J, 3), rad, inside the limits, of rotation vectors (J, 3), rad, relative to the rest pose.

    What :meth:`highfive.model.geometry.skeleton.Skeleton.to_hinges` makes of ``from_rotation_vectors``, clamped.

    Args:
        vectors: (J, 3) rad.
        rest: (J, 4) quaternions of the rest pose.
        axes: (J, 3) which component of a quaternion's vector part belongs to each hinge.
        sign: (J,) of the permutation that the hinges are of x, y, z.
        middle: (J, 3) rad, of the limits: each angle is taken in the turn nearest to it.
        limits: (J, 3, 2) rad.
    """
    count = len(vectors)
    angles, turned = np.empty((count, 3)), np.empty(3)
    for n in range(count):
        x, y, z = vectors[n, 0], vectors[n, 1], vectors[n, 2]
        half = 0.5 * math.sqrt(x * x + y * y + z * z)
        scale = 0.5 * math.sin(half) / half if half > SMALL else 0.5
        w, x, y, z = math.cos(half), scale * x, scale * y, scale * z
        a, b, c, d = rest[n, 0], rest[n, 1], rest[n, 2], rest[n, 3]
        turned[0] = a * x + b * w + c * z - d * y
        turned[1] = a * y - b * z + c * w + d * x
        turned[2] = a * z + b * y - c * x + d * w
        s = sign[n]
        w = s * (a * w - b * x - c * y - d * z)
        i, j, k = turned[axes[n, 0]], turned[axes[n, 1]], turned[axes[n, 2]]
        angles[n, 0] = math.atan2(2.0 * (w * i - j * k) * s, 1.0 - 2.0 * (i * i + j * j))
        angles[n, 1] = math.asin(min(max(2.0 * (i * k + w * j) * s, -1.0), 1.0))
        angles[n, 2] = math.atan2(2.0 * (w * k - i * j) * s, 1.0 - 2.0 * (j * j + k * k))
        for h in range(3):
            turns = round((angles[n, h] - middle[n, h]) / (2.0 * math.pi))
            angle = angles[n, h] - 2.0 * math.pi * turns
            angles[n, h] = min(max(angle, limits[n, h, 0]), limits[n, h, 1])
    return angles


@exactly_compiled_entry
def hinges_between(one: Array, other: Array, share: float, limits: Array) -> Array:
    """``share`` of the way from hinge angles (J, 3), rad, to others, inside the limits (J, 3, 2)."""
    angles = np.empty_like(one)
    for n in range(len(one)):
        for h in range(3):
            angle = one[n, h] + share * (other[n, h] - one[n, h])
            angles[n, h] = min(max(angle, limits[n, h, 0]), limits[n, h, 1])
    return angles


@exactly_compiled_entry
def hinges_towards(one: Array, other: Array, largest: float) -> Array:
    """From hinge angles (J, 3), rad, to others, no hinge by more than ``largest``, rad."""
    angles = np.empty_like(one)
    for n in range(len(one)):
        for h in range(3):
            angles[n, h] = one[n, h] + min(max(other[n, h] - one[n, h], -largest), largest)
    return angles

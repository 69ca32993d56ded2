"""The joints that carry the avatar's palm: where it is, how each moves it, and how they bring it elsewhere."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton
from highfive.model.linear_algebra import cholesky, cholesky_solve, product

STEPS = 2  # Gauss–Newton steps of `brought`; after two, 20 cm are met to some millimetres


class ArmChain(NamedTuple):
    """The joints from the pelvis to the right wrist, and the palm.

    Attributes:
        joints: (n,) their indices in the skeleton.
        offsets: (n, 3) m, of each from the one before, in the zero pose; the first is not read.
        rest: (n, 3, 3) rotations to which the rotation vectors are relative.
        palm: (3,) m, in the frame of the wrist.
    """

    joints: NDArray[np.int64]
    offsets: Array
    rest: Array
    palm: Array


def arm_chain(skeleton: Skeleton, palm_in_wrist: Array) -> ArmChain:
    """The chain of a skeleton's right arm."""
    joints, arm = skeleton.chain_to("right_wrist")
    rest = np.stack([rotations.rotate(arm.rest, axis) for axis in np.eye(3)], axis=-1)
    return ArmChain(
        np.array(joints, np.int64), np.array(arm.offsets, order="C"), np.array(rest, order="C"), np.array(palm_in_wrist)
    )


@compiled_entry
def palm_and_slope(chain: ArmChain, root: Array, turns: Array) -> tuple[Array, Array]:
    """The palm (3,), m, and its derivative (3, 3 + 3 n) by root and rotation vectors.

    Args:
        chain: the joints.
        root: (3,) m, the pelvis.
        turns: (n, 3) rad, rotation vectors of the chain's joints relative to the rest pose.
    """
    count = len(turns)
    world, place = np.empty((count, 3, 3)), np.empty((count, 3))
    before = np.eye(3)
    for j in range(count):
        if j == 0:
            place[0] = root
        else:
            place[j] = place[j - 1] + _turned(before, chain.offsets[j])
        world[j] = product(product(before, chain.rest[j]), _rotation(turns[j]))
        before = world[j]
    palm = place[count - 1] + _turned(before, chain.palm)
    slope = np.zeros((3, 3 + 3 * count))
    for i in range(3):
        slope[i, i] = 1.0
    for j in range(count):
        local = np.zeros(3)
        for i in range(3):
            for k in range(3):
                local[i] += world[j, k, i] * (palm[k] - place[j, k])
        slope[:, 3 + 3 * j : 6 + 3 * j] = -product(product(world[j], _cross(local)), _right_jacobian(turns[j]))
    return palm, slope


@compiled_entry
def brought(chain: ArmChain, covariance: Array, root: Array, turns: Array, target: Array) -> Array:
    """The change (3 + 3 n,) of root, m, and rotation vectors, rad, that brings the palm to ``target`` (3,), m.

    Of all changes the likeliest, where they have the ``covariance`` (3 + 3 n, 3 + 3 n): a Gaussian conditioned on the
    palm, as movement primitives are on a via-point (Paraschos et al. 2013, eq. 5-6).
    """
    size, change = len(covariance), np.zeros(len(covariance))
    for _ in range(STEPS):
        moved = turns.copy()
        for j in range(len(turns)):
            for i in range(3):
                moved[j, i] += change[3 + 3 * j + i]
        palm, slope = palm_and_slope(chain, root + change[:3], moved)
        spread = np.zeros((size, 3))
        for a in range(size):
            for i in range(3):
                for b in range(size):
                    spread[a, i] += covariance[a, b] * slope[i, b]
        both, missing = np.zeros((3, 3)), np.zeros(3)
        for i in range(3):
            missing[i] = target[i] - palm[i]
            both[i, i] = 1e-8  # m²
            for a in range(size):
                missing[i] += slope[i, a] * change[a]
                for k in range(3):
                    both[i, k] += slope[i, a] * spread[a, k]
        if not cholesky(both, both):
            return change
        cholesky_solve(both, missing)
        for a in range(size):
            change[a] = spread[a, 0] * missing[0] + spread[a, 1] * missing[1] + spread[a, 2] * missing[2]
    return change


@compiled
def _turned(matrix: Array, vector: Array) -> Array:
    result = np.zeros(3)
    for i in range(3):
        for k in range(3):
            result[i] += matrix[i, k] * vector[k]
    return result


@compiled
def _cross(vector: Array) -> Array:
    """The matrix that takes the cross product with a vector."""
    result = np.zeros((3, 3))
    result[0, 1], result[0, 2], result[1, 2] = -vector[2], vector[1], -vector[0]
    result[1, 0], result[2, 0], result[2, 1] = vector[2], -vector[1], vector[0]
    return result


@compiled
def _series(vector: Array, first: float, second: float) -> Array:
    """I + first [v]× + second [v]×²."""
    cross = _cross(vector)
    square = product(cross, cross)
    result = np.eye(3)
    for i in range(3):
        for j in range(3):
            result[i, j] += first * cross[i, j] + second * square[i, j]
    return result


@compiled
def _rotation(vector: Array) -> Array:
    """The rotation matrix of a rotation vector (Rodrigues)."""
    angle = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    if angle < 1e-6:
        return _series(vector, 1.0, 0.5)
    return _series(vector, math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2)


@compiled
def _right_jacobian(vector: Array) -> Array:
    """How a rotation turns in its own frame as its rotation vector changes (Chirikjian 2012, eq. 10.86)."""
    angle = math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    if angle < 1e-4:
        return _series(vector, -0.5, 1.0 / 6.0)
    return _series(vector, -(1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3)

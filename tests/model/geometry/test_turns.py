"""Turns of one direction against those of :mod:`highfive.model.geometry.rotations`."""

import numpy as np
import pytest

from highfive.model.geometry import rotations
from highfive.model.geometry.turns import turn_between, turned

DIRECTIONS = np.random.default_rng(5).normal(size=(200, 2, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=-1, keepdims=True)


@pytest.mark.parametrize("size", [0.0, 1e-14, 1e-7, 1.0, 3.1, 7.0])
def test_a_vector_is_turned_as_by_the_quaternion(size: float) -> None:
    for turn, vector in DIRECTIONS:
        plain = rotations.rotate(rotations.from_rotation_vector(size * turn), vector)
        np.testing.assert_allclose(turned(size * turn, vector), plain, atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-7, 1e-3, 1.0, 3.0, 3.14])
def test_the_smallest_turn_is_the_quaternions(size: float) -> None:
    for one, beside in DIRECTIONS:
        across = np.cross(one, beside)
        other = turned(size * across / np.linalg.norm(across), one)
        plain = rotations.to_rotation_vector(rotations.rotation_between(one, other))
        np.testing.assert_allclose(turn_between(one, other), plain, rtol=1e-9, atol=1e-12)


def test_opposite_directions_are_half_a_turn_apart() -> None:
    for one, _ in DIRECTIONS:
        turn = turn_between(one, -one)
        np.testing.assert_allclose(np.linalg.norm(turn), np.pi, atol=1e-12)
        np.testing.assert_allclose(turned(turn, one), -one, atol=1e-12)
        plain = rotations.to_rotation_vector(rotations.rotation_between(one, -one))
        np.testing.assert_allclose(turn, plain, atol=1e-12)

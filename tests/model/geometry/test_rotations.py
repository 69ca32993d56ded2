"""Laws of rotations, and SciPy as the independent oracle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from highfive.model.geometry import rotations

ORDERS = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")
vectors = st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3).map(np.array)


def random_quaternions(count: int, seed: int = 0) -> np.ndarray:
    return rotations.normalize(np.random.default_rng(seed).normal(size=(count, 4)))


def oracle(quaternion: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternion, scalar_first=True)


def same_rotation(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_allclose(np.abs(np.sum(a * b, axis=-1)), 1.0, atol=1e-12)


def test_product_and_action_agree_with_scipy() -> None:
    a, b = random_quaternions(200), random_quaternions(200, 1)
    v = np.random.default_rng(2).normal(size=(200, 3))
    same_rotation(rotations.multiply(a, b), (oracle(a) * oracle(b)).as_quat(scalar_first=True))
    np.testing.assert_allclose(rotations.rotate(a, v), oracle(a).apply(v), atol=1e-12)
    np.testing.assert_allclose(rotations.to_matrix(a), oracle(a).as_matrix(), atol=1e-12)


def test_matrices_come_back() -> None:
    q = random_quaternions(500)
    q = np.concatenate([q, np.eye(4), rotations.from_axis_angle("x", np.array([np.pi]))])  # half turns too
    same_rotation(rotations.from_matrix(rotations.to_matrix(q)), q)


def test_the_rotation_nearest_to_a_sum_of_products_turns_points_as_scipy_does() -> None:
    rng = np.random.default_rng(5)
    points, targets = rng.normal(size=(2, 60, 5, 3))
    targets[::2] = -points[::2] + 0.1 * targets[::2]  # a mirror image, of which only a rotation is nearest
    found = rotations.nearest_rotation(np.einsum("tni,tnj->tij", targets, points))
    expected = [Rotation.align_vectors(b, a)[0].as_matrix() for a, b in zip(points, targets, strict=True)]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    turns = rotations.to_matrix(random_quaternions(50))
    np.testing.assert_allclose(rotations.nearest_rotation(0.3 * turns), turns, atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_hinges_agree_with_scipy_and_come_back(order: str) -> None:
    angles = np.random.default_rng(3).uniform([-3.1, -1.5, -3.1], [3.1, 1.5, 3.1], (300, 3))
    q = rotations.from_euler(order, angles)
    same_rotation(q, Rotation.from_euler(order.upper(), angles).as_quat(scalar_first=True))
    np.testing.assert_allclose(rotations.to_euler(order, q), angles, atol=1e-9)


@given(vectors)
def test_logarithm_inverts_exponential(v: np.ndarray) -> None:
    angle = np.linalg.norm(v)
    back = rotations.to_rotation_vector(rotations.from_rotation_vector(v))
    same_rotation(rotations.from_rotation_vector(back), rotations.from_rotation_vector(v))
    if angle < np.pi - 1e-3:
        np.testing.assert_allclose(back, v, atol=1e-9)
    assert np.linalg.norm(back) <= np.pi + 1e-9


def test_logarithm_near_zero_is_linear() -> None:
    v = np.array([1e-12, -2e-13, 3e-12])
    np.testing.assert_allclose(rotations.to_rotation_vector(rotations.from_rotation_vector(v)), v, rtol=1e-6)


def test_slerp_is_a_constant_turn() -> None:
    a, b = random_quaternions(50), random_quaternions(50, 4)
    half = rotations.slerp(a, b, np.full(50, 0.5))
    first = rotations.multiply(rotations.conjugate(a), half)
    second = rotations.multiply(rotations.conjugate(half), b)
    same_rotation(first, second)
    same_rotation(rotations.slerp(a, b, np.ones(50)), b)


@given(vectors, vectors)
def test_between_turns_one_onto_the_other(a: np.ndarray, b: np.ndarray) -> None:
    if min(np.linalg.norm(a), np.linalg.norm(b)) < 1e-3:
        return
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    np.testing.assert_allclose(rotations.rotate(rotations.rotation_between(a, b), a), b, atol=1e-7)


def test_between_opposite_vectors() -> None:
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        np.testing.assert_allclose(rotations.rotate(rotations.rotation_between(axis, -axis), axis), -axis, atol=1e-12)

"""The skeleton: kinematics against a naive chain, conversions that come back."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.hinges import hinges_towards

SKELETON = avatar_skeleton()


def random_hinges(count: int, seed: int = 0) -> np.ndarray:
    low, high = SKELETON.hinge_limits[..., 0], SKELETON.hinge_limits[..., 1]
    return np.random.default_rng(seed).uniform(low, high, (count, *low.shape))


@pytest.mark.parametrize("shape", [(), (4,)])
@pytest.mark.parametrize("name", ["pelvis", "right_clavicle", "right_wrist", "left_ankle"])
def test_chain_to_a_joint_moves_as_in_the_whole_body_to_the_bit(shape: tuple[int, ...], name: str) -> None:
    rng = np.random.default_rng(2)
    root, angles = rng.normal(size=(*shape, 3)), rng.uniform(-1.0, 1.0, (*shape, len(SKELETON), 3))
    positions, orientations = SKELETON.forward_kinematics(root, SKELETON.from_hinges(angles))
    chain, alone = SKELETON.chain_to(name)
    position, orientation = alone.forward_kinematics(root, alone.from_hinges(angles[..., chain, :]))
    np.testing.assert_array_equal(position, positions[..., chain, :])
    np.testing.assert_array_equal(orientation, orientations[..., chain, :])


def test_forward_kinematics_is_the_chain_of_matrices() -> None:
    angles = random_hinges(1)[0]
    root = np.array([0.3, -0.2, 1.1])
    quaternions = SKELETON.from_hinges(angles)
    positions, orientations = SKELETON.forward_kinematics(root, quaternions)
    for joint in range(len(SKELETON)):
        chain, matrix, position = [], np.eye(3), np.zeros(3)
        parent = joint
        while parent >= 0:
            chain.append(parent)
            parent = SKELETON.parents[parent]
        for j in reversed(chain):
            position = root if SKELETON.parents[j] < 0 else position + matrix @ SKELETON.offsets[j]
            matrix = matrix @ rotations.to_matrix(quaternions[j])
        np.testing.assert_allclose(positions[joint], position, atol=1e-12)
        np.testing.assert_allclose(rotations.to_matrix(orientations[joint]), matrix, atol=1e-12)


def test_hinges_come_back_everywhere_inside_the_limits() -> None:
    angles = random_hinges(200)
    np.testing.assert_allclose(SKELETON.to_hinges(SKELETON.from_hinges(angles)), angles, atol=1e-7)


def test_rotation_vectors_come_back_and_are_zero_at_rest() -> None:
    q = SKELETON.from_hinges(random_hinges(100))
    back = SKELETON.from_rotation_vectors(SKELETON.to_rotation_vectors(q))
    np.testing.assert_allclose(np.abs(np.sum(q * back, axis=-1)), 1.0, atol=1e-12)
    np.testing.assert_allclose(SKELETON.to_rotation_vectors(SKELETON.rest), 0.0, atol=1e-12)


def test_scaling_scales_bones_and_keeps_the_hash() -> None:
    tall = SKELETON.scaled(1.1)
    q = SKELETON.from_hinges(random_hinges(5))
    zero = np.zeros(3)
    small, large = (s.forward_kinematics(zero, q)[0] for s in (SKELETON, tall))
    np.testing.assert_allclose(large, 1.1 * small, atol=1e-12)
    assert tall.hash == SKELETON.hash
    longer = SKELETON.scaled({"right_elbow": 1.5})
    assert np.linalg.norm(longer.offsets[SKELETON.index("right_elbow")]) == pytest.approx(
        1.5 * np.linalg.norm(SKELETON.offsets[SKELETON.index("right_elbow")])
    )


def test_hash_depends_on_limits() -> None:
    assert replace(SKELETON, hinge_limits=SKELETON.hinge_limits * 0.9).hash != SKELETON.hash


def test_unknown_joint_is_named() -> None:
    with pytest.raises(HighFiveError, match="tail"):
        SKELETON.index("tail")


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-3, 1.0, 3.2])
def test_compiled_hinges_are_those_of_numpy(size: float) -> None:
    rng = np.random.default_rng(11)
    for _ in range(200):
        vectors = size * rng.normal(size=3 * len(SKELETON))
        plain = SKELETON.clamp(SKELETON.to_hinges(SKELETON.from_rotation_vectors(vectors)))
        np.testing.assert_allclose(SKELETON.hinges_within(vectors), plain, atol=1e-12)


@pytest.mark.parametrize("share", [-0.5, 0.0, 0.3, 1.0, 2.0])
def test_compiled_ways_between_poses_are_those_of_numpy(share: float) -> None:
    rng = np.random.default_rng(12)
    one, other = rng.normal(size=(2, len(SKELETON), 3))
    plain = SKELETON.clamp(one + share * (other - one))
    np.testing.assert_array_equal(SKELETON.hinges_between(one, other, share), plain)
    plain = one + np.clip(other - one, -0.2, 0.2)
    np.testing.assert_array_equal(hinges_towards(one, other, 0.2), plain)

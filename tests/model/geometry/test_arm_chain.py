"""The chain that carries the palm against the skeleton's own kinematics."""

import numpy as np
import pytest

from highfive.hil.sim.avatar import PALM_IN_RIGHT_WRIST, avatar_arm, avatar_skeleton
from highfive.model.geometry import rotations
from highfive.model.geometry.arm_chain import brought, palm_and_slope
from highfive.model.geometry.rotations import Array

CHAIN = avatar_arm()
ROOT = np.array([0.1, -0.2, 0.95])


def turns(seed: int, size: float = 0.5) -> Array:
    return size * np.random.default_rng(seed).normal(size=(len(CHAIN.joints), 3))


def palm_by_the_skeleton(root: Array, chain_turns: Array) -> Array:
    skeleton, vectors = avatar_skeleton(), np.zeros((len(avatar_skeleton()), 3))
    vectors[CHAIN.joints] = chain_turns
    places, rotated = skeleton.forward_kinematics(root, skeleton.from_rotation_vectors(vectors.reshape(-1)))
    wrist = skeleton.index("right_wrist")
    return places[wrist] + rotations.rotate(rotated[wrist], PALM_IN_RIGHT_WRIST)


@pytest.mark.parametrize("size", [0.0, 1e-7, 0.5, 2.0])
def test_the_palm_is_the_skeletons(size: float) -> None:
    palm, _ = palm_and_slope(CHAIN, ROOT, turns(0, size))
    np.testing.assert_allclose(palm, palm_by_the_skeleton(ROOT, turns(0, size)), atol=1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-5, 0.5, 2.0])
def test_the_slope_is_that_of_finite_differences(size: float) -> None:
    start = turns(1, size)
    _, slope = palm_and_slope(CHAIN, ROOT, start)
    values, h = np.concatenate([ROOT, start.reshape(-1)]), 1e-6
    for column in range(len(values)):
        step = h * np.eye(len(values))[column]
        ends = [palm_by_the_skeleton((values + s)[:3], (values + s)[3:].reshape(-1, 3)) for s in (step, -step)]
        np.testing.assert_allclose(slope[:, column], (ends[0] - ends[1]) / (2 * h), atol=1e-8)


def covariance(seed: int) -> Array:
    root = np.random.default_rng(seed).normal(size=(3 + 3 * len(CHAIN.joints),) * 2)
    return 0.01 * root @ root.T / len(root)


@pytest.mark.parametrize("away", [0.0, 0.03, 0.1])
def test_the_palm_is_brought_to_its_target(away: float) -> None:
    start = turns(2, 0.3)
    palm, _ = palm_and_slope(CHAIN, ROOT, start)
    target = palm + away * np.array([0.6, -0.64, 0.48])
    change = brought(CHAIN, covariance(3), ROOT, start, target)
    got, _ = palm_and_slope(CHAIN, ROOT + change[:3], start + change[3:].reshape(-1, 3))
    assert np.linalg.norm(got - target) <= 0.05 * away + 1e-9


def test_of_all_small_changes_that_bring_it_there_the_change_is_the_likeliest() -> None:
    """By Lagrange: the precision times the change is a combination of the palm's derivatives."""
    start, spread = turns(4, 0.3), covariance(5)
    palm, slope = palm_and_slope(CHAIN, ROOT, start)
    change = brought(CHAIN, spread, ROOT, start, palm + np.array([1e-4, -2e-4, 1e-4]))
    pull = np.linalg.solve(spread, change)
    combination, *_ = np.linalg.lstsq(slope.T, pull, rcond=None)
    assert np.linalg.norm(slope.T @ combination - pull) < 1e-2 * np.linalg.norm(pull)


def test_what_never_errs_is_not_moved() -> None:
    spread = covariance(6)
    spread[:9], spread[:, :9] = 0.0, 0.0
    palm, _ = palm_and_slope(CHAIN, ROOT, turns(7))
    change = brought(CHAIN, spread, ROOT, turns(7), palm + 0.05)
    assert np.all(change[:9] == 0.0) and np.abs(change[9:]).max() > 0.01

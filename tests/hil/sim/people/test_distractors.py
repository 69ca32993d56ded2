"""Simulated gestures that are no high five: bodies keep their limits, hands keep off where palms could meet."""

import numpy as np
import pytest

from highfive.hil.sim.people.distractors import CLEAR, MOVED, Distractor, from_grid, simulate_distractor
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.gestures import GESTURES
from highfive.hil.sim.people.role import ARM, RATE_HZ
from highfive.model.errors import HighFiveError


def drawn(gesture: str, emotion: str, seed: int = 3) -> Distractor:
    return simulate_distractor(gesture, emotion, np.random.default_rng([seed, list(GESTURES).index(gesture)]))


@pytest.fixture(scope="module")
def gestures() -> list[Distractor]:
    return [drawn(gesture, list(EMOTIONS)[n % len(EMOTIONS)]) for n, gesture in enumerate(GESTURES)]


def test_the_arm_stays_within_its_limits_and_moves_as_arms_do(gestures: list[Distractor]) -> None:
    for found in gestures:
        skeleton = found.person.skeleton
        arm = [skeleton.index(name) for name in ARM]
        angles, limits = skeleton.to_hinges(found.person.quaternions)[:, arm], skeleton.hinge_limits[arm]
        assert np.all(angles > limits[..., 0] - 1e-6) and np.all(angles < limits[..., 1] + 1e-6)
        velocity = np.diff(found.palm, axis=0) * RATE_HZ
        assert np.linalg.norm(velocity, axis=1).max() < 6.0
        assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() * RATE_HZ < 150.0


def test_a_hand_rises_when_it_is_said_to_and_comes_back_near_to_where_it_hung(gestures: list[Distractor]) -> None:
    for found in gestures:
        rise, away = round(found.rise_s * RATE_HZ), np.linalg.norm(found.palm - found.palm[0], axis=1)
        assert 0.2 < found.rise_s < 3.0
        assert np.all(away[:rise] <= MOVED) and away[rise] > MOVED
        assert away.max() > 0.2 and away[-1] < 0.15


def test_palms_never_come_to_where_palms_could_meet(gestures: list[Distractor]) -> None:
    for found in gestures:
        apart = 0.5 * float(found.person.root_in_world[0, 0])
        near = [from_grid(found.palm, 2.0 * half).min() for half in (apart - 0.02, apart, apart + 0.02)]
        assert max(near) > CLEAR - 0.02


def test_the_distance_to_the_grid_is_that_to_its_nearest_place() -> None:
    rng = np.random.default_rng(0)
    palms = rng.uniform([0.0, -1.0, 0.5], [1.5, 1.0, 2.2], (40, 3))
    y, z = (a.ravel() for a in np.meshgrid(np.linspace(-0.25, 0.25, 101), np.linspace(1.2, 1.6, 81)))
    places = np.stack([np.full(len(y), 0.5), y, z], axis=1)
    nearest = np.linalg.norm(palms[:, None] - places, axis=-1).min(axis=1)
    np.testing.assert_allclose(from_grid(palms, 1.0), nearest, atol=2e-3)


def test_the_same_seed_draws_the_same_and_another_another() -> None:
    one, same, other = drawn("point", "sad"), drawn("point", "sad"), drawn("point", "sad", 4)
    assert np.array_equal(one.palm, same.palm) and not np.array_equal(one.palm[:50], other.palm[:50])


def test_an_unknown_gesture_is_refused() -> None:
    with pytest.raises(HighFiveError, match="unknown gesture 'salute'; known are wave"):
        simulate_distractor("salute", "sad", np.random.default_rng(0))

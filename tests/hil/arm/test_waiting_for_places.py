"""While it is not known which of several hands will come, the arm waits where it can meet most of them."""

import numpy as np
import pytest

from highfive.hil.arm.planner import CLEAR, Retarget
from highfive.hil.arm.planner_settings import RetargetSettings
from highfive.hil.arm.planner_values import ExpectedContact, PalmGoal, RetargetState
from highfive.hil.arm.reachability import cell_point
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.gp.mixture import GaussianMixture

TICK = 1.0 / 120.0
CELLS = ("A1", "A3", "B2", "C1", "C3")
POINTS = np.array([cell_point(cell) for cell in CELLS])
TOWARDS, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
HEAD = np.array([0.9, 0.0, 1.65])


@pytest.fixture(scope="module")
def retarget() -> Retarget:
    arm = default_arm()
    return Retarget(arm, arm.ready, RetargetSettings(lag=0.0))


def waits(weights: Array, points: Array = POINTS, head: Array | None = HEAD) -> PalmGoal:
    """A person who stands with hands down, and one of these places to come."""
    hands_down = PalmPose(np.array([0.75, -0.25, 0.8]), -TOWARDS, UP, np.zeros(3))
    covariances = np.tile(4e-4 * np.eye(3), (len(points), 1, 1))
    return PalmGoal(hands_down, hands_down, head, None, GaussianMixture(weights, points, covariances))


def after(retarget: Retarget, goal: PalmGoal, seconds: float, state: RetargetState | None = None) -> RetargetState:
    state = state or retarget.start()
    for _ in range(round(seconds / TICK)):
        state, _ = retarget.step(state, goal)
    return state


def plate(retarget: Retarget, state: RetargetState) -> Array:
    return retarget.arm.plate_at(state.joints).position


@pytest.mark.parametrize("likely", range(len(CELLS)))
def test_it_waits_before_the_likeliest_and_does_not_reach_into_it(retarget: Retarget, likely: int) -> None:
    weights = np.full(len(CELLS), 0.01)
    weights[likely] = 0.96
    place = plate(retarget, after(retarget, waits(weights), 1.5))
    away = np.linalg.norm(POINTS - place, axis=1)
    assert away.argmin() == likely
    assert 0.05 < away[likely] < 0.25


def approach(point: Array, left: float) -> PalmGoal:
    """The hand is there, the avatar's palm comes straight, and there are ``left`` s."""
    ours = PalmPose(point - 0.5 * left * TOWARDS, TOWARDS, UP, 0.5 * TOWARDS)
    contact = ExpectedContact(point, 1e-6 * np.eye(3), TOWARDS, left)
    return PalmGoal(ours, PalmPose(point, -TOWARDS, UP, np.zeros(3)), HEAD, contact)


def test_it_is_nearer_to_most_of_them_soon_after_one_is_known(retarget: Retarget) -> None:
    """0.2 s after, of the 0.4 s that there are; than from where it rests."""
    waiting, left = after(retarget, waits(np.full(len(CELLS), 1.0 / len(CELLS))), 1.0), np.empty((2, len(CELLS)))
    for row, begin in enumerate((retarget.start(), waiting)):
        for column, point in enumerate(POINTS):
            state = begin
            for tick in range(round(0.2 / TICK)):
                state, _ = retarget.step(state, approach(point, 0.4 - tick * TICK))
            left[row, column] = np.linalg.norm(plate(retarget, state) - point)
    assert np.sum(left[1] < left[0] - 0.02) >= len(CELLS) - 1
    assert left[1].max() < 0.6 * left[0].max()


def test_nobody_is_waited_for_near_a_face(retarget: Retarget) -> None:
    """Wherever her head is, no posture of waiting has the plate near it, unless that of rest has."""
    rng, ready = np.random.default_rng(0), retarget.arm.plate_at(retarget.ready).position
    tried = 0
    for _ in range(200):
        head, weights = rng.uniform([0.2, -0.5, 1.0], [0.9, 0.5, 1.8]), rng.dirichlet(np.ones(len(CELLS)))
        zone = retarget.settings.face_radius
        if np.linalg.norm(ready - head) < zone + 2.0 * CLEAR:
            continue
        posture, _ = retarget._awaiting(waits(weights, head=head))
        tried += 1
        assert np.linalg.norm(retarget.arm.plate_at(posture).position - head) > zone
    assert tried > 50


def test_a_place_that_no_posture_reaches_is_left_out(retarget: Retarget) -> None:
    far = np.vstack([POINTS[2], [3.0, 0.0, 1.5]])
    alone, _ = retarget._awaiting(waits(np.ones(1), POINTS[2:3]))
    both, _ = retarget._awaiting(waits(np.array([0.1, 0.9]), far))
    np.testing.assert_allclose(both, alone)
    rest, _ = retarget._awaiting(waits(np.ones(1), far[1:]))
    np.testing.assert_allclose(rest, retarget.ready)


def test_what_is_no_number_is_as_if_nobody_were_there(retarget: Retarget) -> None:
    state = after(retarget, waits(np.array([np.nan, 1.0, 0.0, 0.0, 0.0])), 0.5)
    np.testing.assert_allclose(state.joints, retarget.ready, atol=0.02)

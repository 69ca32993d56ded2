"""Which joints are reversed is told from small turns of one at a time, before anything is fitted."""

import numpy as np
import pytest
from hidden_poses import postures

from highfive.calibration.joint_directions import reversed_joints, turned_by
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.hidden_arm import TEMPLATE, HiddenArm, drawn_truth
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

SHAPE = drawn_shape(default_arm(), TEMPLATE.markers)
TURN = np.radians(5.0)
MIDDLE = postures(1, seed=4)[0]


def turned(signs: Array, seed: int) -> Array:
    """(J, 2, M, 3) m, markers of an arm whose encoders count the other way where a sign is −1."""
    arm, rng = HiddenArm(drawn_truth(seed)), np.random.default_rng(seed)
    seen = np.empty((6, 2, 5, 3))
    for joint in range(6):
        for side, turn in enumerate((-TURN, TURN)):
            encoders = MIDDLE.copy()
            encoders[joint] += turn
            arm.stand(signs * encoders, np.zeros(6))
            seen[joint, side] = arm.markers() + rng.normal(0.0, 0.0003, (5, 3))
    return seen


@pytest.mark.parametrize("wrong", [(), (0,), (1,), (2,), (3,), (4,), (5,), (1, 2), (0, 4, 5)])
def test_reversed_joints_are_named(wrong: tuple[int, ...]) -> None:
    signs = np.ones(6)
    signs[list(wrong)] = -1.0
    found = reversed_joints(SHAPE, MIDDLE, MIDDLE - TURN, MIDDLE + TURN, turned(signs, len(wrong)))
    assert found == tuple(SHAPE.names[j] for j in wrong)


def test_a_joint_that_moves_nothing_is_named() -> None:
    seen = turned(np.ones(6), 0)
    seen[4, 1] = seen[4, 0]
    with pytest.raises(HighFiveError, match=r"wrist_angle was turned by 10\.0°, the plate moved 0\.0 mm"):
        reversed_joints(SHAPE, MIDDLE, MIDDLE - TURN, MIDDLE + TURN, seen)


def test_a_joint_whose_turn_nobody_saw_is_named() -> None:
    seen = turned(np.ones(6), 0)
    seen[1, 0] = np.nan
    with pytest.raises(HighFiveError, match="shoulder was turned and no marker was seen on both sides"):
        reversed_joints(SHAPE, MIDDLE, MIDDLE - TURN, MIDDLE + TURN, seen)


def test_moves_of_something_else_are_refused() -> None:
    noise = np.random.default_rng(0).normal(0.0, 0.05, (6, 2, 5, 3))
    with pytest.raises(HighFiveError, match="fit no set of directions"):
        reversed_joints(SHAPE, MIDDLE, MIDDLE - TURN, MIDDLE + TURN, noise)


@pytest.mark.parametrize("seed", range(4))
def test_which_way_is_up_is_told(seed: int) -> None:
    seen = turned(np.ones(6), seed)
    drawn_up = rotations.to_matrix(default_arm().mount.quaternion)[2]
    up = turned_by(SHAPE, MIDDLE, MIDDLE - TURN, MIDDLE + TURN, seen) @ drawn_up
    assert up[2] > np.cos(np.radians(8.0))  # a base is turned by 2 degrees, and zeros are off
    y_up = seen[..., [0, 2, 1]] * [1.0, 1.0, -1.0]
    assert abs(turned_by(SHAPE, MIDDLE, MIDDLE - TURN, MIDDLE + TURN, y_up)[2] @ drawn_up) < np.sin(np.radians(8.0))

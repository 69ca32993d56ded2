"""The body's numbers are those of a person."""

import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton, right_palm
from highfive.scenes import anthropometry as body

SKELETON = avatar_skeleton()


def zero_pose() -> np.ndarray:
    identity = np.tile([1.0, 0.0, 0.0, 0.0], (len(SKELETON), 1))
    return SKELETON.forward_kinematics(SKELETON.offsets[0], identity)[0]


def test_53_joints_of_three_coordinates() -> None:
    assert len(SKELETON) == 53
    assert SKELETON.hinge_limits.shape == (53, 3, 2)
    assert sum(any(f in name for f in body.FINGER_NAMES) for name in SKELETON.names) == 30


def test_parents_come_first_and_sides_are_mirrored() -> None:
    assert all(parent < joint for joint, parent in enumerate(SKELETON.parents))
    for joint, name in enumerate(SKELETON.names):
        if name.startswith("right_"):
            other = SKELETON.index(name.replace("right_", "left_"))
            np.testing.assert_allclose(SKELETON.offsets[joint] * [1, -1, 1], SKELETON.offsets[other], atol=1e-12)
            assert SKELETON.hinge_orders[joint] == SKELETON.hinge_orders[other]


def test_limits_contain_the_zero_pose_and_stay_off_the_singularity() -> None:
    low, high = SKELETON.hinge_limits[..., 0], SKELETON.hinge_limits[..., 1]
    assert np.all(low <= 0.0)
    assert np.all(high >= 0.0)
    assert np.all(np.abs(SKELETON.hinge_limits[:, 1]) < np.radians(90.0))
    np.testing.assert_allclose(SKELETON.clamp(SKELETON.to_hinges(SKELETON.rest)), SKELETON.to_hinges(SKELETON.rest))


@pytest.mark.parametrize(
    ("upper", "lower", "fraction"),
    [
        ("right_shoulder", "right_elbow", 0.186),
        ("right_elbow", "right_wrist", 0.146),
        ("right_hip", "right_knee", 0.245),
    ],
)
def test_segments_are_those_of_drillis_and_contini(upper: str, lower: str, fraction: float) -> None:
    centres = zero_pose()
    length = np.linalg.norm(centres[SKELETON.index(upper)] - centres[SKELETON.index(lower)])
    assert length == pytest.approx(fraction * body.HEIGHT, rel=0.01)


def test_hand_is_as_long_as_a_hand() -> None:
    centres = zero_pose()
    tip = centres[SKELETON.index("right_middle_3")] - [0.0, 0.0, body.FINGER_TIP_LENGTH["middle"]]
    hand = np.linalg.norm(tip - centres[SKELETON.index("right_wrist")])
    assert hand == pytest.approx(0.108 * body.HEIGHT, rel=0.03)


def test_masses_sum_to_the_body() -> None:
    paired = {"clavicle", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe"}
    total = sum(m * (2 if name in paired else 1) for name, m in body.SEGMENT_MASS_FRACTION.items())
    assert total == pytest.approx(1.0, abs=0.01)


def test_palm_of_a_hanging_arm_faces_the_thigh() -> None:
    identity = np.tile([1.0, 0.0, 0.0, 0.0], (len(SKELETON), 1))
    centre, normal, fingers = right_palm(SKELETON, *SKELETON.forward_kinematics(SKELETON.offsets[0], identity))
    np.testing.assert_allclose(normal, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(fingers, [0, 0, -1], atol=1e-12)
    assert centre[2] < zero_pose()[SKELETON.index("right_wrist"), 2]

"""Joint angles against SciPy's Euler angles, finite differences and what the words mean."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from highfive.mocap_bridge.tracking.joint_angles import ANGLES, angles_between

# ISB axes of a segment that hangs in the zero pose, in columns, in our axes: forward, up, right.
ISB = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
# The forearm's, whose first axis comes out of the palm's side of an arm in the anatomical position.
FOREARM = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
UPRIGHT = np.eye(3)


def frames(seed):
    """Thorax, upper arm, forearm and hand (4, 3, 3), with the arm away from hanging."""
    rng = np.random.default_rng(seed)
    trunk = Rotation.random(random_state=rng)
    upper = (
        trunk
        * Rotation.from_euler("YX", rng.uniform([-1, -2.2], [1, -0.3]))
        * Rotation.from_euler("Z", rng.uniform(-1, 1))
    )
    forearm = upper * Rotation.from_euler("YXZ", rng.uniform([-2, -0.1, -1], [0, 0.1, 1]))
    hand = forearm * Rotation.from_euler("XY", rng.uniform([-0.8, -0.3], [0.8, 0.3]))
    return [turn.as_matrix() for turn in (trunk, upper, forearm, hand)]


@pytest.mark.parametrize("seed", range(20))
def test_shoulder_and_elbow_are_the_euler_angles_of_the_recommendation(seed):
    base, upper, forearm, hand = frames(seed)
    found = dict(zip(ANGLES, angles_between(base, upper, forearm, hand), strict=True))
    thorax, humerus = base @ ISB, upper @ ISB
    shoulder = Rotation.from_matrix(thorax.T @ humerus).as_euler("YXY")
    if shoulder[1] > 0.0:  # SciPy counts the elevation positive; ISB wants it negative, which is the other solution
        shoulder = np.array([shoulder[0] - np.pi, -shoulder[1], shoulder[2] + np.pi])
    elbow = Rotation.from_matrix(humerus.T @ (forearm @ FOREARM)).as_euler("ZXY")
    ours = [found["plane_of_elevation"], -found["elevation"], found["axial_rotation"]]
    np.testing.assert_allclose(np.exp(1j * np.array(ours)), np.exp(1j * shoulder), atol=1e-9)
    ours = [found["elbow_flexion"], found["carrying_angle"], found["pronation"]]
    np.testing.assert_allclose(np.exp(1j * np.array(ours)), np.exp(1j * elbow), atol=1e-9)


def turned(axis, degrees):
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


@pytest.mark.parametrize(
    ("name", "expected", "upper", "forearm", "hand"),
    [
        ("elevation", 90, turned("y", -90), turned("y", -90), turned("y", -90)),  # forward
        ("plane_of_elevation", 90, turned("y", -90), turned("y", -90), turned("y", -90)),
        ("elevation", 60, turned("x", -60), turned("x", -60), turned("x", -60)),  # sideways: the right elbow goes right
        ("plane_of_elevation", 0, turned("x", -60), turned("x", -60), turned("x", -60)),
        ("elbow_flexion", 80, UPRIGHT, turned("y", -80), turned("y", -80)),
        ("pronation", 90, UPRIGHT, UPRIGHT, UPRIGHT),  # palm at the thigh
        ("pronation", 0, UPRIGHT, turned("z", -90), turned("z", -90)),  # palm forward
        ("wrist_flexion", 40, UPRIGHT, UPRIGHT, turned("x", 40)),  # the fingers go to the thigh
        ("wrist_deviation", 20, UPRIGHT, UPRIGHT, turned("y", 20)),  # the fingers go back, to the little finger's side
    ],
)
def test_the_words_mean_what_they_say(name, expected, upper, forearm, hand):
    angles = np.degrees(angles_between(UPRIGHT, upper, forearm, hand))
    assert angles[ANGLES.index(name)] == pytest.approx(expected, abs=1e-6)


def test_turning_the_whole_body_changes_nothing():
    base, upper, forearm, hand = frames(3)
    turn = Rotation.random(random_state=1).as_matrix()
    np.testing.assert_allclose(
        angles_between(turn @ base, turn @ upper, turn @ forearm, turn @ hand),
        angles_between(base, upper, forearm, hand),
        atol=1e-12,
    )

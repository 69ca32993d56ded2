"""What friction takes, from torques of a joint that is led up and down under gravity."""

import numpy as np
import pytest

from highfive.calibration.joint_friction import friction_torque
from highfive.model.errors import HighFiveError

SPEED = 0.15


def swept(friction: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    up = np.linspace(-0.12, 0.12, 150)
    angles = np.concatenate([up, up[::-1]])
    way = np.repeat([1.0, -1.0], 150)
    gravity = 3.0 * np.cos(angles + 0.4) + 0.5
    torques = gravity + friction * way + rng.normal(0.0, 0.02, 300)
    return angles, SPEED * way, np.round(torques / 0.006) * 0.006


@pytest.mark.parametrize("friction", [0.05, 0.25, 0.6])
def test_friction_is_found_beside_gravity_of_any_size(friction: float) -> None:
    assert friction_torque(*swept(friction), SPEED) == pytest.approx(friction, abs=0.005)


def test_turns_tell_nothing() -> None:
    """At the turns a joint stands, and its torque is anything between the two."""
    angles, speeds, torques = swept(0.25)
    turning = np.zeros(40)
    found = friction_torque(
        np.append(angles, turning + 0.12), np.append(speeds, turning), np.append(torques, turning + 9.0), SPEED
    )
    assert found == pytest.approx(0.25, abs=0.005)


def test_a_joint_that_sticks_is_told() -> None:
    angles, speeds, torques = swept(0.25)
    with pytest.raises(HighFiveError, match="does it stick"):
        friction_torque(angles, np.where(speeds < 0.0, 0.0, speeds), torques, SPEED)

"""The simulated actor who turns round: nothing tells the emotion before the tap, then she faces who tapped."""

import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.people.role import ActorMotion
from highfive.hil.sim.people.turning import TURNS, turning
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array


def made(style: str, seed: int) -> ActorMotion:
    return turning(style, np.random.default_rng(seed))


def heading(motion: ActorMotion, joint: str) -> Array:
    """(T,) rad about the vertical."""
    _, orientations = motion.skeleton.forward_kinematics(motion.root_in_world, motion.quaternions)
    ahead = rotations.rotate(orientations[:, motion.skeleton.index(joint)], [1.0, 0.0, 0.0])
    return np.arctan2(ahead[:, 1], ahead[:, 0])


@pytest.mark.parametrize("seed", range(6))
def test_the_back_is_shown_first_the_face_last_and_the_head_is_ahead(seed: int) -> None:
    for style in TURNS:
        motion = made(style, seed)
        pelvis, head = heading(motion, "pelvis"), heading(motion, "head")
        assert abs(pelvis[0]) > np.radians(165.0) and abs(pelvis[-1]) < np.radians(6.0)
        assert abs(head[-1]) < np.radians(15.0)
        halfway = np.radians(90.0)
        assert np.argmax(np.abs(head) < halfway) < np.argmax(np.abs(pelvis) < halfway)


@pytest.mark.parametrize("seed", range(6))
def test_before_the_tap_nothing_tells_the_emotion(seed: int) -> None:
    firsts = [made(style, seed) for style in TURNS]
    for other in firsts[1:]:
        np.testing.assert_allclose(other.quaternions[0], firsts[0].quaternions[0], atol=1e-9)
        np.testing.assert_allclose(other.root_in_world[0], firsts[0].root_in_world[0], atol=1e-9)


@pytest.mark.parametrize("style", TURNS)
def test_soles_stay_on_the_floor_joints_within_their_limits_and_no_two_clips_are_alike(style: str) -> None:
    skeleton, clips = avatar_skeleton(), [made(style, seed) for seed in range(4)]
    for motion in clips:
        positions, _ = skeleton.forward_kinematics(motion.root_in_world, motion.quaternions)
        ankles = positions[:, [skeleton.index("left_ankle"), skeleton.index("right_ankle")], 2]
        assert np.ptp(ankles) < 0.01
        hinges = skeleton.to_hinges(motion.quaternions)
        np.testing.assert_allclose(skeleton.clamp(hinges), hinges, atol=1e-6)
        speeds = np.linalg.norm(np.diff(positions, axis=0), axis=-1) * 120.0
        assert speeds.max() < 8.0  # an arm's length, half round in half a second; no joint jumps
    lengths = {len(motion.root_in_world) for motion in clips}
    assert len(lengths) > 1


def test_all_draw_back_fear_most_and_anger_least() -> None:
    def nearer(style: str) -> float:
        return float(np.mean([np.ptp([made(style, n).root_in_world[k, 0] for k in (0, -1)]) *
                              np.sign(made(style, n).root_in_world[-1, 0] - made(style, n).root_in_world[0, 0])
                              for n in range(8)]))  # fmt: skip

    assert nearer("fearful") < nearer("neutral") - 0.1 < nearer("angry") - 0.13 < -0.13
    mean = {style: np.mean([len(made(style, n).root_in_world) for n in range(8)]) for style in TURNS}
    assert mean["angry"] < mean["neutral"] and mean["fearful"] < mean["neutral"]


def test_who_else_is_asked_for_is_one_line() -> None:
    with pytest.raises(HighFiveError, match="does not turn round 'happy'; there are neutral, fearful, angry"):
        made("happy", 1)

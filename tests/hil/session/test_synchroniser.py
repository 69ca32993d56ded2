"""The synchroniser: exact at samples, straight between them, at rest after a pause."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.session.synchroniser import AHEAD_NS, Synchroniser
from highfive.hil.sim.avatar import Pose
from highfive.mocap_bridge.frames import HumanArm, PalmPose
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

FRAME = 8_333_333


def person(time_ns: int) -> HumanArm:
    """A person whose parts all move at 1 m/s along x."""
    x = np.array([1e-9 * time_ns, 0.0, 0.0])
    palm = PalmPose(x, np.array([-1.0, 0, 0]), np.array([0.0, 0, 1]), np.array([1.0, 0, 0]))
    head = rotations.from_axis_angle("z", 1e-9 * time_ns)
    return HumanArm(x, head, x, x, x, x, palm, np.array([x, x]), True, 0, time_ns)


def pose(time_ns: int) -> Pose:
    return Pose(np.full(3, 1e-9 * time_ns), np.full((53, 3), 2e-9 * time_ns))


def filled(offset: int = 0) -> Synchroniser:
    both = Synchroniser()
    for i in range(10):
        both.add(i * FRAME + offset, pose(i * FRAME + offset))
        both.add_person(person(i * FRAME))
    return both


def test_a_sample_comes_back_as_it_was() -> None:
    both = Synchroniser()
    given, arm = pose(FRAME), person(FRAME)
    both.add(FRAME, given)
    both.add_person(arm)
    moment = both.at(FRAME)
    assert moment.pose is given
    assert moment.person is arm


@pytest.mark.parametrize("time", [int(3.25 * FRAME), int(5.9 * FRAME), 9 * FRAME + AHEAD_NS // 2])
def test_both_are_of_the_time_requested(time: int) -> None:
    moment = filled(offset=FRAME // 3).at(time)
    np.testing.assert_allclose(moment.pose.hinges, 2e-9 * time, atol=1e-9)
    np.testing.assert_allclose(moment.person.palm.position[0], 1e-9 * time, atol=1e-9)
    np.testing.assert_allclose(moment.person.head_orientation, rotations.from_axis_angle("z", 1e-9 * time), atol=1e-9)
    assert moment.person.time_ns == time


def test_a_stream_that_stops_stays_where_it_would_have_come_to() -> None:
    both = filled()
    late, later = both.at(9 * FRAME + AHEAD_NS), both.at(9 * FRAME + 10 * AHEAD_NS)
    np.testing.assert_allclose(late.person.wrist, later.person.wrist)
    np.testing.assert_allclose(late.pose.hinges, later.pose.hinges)


def test_old_and_repeated_samples_are_dropped() -> None:
    both = filled()
    both.add(3 * FRAME, replace(pose(0), hinges=np.full((53, 3), 9.0)))
    assert both.at(3 * FRAME).pose.hinges.max() < 1.0


def test_a_stream_that_has_not_begun_is_named() -> None:
    both = Synchroniser()
    with pytest.raises(HighFiveError, match="avatar"):
        both.at(0)
    both.add(0, pose(0))
    with pytest.raises(HighFiveError, match="person"):
        both.at(0)

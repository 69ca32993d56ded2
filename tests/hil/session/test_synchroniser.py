"""The synchroniser: exact at samples, straight between them, at rest after a pause; each stream with its age."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.session.kinds import EVENTS, MARKERS, PEOPLE, POSES, ROTATIONS, VECTORS
from highfive.hil.session.stream import Stream
from highfive.hil.session.synchroniser import Synchroniser
from highfive.hil.sim.avatar import Pose
from highfive.mocap_bridge.frames import HumanArm, MarkerFrame, PalmPose
from highfive.mocap_bridge.sources.timeline import AHEAD_NS
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


def opened() -> tuple[Synchroniser, Stream[Pose], Stream[HumanArm]]:
    server = Synchroniser()
    return server, server.open("avatar", POSES), server.open("person", PEOPLE)


def filled(offset: int = 0) -> tuple[Synchroniser, Stream[Pose], Stream[HumanArm]]:
    server, avatar, human = opened()
    for i in range(10):
        avatar.add(i * FRAME + offset, pose(i * FRAME + offset))
        human.add(i * FRAME, person(i * FRAME))
    return server, avatar, human


def test_a_sample_comes_back_as_it_was() -> None:
    server, avatar, human = opened()
    given_pose, arm = pose(FRAME), person(FRAME)
    avatar.add(FRAME, given_pose)
    human.add(FRAME, arm)
    moment = server.at(FRAME)
    assert moment.of(avatar).value is given_pose
    assert moment.of(human).value is arm
    assert moment["avatar"].age_ns == 0
    assert moment["avatar"].bound_ns == 0


@pytest.mark.parametrize("time", [int(3.25 * FRAME), int(5.9 * FRAME), 9 * FRAME + AHEAD_NS // 2])
def test_all_are_of_the_time_requested(time: int) -> None:
    server, avatar, human = filled(offset=FRAME // 3)
    moment = server.at(time)
    np.testing.assert_allclose(moment.of(avatar).value.hinges, 2e-9 * time, atol=1e-9)
    arm = moment.of(human)
    np.testing.assert_allclose(arm.value.palm.position[0], 1e-9 * time, atol=1e-9)
    np.testing.assert_allclose(arm.value.head_orientation, rotations.from_axis_angle("z", 1e-9 * time), atol=1e-9)
    assert arm.value.time_ns == time
    assert arm.valid


def test_a_stream_that_stops_stays_where_it_would_have_come_to_and_is_not_valid() -> None:
    server, avatar, human = filled()
    late, later = server.at(9 * FRAME + AHEAD_NS), server.at(9 * FRAME + 10 * AHEAD_NS)
    np.testing.assert_allclose(late.of(human).value.wrist, later.of(human).value.wrist)
    np.testing.assert_allclose(late.of(avatar).value.hinges, later.of(avatar).value.hinges)
    assert late.of(human).valid
    assert not later.of(human).valid
    assert later.of(human).age_ns == 10 * AHEAD_NS


def test_a_gap_is_not_valid_in_its_middle() -> None:
    server, avatar, _ = opened()
    avatar.add(0, pose(0))
    avatar.add(200_000_000, pose(200_000_000))
    assert server.at(10_000_000)["avatar"].valid
    assert not server.at(100_000_000)["avatar"].valid


def test_what_says_that_it_is_not_valid_is_not() -> None:
    server, _, human = opened()
    human.add(0, replace(person(0), valid=False))
    human.add(FRAME, person(FRAME))
    assert not server.at(FRAME // 2).of(human).valid
    assert server.at(FRAME).of(human).valid


def test_old_and_repeated_samples_are_dropped() -> None:
    server, avatar, _ = filled()
    avatar.add(3 * FRAME, replace(pose(0), hinges=np.full((53, 3), 9.0)))
    assert server.at(3 * FRAME).of(avatar).value.hinges.max() < 1.0


def test_a_stream_that_has_not_begun_is_named() -> None:
    server, avatar, human = opened()
    assert len(server.at(0)) == 0
    with pytest.raises(HighFiveError, match="avatar"):
        server.at(0).of(avatar)
    avatar.add(0, pose(0))
    assert list(server.at(0)) == ["avatar"]
    with pytest.raises(HighFiveError, match="person"):
        server.at(0).of(human)


def test_two_streams_of_one_name_are_refused_until_one_is_closed() -> None:
    server = Synchroniser()
    first = server.open("EEG", VECTORS)
    with pytest.raises(HighFiveError, match="two streams called 'EEG'"):
        server.open("EEG", VECTORS)
    server.close(first)
    server.open("EEG", VECTORS)


@given(
    st.lists(st.integers(1, 40_000_000), min_size=1, max_size=30),
    st.floats(0.0, 1.0),
    st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)),
)
def test_whatever_moves_straight_is_exact_at_any_time_and_rate(
    steps: list[int], share: float, line: tuple[float, float]
) -> None:
    server = Synchroniser()
    numbers, markers = server.open("numbers", VECTORS), server.open("markers", MARKERS)
    times = [0, *np.cumsum(steps).tolist()]

    def truth(time_ns: int) -> np.ndarray:
        return np.array([line[0] + line[1] * 1e-9 * time_ns, 1.0, 2.0])

    for number, time in enumerate(times):
        numbers.add(time, truth(time))
        points = truth(time)[None]
        frame = MarkerFrame(("RFIN",), points, np.ones(1, dtype=bool), number, time, time, np.zeros((0, 3)))
        markers.add(time, frame)
    at = round(times[-2] + share * (times[-1] - times[-2]))
    moment = server.at(at)
    np.testing.assert_allclose(moment.of(numbers).value, truth(at), atol=1e-9)
    np.testing.assert_allclose(moment.of(markers).value.positions[0], truth(at), atol=1e-9)
    assert moment.of(numbers).age_ns == min(at - times[-2], times[-1] - at)


def test_rotations_turn_evenly() -> None:
    server = Synchroniser()
    turns = server.open("head", ROTATIONS)
    for time in (0, FRAME):
        turns.add(time, rotations.from_axis_angle("z", 1e-8 * time))
    np.testing.assert_allclose(
        server.at(FRAME // 4).of(turns).value, rotations.from_axis_angle("z", 1e-8 * (FRAME // 4)), atol=1e-12
    )


def test_a_marker_that_one_frame_does_not_see_is_not_seen_between() -> None:
    server = Synchroniser()
    markers = server.open("markers", MARKERS)
    for k, seen in enumerate(([True, True], [True, False])):
        points, valid = np.full((2, 3), float(k)), np.array(seen)
        names = ("RFIN", "RWRA")
        markers.add(k * FRAME, MarkerFrame(names, points, valid, k, k * FRAME, 0, np.zeros((0, 3))))
    assert server.at(FRAME // 2).of(markers).value.valid.tolist() == [True, False]


def test_an_event_holds_until_the_next_one() -> None:
    server = Synchroniser()
    events = server.open("PsychoPy", EVENTS)
    events.add(1_000, "start")
    assert "PsychoPy" not in server.at(999)
    events.add(5_000_000_000, "end")
    assert server.at(4_999_999_999).of(events).value == "start"
    assert server.at(4_999_999_999).of(events).age_ns == 4_999_998_999
    assert server.at(60_000_000_000).of(events).value == "end"

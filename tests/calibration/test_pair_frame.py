"""Any unit, axes and place in the room: the same scene comes out."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.calibration.pair_frame import find_frame, place_trial
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

SKELETON = avatar_skeleton()
CENTRES = load_marker_set("joint_centres")
Z_UP, Y_UP, MINUS_Z = np.eye(3), np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]]), np.diag([1.0, -1.0, -1.0])


def standing(x, yaw, frames=20):
    """Someone at (x, 0) who faces ``yaw`` and lifts an arm."""
    angles = np.zeros((frames, len(SKELETON), 3))
    angles[:, 0, 0] = yaw
    angles[:, SKELETON.index("right_shoulder"), 0] = np.linspace(0.0, -1.5, frames)
    root = np.tile([x, 0.0, SKELETON.offsets[0, 2]], (frames, 1))
    points = CENTRES.simulate(SKELETON, *SKELETON.forward_kinematics(root, SKELETON.from_hinges(angles)))
    return make_recording(30.0, CENTRES.names, points, np.ones(points.shape[:2], dtype=bool))


PAIR = (standing(1.1, np.pi), standing(0.0, 0.0))


def moved(recording, scale, axes, turn, shift):
    points = rotations.rotate(rotations.from_axis_angle("z", turn), recording.points) + shift
    return replace(recording, points=scale * points @ axes.T)


@pytest.mark.parametrize(("scale", "axes"), [(1.0, Y_UP), (1e3, Z_UP), (0.1, MINUS_Z), (1.0, np.diag([1, -1, 1.0]))])
def test_a_scene_comes_back_from_wherever_it_was_recorded(scale, axes):
    somewhere = [tuple(moved(r, scale, axes, turn, [turn, 3.0, 0.4]) for r in PAIR) for turn in (0.3, -2.0, 2.9)]
    frame = find_frame(somewhere, CENTRES, CENTRES)
    assert not frame.in_world
    assert frame.mirrored == (np.linalg.det(axes) < 0)
    assert frame.scale == pytest.approx(1.0 / scale)
    for person, actor in somewhere:
        placed = place_trial(frame.apply(person), frame.apply(actor), CENTRES, CENTRES)
        for recording, truth in zip(placed, PAIR, strict=True):
            np.testing.assert_allclose(recording.points, truth.points, atol=1e-6)


def test_recordings_in_the_world_are_not_touched():
    frame = find_frame([PAIR], CENTRES, CENTRES)
    assert frame.in_world
    assert frame.apply(PAIR[0]) is PAIR[0]


def test_a_trial_that_does_not_show_where_the_person_stands_is_a_matter_for_itself():
    arm = ["shoulder" in joint or "elbow" in joint or "wrist" in joint for joint in CENTRES.joints]
    blind = (replace(PAIR[0], valid=PAIR[0].valid & np.array(arm)), PAIR[1])
    assert find_frame([PAIR, blind], CENTRES, CENTRES).in_world
    elsewhere = [tuple(moved(r, 1.0, Z_UP, 0.3, [1.0, 3.0, 0.0]) for r in pair) for pair in (PAIR, blind)]
    assert not find_frame(elsewhere, CENTRES, CENTRES).in_world
    with pytest.raises(HighFiveError, match="never shows the pelvis, the hips or the head of both people at once"):
        place_trial(*elsewhere[1], CENTRES, CENTRES)


def test_a_trial_that_never_shows_both_is_refused():
    blind = replace(PAIR[0], valid=np.zeros_like(PAIR[0].valid))
    with pytest.raises(HighFiveError, match="of both people at once"):
        place_trial(blind, PAIR[1], CENTRES, CENTRES)


def test_a_tilted_room_is_put_upright():
    tilt = rotations.to_matrix(rotations.from_axis_angle("y", 0.6))
    tilted = tuple(moved(r, 1.0, tilt, 0.0, np.zeros(3)) for r in PAIR)
    frame = find_frame([tilted], CENTRES, CENTRES)
    up = frame.apply(tilted[1]).points[0, CENTRES.indices(["head_top", "pelvis"])] @ np.array([0, 0, 1.0])
    assert up[0] - up[1] == pytest.approx(0.80, abs=0.03)


def test_only_the_start_of_a_trial_places_it():
    """What happens later is what a model has to tell; it must not leak into the frame."""
    person, actor = (moved(r, 1.0, Z_UP, 1.0, np.zeros(3)) for r in PAIR)
    later = np.arange(20) >= 10
    elsewhere = replace(
        actor, points=np.where(later[:, None, None], actor.points + np.array([0.5, 0.3, 0.0]), actor.points)
    )
    one, other = (place_trial(person, a, CENTRES, CENTRES)[0].points for a in (actor, elsewhere))
    np.testing.assert_array_equal(one, other)

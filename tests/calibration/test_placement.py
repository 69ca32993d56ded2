from dataclasses import replace

import numpy as np
import pytest

from highfive.calibration.placement import PLACEMENT, Placement, place_before_camera, place_person
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

SKELETON = avatar_skeleton()
PAPER, FULL = load_marker_set("paper"), load_marker_set("full_body")


def high_five(marker_set, forward=True, frames=60):
    """A simulated person (or the avatar's actor) in the world who raises the right hand and lowers it again."""
    lift = 0.5 - 0.5 * np.cos(np.linspace(0, 2 * np.pi, frames))
    angles = np.zeros((frames, len(SKELETON), 3))
    angles[:, 0, 0] = np.pi if forward else 0.0
    angles[:, SKELETON.index("right_shoulder"), 0] = -1.5 * lift
    angles[:, SKELETON.index("right_shoulder"), 2] = 0.4 * lift
    angles[:, SKELETON.index("right_elbow"), 0] = -0.2 - 0.9 * lift
    root = np.tile([1.05 if forward else 0.0, 0.0, SKELETON.offsets[0, 2]], (frames, 1))
    points = marker_set.simulate(SKELETON, *SKELETON.forward_kinematics(root, SKELETON.from_hinges(angles)))
    return make_recording(120.0, marker_set.names, points, np.ones(points.shape[:2], dtype=bool))


def moved(recording, turn, shift):
    return replace(recording, points=rotations.rotate(turn, recording.points) + shift)


# y up, z up and x down, each turned about the vertical and shifted on the floor.
ELSEWHERE = [
    (
        rotations.multiply(rotations.from_axis_angle("x", -np.pi / 2), rotations.from_axis_angle("z", 2.0)),
        np.array([2.0, 0.0, -1.0]),
    ),
    (rotations.from_axis_angle("z", -1.0), np.array([-1.0, 3.0, 0.0])),
    (
        rotations.multiply(rotations.from_axis_angle("y", -np.pi / 2), rotations.from_axis_angle("z", 0.5)),
        np.array([0.0, 1.0, 4.0]),
    ),
]


@pytest.mark.parametrize(("turn", "shift"), ELSEWHERE)
def test_a_recorded_pair_comes_back_to_its_place_in_the_world(turn, shift):
    person, partner = high_five(FULL), high_five(FULL, forward=False)
    placement = place_person(moved(person, turn, shift), FULL, moved(partner, turn, shift))
    again = placement.apply_to(moved(person, turn, shift))
    # The pelvis' markers lie a few millimetres off its centre, the lowest ones two centimetres above the floor.
    np.testing.assert_allclose(again.points[..., :2], person.points[..., :2], atol=0.01)
    np.testing.assert_allclose(again.points[..., 2], person.points[..., 2], atol=0.04)


@pytest.mark.parametrize("marker_set", [PAPER, FULL])
def test_without_a_partner_the_hand_comes_to_a_comfortable_place(marker_set):
    turn, shift = ELSEWHERE[1]
    person = moved(high_five(marker_set), turn, shift)
    placement = place_person(person, marker_set)
    points = placement.apply(person.points)
    fingers = points[30, marker_set.index("RFIN")]
    assert 0.25 < fingers[0] < 0.65
    assert abs(fingers[1]) < 0.1
    head = points[30, marker_set.index("LFHD")]
    assert PLACEMENT.nearest - 0.2 < head[0] < PLACEMENT.furthest + 0.1
    assert head[2] == pytest.approx(high_five(marker_set).points[30, marker_set.index("LFHD"), 2], abs=0.04)


def test_it_is_rigid_and_says_what_it_rests_on():
    person = high_five(FULL)
    placement = place_person(person, FULL)
    points = placement.apply(person.points)
    gaps = np.linalg.norm(np.diff(points, axis=1), axis=-1)
    np.testing.assert_allclose(gaps, np.linalg.norm(np.diff(person.points, axis=1), axis=-1), atol=1e-12)
    assert len(placement.notes) == 3


def test_missing_markers_are_named():
    person = high_five(PAPER)
    without = make_recording(120.0, person.names[:-2], person.points[:, :-2], person.valid[:, :-2])
    with pytest.raises(HighFiveError, match="RFIN"):
        place_person(without, PAPER)
    with pytest.raises(HighFiveError, match="never seen together"):
        place_person(person, PAPER, replace(person, valid=np.zeros_like(person.valid)))


@pytest.mark.data
@pytest.mark.parametrize(("human", "partner"), [("A", "B"), ("B", "A")])
def test_the_real_high_five_happens_in_front_of_the_avatar(recordings, human, partner):
    recording = read_c3d(recordings / "high_five" / "cmu_20_21_11_high_five.c3d")
    centres = load_marker_set("cmu_joint_centres")
    placement = place_person(recording.person(human), centres, recording.person(partner))
    placed = placement.apply_to(recording)
    hand, root = (placed.points[:, placed.names.index(f"{human}:{name}")] for name in ("rfingers", "root"))
    assert 0.4 < hand[80, 0] < 0.65
    assert abs(hand[80, 1]) < 0.1
    assert 1.7 < hand[80, 2] < 1.95
    assert root[80, 0] == pytest.approx(1.02, abs=0.02)
    assert root[80, 1] == pytest.approx(0.0, abs=1e-9)


def test_covariances_turn_with_the_points():
    """Many points about one, moved into the world: their covariance is the one that was turned."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    cloud = rng.multivariate_normal(np.zeros(3), root @ root.T, 1000)
    placement = Placement(rotations.from_rotation_vector(rng.normal(size=3)), rng.normal(size=3), ())
    turned = placement.turned(np.stack([np.cov(cloud.T), np.eye(3)]))
    np.testing.assert_allclose(turned[0], np.cov(placement.apply(cloud).T), atol=1e-12)
    np.testing.assert_allclose(turned[1], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("heading", [0.0, 0.3, -0.5])
def test_before_one_camera_the_avatar_stands_towards_it_whatever_one_picture_says_of_depth(heading):
    person, turn = high_five(FULL), rotations.from_axis_angle("z", heading)
    camera = rotations.rotate(turn, [-1.0, 0.0, 1.25])
    seen = moved(person, turn, np.zeros(3))
    wrong = seen.points.copy()
    wrong[len(wrong) // 3] += 0.4 * (camera - wrong[len(wrong) // 3])  # a picture in which all came nearer
    placement = place_before_camera(replace(seen, points=wrong), FULL, camera)
    again = placement.apply(seen.points)
    head = again[:, FULL.indices(FULL.arm.head)].mean(axis=(0, 1))
    assert abs(head[1]) < 0.02 and 0.85 < head[0] < 1.25
    np.testing.assert_allclose(again[..., 2], person.points[..., 2], atol=1e-9)
    assert placement.apply(camera)[0] < 0.0 and not placement.guesses

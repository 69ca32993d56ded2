import ezc3d
import numpy as np
import pytest

from hil.avatar import avatar_skeleton
from mocap_bridge.marker_sets import FOLDER, find_marker_set, load_marker_set, marker_set_names, segment_lengths
from model import rotations
from model.errors import HighFiveError
from scenes import anthropometry

SKELETON = avatar_skeleton()
ZERO = np.tile(rotations.IDENTITY, (len(SKELETON), 1))
CENTRES, UPRIGHT = SKELETON.forward_kinematics(SKELETON.offsets[0], ZERO)


@pytest.fixture(params=marker_set_names())
def marker_set(request):
    return load_marker_set(request.param)


def test_the_sets_that_come_with_the_project():
    assert marker_set_names() == ["cmu_joint_centres", "full_body", "joint_centres", "paper", "plug_in_gait"]
    paper = load_marker_set("paper")
    assert len(paper) == 16
    assert sum("head" in roles for roles in paper.roles) == 5
    assert len(load_marker_set("cmu_joint_centres")) == 31


def test_the_reference_segments_are_those_of_the_anthropometric_table(marker_set):
    lengths = segment_lengths(SKELETON)
    for joint, segment in marker_set.segments.items():
        j = SKELETON.index(joint)
        assert segment.length == pytest.approx(lengths[j], abs=1e-5)
        np.testing.assert_allclose(segment.centre, CENTRES[j], atol=1e-5)
        above = SKELETON.parents[j]
        while above >= 0 and SKELETON.names[above] not in marker_set.segments:
            above = SKELETON.parents[above]
        assert segment.parent == (SKELETON.names[above] if above >= 0 else None)


def test_palm_and_knuckles_are_those_of_the_avatars_hand(marker_set):
    palm = [0.0, anthropometry.PALM_THICKNESS / 2, -anthropometry.PALM_CENTRE]
    np.testing.assert_allclose(marker_set.arm.palm_in_hand, palm)
    knuckles = [CENTRES[SKELETON.index(f"right_{f}_1")] for f in ("index", "middle", "ring", "little")]
    wrist = CENTRES[SKELETON.index("right_wrist")]
    np.testing.assert_allclose(marker_set.arm.knuckles_in_hand, np.mean(knuckles, axis=0) - wrist, atol=1e-3)


def test_markers_lie_on_the_body(marker_set):
    """No marker is further from its segment than a body is thick, and left mirrors right."""
    positions = marker_set.simulate(SKELETON, CENTRES, UPRIGHT)
    assert positions[:, 2].min() > -0.005
    assert positions[:, 2].max() < anthropometry.HEIGHT + 0.02
    for m, joint in enumerate(marker_set.joints):
        if joint.startswith("right_"):
            prefix, rest = marker_set.names[m][0], marker_set.names[m][1:]
            mirror = {"R": "L", "r": "l"}[prefix] + rest
            if mirror in marker_set.names:
                np.testing.assert_allclose(positions[marker_set.index(mirror)], positions[m] * [1, -1, 1], atol=1e-9)


def test_a_scaled_body_carries_its_markers_along(marker_set):
    big = SKELETON.scaled(1.1)
    centres, upright = big.forward_kinematics(big.offsets[0], ZERO)
    expected = 1.1 * marker_set.simulate(SKELETON, CENTRES, UPRIGHT)
    np.testing.assert_allclose(marker_set.simulate(big, centres, upright), expected, atol=1e-9)


def test_moving_the_body_moves_the_markers_rigidly(marker_set):
    rng = np.random.default_rng(0)
    angles = SKELETON.clamp(rng.normal(scale=0.3, size=(len(SKELETON), 3)))
    pose = SKELETON.from_hinges(angles)
    turn, shift = rotations.normalize(rng.normal(size=4)), rng.normal(size=3)
    here = marker_set.simulate(SKELETON, *SKELETON.forward_kinematics(np.zeros(3), pose))
    moved_pose = pose.copy()
    moved_pose[0] = rotations.multiply(turn, pose[0])
    there = marker_set.simulate(SKELETON, *SKELETON.forward_kinematics(shift, moved_pose))
    np.testing.assert_allclose(there, rotations.rotate(turn, here) + shift, atol=1e-12)


def test_labels_are_found_by_name_in_any_order_and_by_alias():
    paper = load_marker_set("paper")
    labels = list(reversed(paper.names))
    np.testing.assert_array_equal(paper.match(labels), np.arange(16)[::-1])
    labels[labels.index("THD")] = "ARIEL"
    assert labels[paper.match(labels)[paper.index("THD")]] == "ARIEL"
    points = np.random.default_rng(0).normal(size=(4, 16, 3))
    arranged, valid = paper.arrange(labels, points, np.ones((4, 16), dtype=bool))
    np.testing.assert_array_equal(arranged, points[:, ::-1])
    assert valid.all()


def test_missing_markers_are_named():
    paper = load_marker_set("paper")
    nothing = np.zeros((1, 2, 3))
    with pytest.raises(HighFiveError, match=r"needs RFIN; the recording has RWRA, RWRB"):
        paper.arrange(["RWRA", "RWRB"], nothing, np.ones((1, 2), dtype=bool), required=("RFIN", "RWRA"))
    _, valid = paper.arrange(["RWRA", "RWRB"], nothing, np.ones((1, 2), dtype=bool))
    assert valid.sum() == 2


def test_a_subset_keeps_the_arm_and_the_chain():
    full = load_marker_set("full_body")
    part = full.subset(full.arm.markers)
    assert set(part.names) == set(full.arm.markers)
    assert part.segments["right_wrist"].parent == "right_elbow"
    assert part.segments["head"].parent is None
    with pytest.raises(HighFiveError, match="without RFIN"):
        full.subset([name for name in full.names if name != "RFIN"])


@pytest.mark.data
@pytest.mark.parametrize(
    ("file", "person", "expected"),
    [
        ("high_five/cmu_20_21_11_high_five", "B:", "cmu_joint_centres"),
        ("markers/85_12", "Male:", "plug_in_gait"),
        ("markers/Movement_trial", "", "plug_in_gait"),
    ],
)
def test_the_set_of_a_real_file_is_found_by_its_labels(recordings, file, person, expected):
    labels = ezc3d.c3d(str(recordings / f"{file}.c3d"))["parameters"]["POINT"]["LABELS"]["value"]
    found = find_marker_set([label.removeprefix(person) for label in labels if label.startswith(person)])
    assert found.name == expected


def test_unknown_sets_are_refused():
    with pytest.raises(HighFiveError, match="cmu_joint_centres, full_body, joint_centres, paper, plug_in_gait"):
        load_marker_set("vicon")
    with pytest.raises(HighFiveError, match="no marker set fits the labels a, b"):
        find_marker_set(["a", "b"])


PAPER = (FOLDER / "paper.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("= 3", "cannot read"),
        ('name = "x"', "entry 'markers' is missing"),
        (PAPER.replace("position = [0.0850, 0.0650, 0.1000]", "position = [0.0850]"), "three numbers"),
        (PAPER.replace('name = "RFIN"', 'name = "XFIN"'), "not in the set: RFIN"),
        (PAPER.replace('name = "RWRA"', 'name = "RWRB"'), "occur twice: RWRB"),
        (PAPER.replace("\nhead = { length", "\nneck = { length"), "'head' is missing"),
        (PAPER.replace("length = 0.11549", "length = -1"), "must be positive"),
    ],
)
def test_a_broken_file_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "lab.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(HighFiveError) as caught:
        load_marker_set(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_laboratorys_own_file_is_read(tmp_path):
    path = tmp_path / "lab.toml"
    path.write_text(PAPER, encoding="utf-8")
    assert load_marker_set(path).names == load_marker_set("paper").names

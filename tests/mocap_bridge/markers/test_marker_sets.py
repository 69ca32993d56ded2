import tomllib
from dataclasses import fields, is_dataclass, replace

import ezc3d
import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.frames import TrackedMarkers
from highfive.mocap_bridge.markers.joint_centres import joint_centre_set
from highfive.mocap_bridge.markers.marker_set import segment_lengths
from highfive.mocap_bridge.markers.marker_set_file import FOLDER, load_marker_set, marker_set_names, write_marker_set
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.scenes import anthropometry

SKELETON = avatar_skeleton()
ZERO = np.tile(rotations.IDENTITY, (len(SKELETON), 1))
CENTRES, UPRIGHT = SKELETON.forward_kinematics(SKELETON.offsets[0], ZERO)


@pytest.fixture(params=marker_set_names())
def marker_set(request):
    return load_marker_set(request.param)


def test_the_sets_that_come_with_the_project():
    assert marker_set_names() == [
        "cmu_joint_centres", "full_body", "headset", "joint_centres", "paper", "plug_in_gait", "plug_in_gait_upper",
        "upper_limb",
    ]  # fmt: skip
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
            mirror = {"R": "L", "r": "l"}.get(prefix, "no ") + rest
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
    with pytest.raises(HighFiveError, match=r"needs RFIN \(hand\); the recording has RWRA, RWRB"):
        paper.arrange(["RWRA", "RWRB"], nothing, np.ones((1, 2), dtype=bool), required=("RFIN", "RWRA"))
    labels = [f"T{m}" for m in range(20)] + ["LELB_1", "RELB_1"]
    with pytest.raises(HighFiveError) as said:
        paper.arrange(labels, np.zeros((1, 22, 3)), np.ones((1, 22), dtype=bool), required=("RELB",))
    assert "needs RELB (elbow); the recording has RELB_1, LELB_1, T0, " in str(said.value)
    assert """RELB, give it as an alias in the set's TOML (aliases = ["RELB_1"])""" in str(said.value)
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
        ("markers/85_02", "Male:", "plug_in_gait"),
        ("markers/85_12", "Male:", "plug_in_gait"),
        ("markers/markers_analogs", "Daphnee:", "upper_limb"),
        ("markers/Movement_trial", "", "plug_in_gait"),
    ],
)
def test_the_set_of_a_real_file_is_found_by_its_labels(recordings, file, person, expected):
    labels = ezc3d.c3d(str(recordings / f"{file}.c3d"))["parameters"]["POINT"]["LABELS"]["value"]
    found = find_marker_set([label.removeprefix(person) for label in labels if label.startswith(person)])
    assert found.name == expected


def test_every_shipped_set_is_found_by_its_own_labels_in_any_order(marker_set):
    names = list(marker_set.names)
    for order in (names, names[::-1], sorted(names), [*names, "SPARE", "box:corner"]):
        assert find_marker_set(order).name == marker_set.name


def test_every_shipped_set_is_found_by_its_aliases(marker_set):
    """Sets share labels: what a laboratory's spelling of one set says must not say another one."""
    labels = [
        aliases[0] if aliases else name for name, aliases in zip(marker_set.names, marker_set.aliases, strict=True)
    ]
    assert find_marker_set(labels).name == marker_set.name


def test_plug_in_gait_without_legs_is_its_upper_body():
    whole, upper = load_marker_set("plug_in_gait"), load_marker_set("plug_in_gait_upper")
    above = [name for name, joint in zip(whole.names, whole.joints, strict=True) if "_hip" not in joint]
    trunk = [m for m, joint in enumerate(whole.joints) if joint.startswith(("head", "thoracic", "right_cl"))]
    assert {whole.names[m] for m in trunk} < set(upper.names) < set(above)
    assert find_marker_set([name for name in above if name in upper.names]).name == "plug_in_gait_upper"
    assert find_marker_set([*upper.names, "RKNE"]).name == "plug_in_gait"
    centres = CENTRES - CENTRES[SKELETON.index("pelvis")]
    for name in upper.names:
        here, there = (
            centres[SKELETON.index(s.joints[s.index(name)])] + s.local_positions[s.index(name)] for s in (upper, whole)
        )
        np.testing.assert_allclose(here, there, atol=1e-9)


def test_a_set_without_head_markers_has_the_head_where_an_upright_trunk_carries_it():
    arm, marker_set = load_marker_set("upper_limb").arm, load_marker_set("upper_limb")
    trunk = {marker_set.joints[m] for m in marker_set.indices(arm.head)}
    assert trunk == {"thoracic_8"}
    usual = CENTRES[SKELETON.index("head")] + load_marker_set("paper").arm.centre_in_head
    np.testing.assert_allclose(CENTRES[SKELETON.index("thoracic_8")] + arm.centre_in_head, usual, atol=1e-3)
    points = marker_set.simulate(SKELETON, CENTRES, UPRIGHT)
    count = len(marker_set)
    tracked = TrackedMarkers(
        marker_set.names, points, np.zeros((count, 3)), np.zeros((count, 3, 3)), np.ones(count, dtype=bool),
        np.zeros(count, dtype=np.int64), np.ones(count, dtype=bool), np.zeros(count, dtype=bool), 0,
    )  # fmt: skip
    found = HumanArmEstimator(marker_set)(tracked)
    np.testing.assert_allclose(found.head_position, usual, atol=2e-3)
    for joint, limit in (("shoulder", 0.02), ("elbow", 0.01), ("wrist", 0.01)):
        assert np.linalg.norm(getattr(found, joint) - CENTRES[SKELETON.index(f"right_{joint}")]) < limit
    assert found.palm.normal @ [0.0, 1.0, 0.0] > 0.95


@pytest.mark.parametrize("name", marker_set_names())
def test_a_set_says_which_of_its_markers_lie_on_the_head(name):
    found = load_marker_set(name)
    expected = {"upper_limb": (), "joint_centres": ("head",), "cmu_joint_centres": ("head",)}
    assert found.on_head == expected.get(name, found.arm.head)


@pytest.mark.parametrize(
    ("points", "on_head"),
    [
        (("upper_neck",), ()),
        (("neck", "upper_neck"), ()),
        (("neck", "head"), ("head",)),
        (("neck", "nose"), ("nose",)),
        (("neck", "upper_neck", "left_ear", "right_ear"), ("left_ear",)),
        (("neck", "left_eye", "right_eye"), ("left_eye",)),
    ],
)
def test_a_neck_is_no_point_on_the_head_of_joint_centres(points, on_head):
    """Recognised by their own names; where only necks are there, the head is taken from the neck or from its top."""
    body = ("pelvis", "left_shoulder", "right_shoulder", "right_elbow", "right_wrist", "right_hand")
    labels = [*body, *points]
    found = joint_centre_set(load_marker_set("joint_centres"), labels, {label: label for label in labels})
    assert found.on_head == on_head


def test_every_marker_says_what_it_is_needed_for(marker_set):
    known = {"head", "shoulder", "upper_arm", "elbow", "forearm", "wrist", "hand", "finger", "body"}
    assert all(roles and set(roles) <= known for roles in marker_set.roles)
    arm = marker_set.arm
    for role, names in (("head", arm.head), ("wrist", arm.wrist), ("hand", arm.hand), ("elbow", arm.elbow)):
        assert all(role in marker_set.roles[m] for m in marker_set.indices(names)), role


def same(one, other):
    """Whether two sets, or parts of them, hold the same values."""
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other)
    if is_dataclass(one):
        return all(same(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    return one == other


def test_what_was_written_is_read_again_number_by_number(marker_set, tmp_path):
    path = tmp_path / "again.toml"
    write_marker_set(path, marker_set, {"source": r'the "best"\ take.c3d', "residuals_mm": {"RFIN": 1.25}})
    assert same(load_marker_set(path), marker_set)
    subject = tomllib.loads(path.read_text(encoding="utf-8"))["subject"]
    assert subject == {"source": r'the "best"\ take.c3d', "residuals_mm": {"RFIN": 1.25}}


def test_any_number_survives_writing_and_reading(tmp_path):
    paper, rng = load_marker_set("paper"), np.random.default_rng(0)
    moved = replace(paper, name="zwölf\n", local_positions=paper.local_positions + rng.normal(size=(16, 3)))
    write_marker_set(tmp_path / "moved.toml", moved)
    assert same(load_marker_set(tmp_path / "moved.toml"), moved)
    assert not same(load_marker_set(tmp_path / "moved.toml"), paper)
    with pytest.raises(HighFiveError, match="cannot write"):
        write_marker_set(tmp_path / "moved.toml" / "deeper.toml", moved)


def test_unknown_sets_are_refused():
    with pytest.raises(
        HighFiveError, match="cmu_joint_centres, full_body, headset, joint_centres, paper, plug_in_gait"
    ):
        load_marker_set("vicon")
    with pytest.raises(HighFiveError, match="no marker set fits the labels a, b"):
        find_marker_set(["a", "b"])
    with pytest.raises(HighFiveError, match="the nearest, paper, wants RBHD, THD, RSHO"):
        find_marker_set(["LFHD", "RFHD", "LBHD", "RUPB"])


PAPER = (FOLDER / "paper.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("= 3", "cannot read"),
        ('name = "x"', "entry 'markers' is missing"),
        ("markers = [1, 2, nan]", "markers has 1; each is a table"),
        ("markers = 3", "markers has 3; each is a table"),
        (PAPER.replace("position = [0.0850, 0.0650, 0.1000]", "position = [0.0850]"), "three numbers"),
        (PAPER.replace('name = "RFIN"', 'name = "XFIN"'), "not in the set: RFIN"),
        (PAPER.replace('name = "RWRA"', 'name = "RWRB"'), "occur twice: RWRB"),
        (PAPER.replace("\nhead = { length", "\nneck = { length"), "lacks the joints that markers name: head; it has"),
        (PAPER.replace("length = 0.11549", "length = -1"), "must be positive"),
        (PAPER.replace("\nhead = { markers", "\nskull = { markers"), "has no head; where it bears no markers"),
        (PAPER.replace('elbow = { markers = ["RELB", "RELM"]', "elbow = { markers = []"), "no marker of the elbow"),
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

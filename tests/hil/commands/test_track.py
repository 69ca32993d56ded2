"""``highfive track``: what is filled, what the angles are worth, and what it says when it cannot."""

import csv
import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from command_line import running
from simulated_reach import RATE_HZ, Reach, simulated_reach

from highfive.hil.commands.track import TrackOptions, print_track, track
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.joint_angles import ANGLES
from highfive.mocap_bridge.tracking.tracker import Tracker

HAND = ("RFIN", "RMC5")


def quiet(label, total):
    return lambda: None


@pytest.fixture(scope="module")
def reach(tmp_path_factory: pytest.TempPathFactory) -> Reach:
    return simulated_reach(tmp_path_factory.mktemp("reach") / "reach.c3d", HAND, noise=0.001)


@pytest.fixture(scope="module")
def result(reach: Reach, tmp_path_factory: pytest.TempPathFactory) -> dict:
    return track(TrackOptions(reach.path, out=tmp_path_factory.mktemp("tracked")), quiet)


def filled_file(result: dict) -> Path:
    return Path(result["folder"]) / result["files"]["filled"]


def test_hidden_markers_are_filled_near_the_truth(reach: Reach, result: dict):
    filled = read_c3d(filled_file(result))
    assert filled.valid.all()
    error = np.linalg.norm(filled.points - reach.markers, axis=-1)[~reach.there]
    assert np.sqrt((error**2).mean()) < 0.008
    assert error.max() < 0.025


def test_what_was_measured_stays_and_residuals_tell_it_from_what_was_filled(reach: Reach, result: dict):
    before, after = read_c3d(reach.path), read_c3d(filled_file(result))
    assert after.names == before.names
    np.testing.assert_array_equal(after.points[reach.there], before.points[reach.there])
    residuals = ezc3d.c3d(str(filled_file(result)))["data"]["meta_points"]["residuals"][0].T
    np.testing.assert_array_equal(residuals > 0.0, reach.there)
    np.testing.assert_array_equal(residuals == 0.0, ~reach.there)


def test_the_summary_counts_what_was_hidden(reach: Reach, result: dict):
    assert result["marker_set"] == "paper"
    assert result["person"] == "human"
    assert result["hidden_points"] == result["filled_points"] == (~reach.there).sum()
    assert result["gaps"] == 2 * 4
    assert result["markers"]["RFIN"]["longest_gap_ms"] == pytest.approx(300.0)
    assert result["markers"]["RSHO"]["gaps"] == 0
    assert result["residual_mm"]["median"] < 2.0
    assert result["missing"] == result["unused"] == []
    assert result["markers"]["RSHO"]["filled_sd_mm"] is None
    assert 0.0 < result["markers"]["RFIN"]["filled_sd_mm"]["median"] < 25.0
    assert json.loads((Path(result["folder"]) / "report.json").read_text(encoding="utf-8")) == result


@pytest.mark.parametrize(
    ("name", "blank"),
    [("plug_in_gait_upper", {"carrying_angle"}), pytest.param("upper_limb", set(), marks=pytest.mark.slow)],
)
def test_the_angles_are_the_persons(name: str, blank: set[str], tmp_path: Path):
    """Plug-in Gait has one marker at the elbow, which does not show its axis."""
    reach = simulated_reach(tmp_path / "reach.c3d", name=name, noise=0.0005, frames=300)
    result = track(TrackOptions(reach.path, out=tmp_path / "out"), quiet)
    assert result["marker_set"] == name
    with (Path(result["folder"]) / result["files"]["angles"]).open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["time_s", *(f"{name}{end}" for name in ANGLES for end in ("_deg", "_sd_deg"))]
    np.testing.assert_allclose([float(row["time_s"]) for row in rows], np.arange(len(rows)) / RATE_HZ, atol=1e-6)
    assert {row["angle"] for row in result["angles_not_seen"]} == blank
    for i, angle in enumerate(ANGLES):
        if angle in blank:
            assert sum(row[f"{angle}_deg"] == "" for row in rows) > 0.3 * len(rows)
            assert all((row[f"{angle}_deg"] == "") == (row[f"{angle}_sd_deg"] == "") for row in rows)
            continue
        found = np.array([float(row[f"{angle}_deg"]) for row in rows])
        error = (found - reach.angles[:, i] + 180.0) % 360.0 - 180.0
        assert np.sqrt((error[20:] ** 2).mean()) < 1.0, angle
        assert all(0.0 < float(row[f"{angle}_sd_deg"]) < 20.0 for row in rows)


@pytest.mark.slow
def test_a_file_without_gaps_comes_back_as_it_was(tmp_path: Path):
    whole = simulated_reach(tmp_path / "whole.c3d", frames=60)
    result = track(TrackOptions(whole.path, out=tmp_path / "out"), quiet)
    assert result["hidden_points"] == 0
    np.testing.assert_allclose(read_c3d(filled_file(result)).points, read_c3d(whole.path).points, atol=1e-4)
    assert filled_file(result).read_bytes() == whole.path.read_bytes()


class Page(HTMLParser):
    """Finds out whether a page is whole and stands alone."""

    def __init__(self, text: str):
        super().__init__()
        self.open, self.counts, self.outside = [], {}, []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.counts[tag] = self.counts.get(tag, 0) + 1
        self.outside += [value for name, value in attrs if name in ("src", "href") and not value.startswith("#")]
        if tag not in ("meta", "br", "img", "link"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.counts[tag] = self.counts.get(tag, 0) + 1

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_report_is_one_whole_page_with_its_pictures_in_it(result: dict):
    folder = Path(result["folder"])
    page = Page((folder / result["files"]["report"]).read_text(encoding="utf-8"))
    assert page.open == []
    assert page.outside == []
    assert page.counts["svg"] == 4
    assert page.counts["table"] == 2
    pictures = sorted(path.name for path in (folder / "figures").iterdir())
    assert pictures == ["gaps.png", "joint_angles.png", "residuals.png", "skeleton.png"]


@pytest.mark.slow
def test_what_no_one_can_know_is_left_open(tmp_path: Path):
    """Everything is hidden for a while: no estimate is worth anything, and the gap stays."""
    whole = simulated_reach(tmp_path / "whole.c3d", frames=300)
    recording = read_c3d(whole.path)
    recording.valid[60:240] = False
    write_c3d(tmp_path / "gone.c3d", recording)
    result = track(TrackOptions(tmp_path / "gone.c3d", out=tmp_path / "out"), quiet)
    filled = read_c3d(filled_file(result))
    assert not filled.valid[150].any()
    assert filled.valid[[30, 270]].all()
    assert 0 < result["filled_points"] < result["hidden_points"]


@pytest.mark.slow
def test_other_people_channels_and_loose_points_are_left_alone(tmp_path: Path, reach: Reach):
    own = read_c3d(reach.path)
    stranger = np.tile(np.array([2.0, 0.0, 1.0]), (len(own), 1, 1))
    there = np.ones((len(own), 1), dtype=bool)
    there[50:60] = False
    both = make_recording(
        RATE_HZ, [*own.names, "box:corner"], np.concatenate([own.points, stranger], axis=1),
        np.concatenate([own.valid, there], axis=1),
    )  # fmt: skip
    write_c3d(tmp_path / "both.c3d", both)
    result = track(TrackOptions(tmp_path / "both.c3d", out=tmp_path / "out"), quiet)
    assert result["person"] == "human"  # the box has no arm
    assert result["other_persons"] == ["box"]
    filled = read_c3d(filled_file(result))
    np.testing.assert_array_equal(filled.valid[:, -1], there[:, 0])
    assert filled.valid[:, :-1].all()


@pytest.mark.parametrize(("frames", "shown"), [(1, 16), (2, 16), (40, 3), (40, 1)])
@pytest.mark.slow
def test_very_little_to_go_by_is_no_error(tmp_path: Path, frames: int, shown: int):
    """One frame, or too few markers for a pose: the report says so, nothing is made up."""
    whole = read_c3d(simulated_reach(tmp_path / "whole.c3d", frames=max(frames, 2)).path)
    valid = whole.valid[:frames].copy()
    valid[:, shown:] = False
    write_c3d(tmp_path / "little.c3d", make_recording(RATE_HZ, whole.names, whole.points[:frames], valid))
    result = track(TrackOptions(tmp_path / "little.c3d", out=tmp_path / "out"), quiet)
    assert result["tracked_frames"] == (frames if shown == 16 else 0)
    assert result["filled_points"] == result["disbelieved_points"] == 0
    assert (result["residual_mm"] is None) == (shown < 16)
    assert (result["angles_deg"] is None) == (shown < 16)
    assert len(result["missing"]) == 16 - shown
    assert Page((tmp_path / "out" / "report.html").read_text(encoding="utf-8")).open == []


def test_the_trackers_pose_is_that_of_its_segments():
    paper = load_marker_set("paper")
    tracker = Tracker(paper, RATE_HZ)
    assert tracker.pose is None
    points = np.array([paper.segments[joint].centre for joint in paper.joints]) + paper.local_positions
    seen = np.ones(len(paper), dtype=bool)
    tracker.update(MarkerFrame(paper.names, points, seen, 0, 0, 0, np.zeros((0, 3))))
    assert tracker.pose is not None
    names, centres, frames = tracker.pose
    assert set(names) == set(paper.segments)
    for joint, centre, frame in zip(names, centres, frames, strict=True):
        above = paper.segments[joint].parent
        assert above is None or names.index(above) < names.index(joint)
        np.testing.assert_allclose(centre, paper.segments[joint].centre, atol=0.03)
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-9)


run = running("track")


@pytest.fixture
def fails(run, tmp_path: Path):
    def fails(*words: object) -> str:
        code, out, err = run("--out", tmp_path / "none", *words)
        assert code == 2
        assert out == ""
        assert len(err.strip().splitlines()) == 1
        assert err.startswith("error:")
        return err

    return fails


@pytest.mark.slow
def test_json_is_one_object(run, tmp_path: Path):
    reach = simulated_reach(tmp_path / "reach.c3d", HAND, frames=120)
    code, out, _ = run(reach.path, "--person", "human:", "--marker-set", "paper", "--json", "--out", tmp_path / "o")
    assert code == 0
    assert json.loads(out)["frames"] == len(reach.markers)
    code, out, _ = run(reach.path, "--out", tmp_path / "o", "--overwrite")
    assert "report.html" in out


def test_bad_input_is_one_line(fails, reach: Reach, tmp_path: Path):
    assert "absent.c3d" in fails(tmp_path / "absent.c3d")
    (tmp_path / "notes.c3d").write_text("no recording")
    assert "not a C3D file" in fails(tmp_path / "notes.c3d")
    assert "the persons in it are: human" in fails(reach.path, "--person", "Eve")
    assert "no marker set 'mine'" in fails(reach.path, "--marker-set", "mine")
    wrong = fails(reach.path, "--marker-set", "upper_limb")
    assert "needs STER" in wrong
    assert "has LFHD, RFHD" in wrong
    assert "--subject" in fails(reach.path, "--marker-set", "paper", "--subject", "some.toml")
    paper = load_marker_set("paper")
    labels = [f"{who}:{name}" for who in ("A", "B") for name in paper.names]
    points = np.concatenate([reach.markers, reach.markers + 1.0], axis=1)
    write_c3d(tmp_path / "two.c3d", make_recording(RATE_HZ, labels, points, np.ones(points.shape[:2], dtype=bool)))
    assert "several persons: A, B" in fails(tmp_path / "two.c3d")
    strange = ["LFHD", "RFHD", *(f"m{i}" for i in range(14))]
    write_c3d(tmp_path / "strange.c3d", make_recording(RATE_HZ, strange, reach.markers, reach.there))
    said = fails(tmp_path / "strange.c3d")
    assert "no marker set fits the labels LFHD, RFHD, m0" in said
    assert "wants" in said
    (tmp_path / "occupied").write_text("a file")
    assert "occupied" in fails(reach.path, "--out", tmp_path / "occupied" / "deeper")


@pytest.mark.data
@pytest.mark.parametrize(
    ("file", "person", "expected", "hidden", "missing"),
    [
        pytest.param("85_02", None, "plug_in_gait", 0, [], marks=pytest.mark.slow),
        ("Movement_trial", None, "plug_in_gait", 0, ["RMT5", "LMT5"]),
        ("markers_analogs", None, "upper_limb", 281, []),
        pytest.param("85_12", "Male", "plug_in_gait", 0, [], marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow
def test_real_recordings_are_tracked(recordings: Path, tmp_path: Path, file, person, expected, hidden, missing):
    path = recordings / "markers" / f"{file}.c3d"
    result = track(TrackOptions(path, person, out=tmp_path), quiet)
    assert result["marker_set"] == expected
    assert result["hidden_points"] == result["filled_points"] == hidden
    assert result["missing"] == missing
    assert result["tracked_frames"] == result["frames"]
    assert result["residual_mm"]["median"] < 3.0  # skin slides
    assert result["disbelieved_points"] < 0.001 * result["frames"] * len(result["markers"])
    before, after = ezc3d.c3d(str(path)), ezc3d.c3d(str(filled_file(result)))
    for part in ("analogs", "points"):
        known = np.isfinite(before["data"][part])
        np.testing.assert_allclose(after["data"][part][known], before["data"][part][known], atol=1e-3)
    labels = [d["parameters"]["POINT"]["LABELS"]["value"] for d in (before, after)]
    assert labels[0] == labels[1]


@pytest.mark.data
@pytest.mark.parametrize(("hidden", "off"), [(12, 0.015), (36, 0.045)])
@pytest.mark.slow
def test_hidden_markers_of_a_real_arm_are_filled_near_where_they_were(
    recordings: Path, tmp_path: Path, hidden: int, off: float
):
    """The hand trio of a real person, hidden for 100 and 300 ms at a time: the truth is what was left out."""
    whole = read_c3d(recordings / "markers" / "85_12.c3d").person("Male")
    part = slice(600, 1320)
    valid = whole.valid[part].copy()
    trio = [whole.names.index(name) for name in ("RWRA", "RWRB", "RFIN")]
    for start in range(60, 660, 90):
        valid[start : start + hidden, trio] = False
    write_c3d(tmp_path / "cut.c3d", make_recording(whole.rate_hz, whole.names, whole.points[part], valid))
    result = track(TrackOptions(tmp_path / "cut.c3d", out=tmp_path / "out"), quiet)
    filled = read_c3d(filled_file(result))
    error = np.linalg.norm(filled.points - whole.points[part], axis=-1)[~valid]
    assert filled.valid.all()
    assert np.sqrt((error**2).mean()) < off
    sure = np.array([result["markers"][name]["filled_sd_mm"]["median"] for name in ("RWRA", "RWRB", "RFIN")])
    assert 0.5 * np.median(1e3 * error) < np.median(sure) < 2.0 * np.median(1e3 * error)


@pytest.mark.slow
def test_a_swapped_label_is_not_believed_even_where_the_marker_was_found(tmp_path: Path) -> None:
    swapped = tmp_path / "swapped.c3d"
    simulated_reach(swapped, frames=200)
    recording = read_c3d(swapped)
    points = recording.points.copy()
    one, other = (recording.names.index(f"human:{name}") for name in ("RWRA", "RFIN"))
    points[120:180, [one, other]] = points[120:180, [other, one]]
    write_c3d(swapped, replace(recording, points=points))
    summary = track(TrackOptions(swapped, out=tmp_path / "out", fit=False), quiet)
    for name in ("RWRA", "RFIN"):
        assert summary["markers"][name]["disbelieved"] > 40, name


@pytest.mark.slow
def test_frames_of_another_unit_are_not_used_and_told(tmp_path: Path) -> None:
    changed = tmp_path / "changed.c3d"
    simulated_reach(changed, frames=200)
    recording = read_c3d(changed)
    points = recording.points.copy()
    points[100:130] *= 1e-3
    write_c3d(changed, replace(recording, points=points))
    summary = track(TrackOptions(changed, out=tmp_path / "out"), quiet)
    assert summary["refused_frames"] == 30
    assert summary["residual_mm"]["p95"] < 10.0


def test_an_arm_that_nobody_measures_has_no_angles(reach: Reach, tmp_path: Path) -> None:
    """What people are like, the prior, is no measurement of this one."""
    whole = read_c3d(reach.path)
    paper = load_marker_set("paper")
    arm = [name for name, joint in zip(paper.names, paper.joints, strict=True) if joint.startswith("right_")]
    hidden = np.array([name.rpartition(":")[2] in arm for name in whole.names])
    assert hidden.sum() >= 5
    write_c3d(tmp_path / "no_arm.c3d", replace(whole, valid=whole.valid & ~hidden))
    result = track(TrackOptions(tmp_path / "no_arm.c3d", out=tmp_path / "out", fit=False), quiet)
    rows = (tmp_path / "out" / "angles.csv").read_text(encoding="utf-8").splitlines()
    assert all(set(row.split(",")[1:]) == {""} for row in rows[1:])
    assert result["angles_deg"] is None


@pytest.mark.data
@pytest.mark.parametrize("person", ["A", "B"])
@pytest.mark.parametrize("fit", [True, False])
@pytest.mark.slow
def test_flexion_of_joint_centres_is_the_angle_that_they_make(recordings: Path, tmp_path: Path, capsys, person, fit):
    """A real high five, of which only joint centres are known: they do not show the elbow's axis."""
    path = recordings / "high_five" / "cmu_20_21_11_high_five.c3d"
    result = track(TrackOptions(path, person, out=tmp_path, fit=fit), quiet)
    one = read_c3d(path).person(person)
    shoulder, elbow, wrist = (one.points[:, one.names.index(name)] for name in ("rclavicle", "rhumerus", "rwrist"))
    upper, fore = elbow - shoulder, wrist - elbow
    bend = np.degrees(np.arctan2(np.linalg.norm(np.cross(upper, fore), axis=1), (upper * fore).sum(axis=1)))
    with (tmp_path / "angles.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    flexion = np.array([float(row["elbow_flexion_deg"]) for row in rows])
    deviation = np.array([float(row["elbow_flexion_sd_deg"]) for row in rows])
    assert np.abs(flexion - bend)[60:121].max() < 3.0
    assert (np.abs(flexion - bend) < 3.0 * deviation).all()
    for angle in ANGLES:  # no turn of a whole circle from one frame to the next
        found = np.array([float(row[f"{angle}_deg"]) for row in rows if row[f"{angle}_deg"]])
        assert np.abs(np.diff(found)).max(initial=0.0) < 180.0
    # That nobody can see the carrying angle is said on top of the page and on the terminal, and what would show it.
    assert result["angles_deg"]["carrying_angle"] is None
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.index("carrying angle, blank in every frame") < page.index("<h2>Skeleton")
    print_track(result)
    assert "marker on each side of the elbow" in " ".join(capsys.readouterr().out.split())

"""``highfive calibrate subject``: what it finds of a person of another size, and what its file is good for."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from simulated_reach import RATE_HZ, simulated_reach

from highfive.calibration.personal_set import SPREAD
from highfive.hil.cli import main as cli
from highfive.hil.commands.calibrate import CalibrateOptions, calibrate_subject
from highfive.hil.commands.track import TrackOptions, track
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.tracker import Tracker

SET = "plug_in_gait_upper"
SIZE = 1.08


def quiet(_label, _total):
    return lambda: None


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("calibrate")


@pytest.fixture(scope="module")
def result(folder: Path) -> dict:
    simulated_reach(folder / "tall.c3d", name=SET, prefix="tall:", scale=SIZE)
    return calibrate_subject(CalibrateOptions(folder / "tall.c3d", out=folder / "subject.toml"), quiet)


def test_the_persons_size_is_found(result: dict):
    for joint in ("right_shoulder", "right_elbow", "thoracic_8"):
        of = result["segments"][joint]
        assert of["length_m"] / of["reference_m"] == pytest.approx(SIZE, rel=0.03), joint
    assert result["residual_mm"] < 2.0
    assert set(result["markers"]) == set(load_marker_set(SET).names)
    assert all(of["residual_mm"] < 5.0 for of in result["markers"].values())


def test_the_file_is_the_persons_set_and_says_where_it_comes_from(folder: Path, result: dict):
    own, base = load_marker_set(folder / "subject.toml"), load_marker_set(SET)
    assert own.names == base.names
    assert own.aliases == base.aliases
    assert own.roles == base.roles
    assert own.arm.markers == base.arm.markers
    assert (own.spreads >= SPREAD).all()
    left_over = 1e-3 * np.array([result["markers"][name]["residual_mm"] for name in own.names])
    np.testing.assert_allclose(own.spreads, np.hypot(SPREAD, left_over / 3**0.5), atol=1e-4)
    for joint, of in result["segments"].items():
        assert own.segments[joint].length == of["length_m"]
    for m, name in enumerate(own.names):
        assert own.local_positions[m].tolist() == result["markers"][name]["position_m"]
    subject = tomllib.loads((folder / "subject.toml").read_text(encoding="utf-8"))["subject"]
    assert subject["source"] == "tall.c3d"
    assert subject["person"] == "tall"
    assert subject["fitted_from"] == SET
    assert subject["residuals_mm"].keys() == set(own.names)
    assert len(subject["date"]) == 10


def first_frame(folder: Path, name: str | Path) -> float:
    """Median distance, m, of the markers from where the tracker has them after one frame, by a marker set."""
    marker_set, recording = load_marker_set(name), read_c3d(folder / "tall.c3d").person()
    points, there = recording.points[0], recording.valid[0]
    hand = [recording.names.index("RFIN")]
    there[hand] = False
    frame = MarkerFrame(recording.names, points, there, 0, 0, 0, np.zeros((0, 3)))
    tracked = Tracker(marker_set, RATE_HZ).update(frame)
    return float(np.linalg.norm(tracked.positions[marker_set.index("RFIN")] - points[hand[0]]))


def test_the_tracker_knows_a_calibrated_persons_hand_without_having_seen_it(folder: Path, result: dict):
    assert result["out"]
    assert first_frame(folder, folder / "subject.toml") < first_frame(folder, SET)
    assert first_frame(folder, folder / "subject.toml") < 0.06


@pytest.mark.slow
def test_track_takes_it_as_subject_and_as_marker_set(folder: Path, result: dict):
    file, own = folder / "tall.c3d", Path(result["out"])
    by_subject = track(TrackOptions(file, subject=own, out=folder / "a"), lambda label, total: lambda: None)
    by_set = track(TrackOptions(file, marker_set=str(own), out=folder / "b"), lambda label, total: lambda: None)
    assert by_subject["marker_set"] == by_set["marker_set"] == f"{SET}, tall"
    assert by_subject["residual_mm"] == by_set["residual_mm"]
    assert by_subject["residual_mm"]["median"] < 1.0


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["highfive", "calibrate", "subject", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        return int(str(end.value.code)), out, err

    return run


@pytest.mark.slow
def test_the_command_shows_a_table_or_one_json_object(run, folder: Path, result: dict):
    del result  # the file is there
    words = (folder / "tall.c3d", "--person", "tall", "--marker-set", SET, "--out", folder / "again.toml")
    code, out, _ = run(*words, "--json")
    assert code == 0
    assert json.loads(out)["marker_set"] == SET
    code, _, err = run(*words)
    assert code == 2
    assert "--overwrite" in err
    code, out, _ = run(*words, "--overwrite")
    assert code == 0
    assert "right_elbow" in out
    assert "RFIN" in out
    assert (folder / "again.toml").read_text(encoding="utf-8").startswith("# Positions are in metres")


def test_bad_input_is_one_line(run, folder: Path, result: dict):
    for words, said in (
        ((folder / "none.c3d",), "no file"),
        ((folder / "tall.c3d", "--person", "Eve"), "the persons in it are: tall"),
        ((folder / "tall.c3d", "--marker-set", "paper"), "paper needs THD"),
        ((folder / "tall.c3d", "--out", folder / "subject.json"), "subject.toml"),
        ((folder / "tall.c3d", "--out", folder / "tall.c3d" / "subject.toml"), "cannot write"),
    ):
        code, out, err = run(*words)
        assert code == 2
        assert out == ""
        *bars, line = err.strip().splitlines()
        assert line.startswith("error:") and said in line
        assert all("fitting the body" in bar for bar in bars)
    assert result["person"] == "tall"


@pytest.mark.data
@pytest.mark.parametrize(
    ("file", "longest", "shortest"), [("markers_analogs", 0.33, 0.26), ("Movement_trial", 0.33, 0.25)]
)
@pytest.mark.slow
def test_real_people_are_of_a_human_size(recordings: Path, tmp_path: Path, file, longest, shortest):
    path = recordings / "markers" / f"{file}.c3d"
    result = calibrate_subject(CalibrateOptions(path, out=tmp_path / "subject.toml"), quiet)
    assert shortest < result["segments"]["right_shoulder"]["length_m"] < longest
    assert 0.2 < result["segments"]["right_elbow"]["length_m"] < 0.3
    assert result["residual_mm"] < 7.0
    load_marker_set(tmp_path / "subject.toml")

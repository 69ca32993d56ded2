"""Files that earlier versions wrote open today, or are refused in one line that says what to do."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from paths import ROOT

import highfive
from highfive.calibration.arm_file import load_arm
from highfive.calibration.headset_file import load_headset
from highfive.calibration.latency_file import load_latencies
from highfive.calibration.placement_file import load_placement
from highfive.calibration.pose_file import load_poses
from highfive.hil.commands.experiment_analyse import AnalyseOptions, analyse
from highfive.hil.commands.export import ExportOptions, export
from highfive.hil.experiments import trial_log
from highfive.hil.recording.replay import open_replay
from highfive.hil.recording.session_reader import read_session
from highfive.hil.session.style_timing import timing_of
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.recorded import RecordedTrials
from highfive.mocap_bridge.files.trial_table import read_table
from highfive.model.errors import HighFiveError

VERSIONS = ROOT / "tests" / "data" / "versions"
RECORDINGS = sorted(VERSIONS.glob("*/session.mcap"))
MOST_BYTES = 1_000_000


def folders_with(name: str) -> list[Path]:
    return sorted(path.parent for path in VERSIONS.glob(f"*/{name}"))


def named(path: Path) -> str:
    return path.relative_to(VERSIONS).parts[0]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene()


def test_each_file_is_opened_here_and_all_are_small() -> None:
    files = [path for path in VERSIONS.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < MOST_BYTES
    tried = {"session.mcap", "model.safetensors", "whole_arm.safetensors", "trials.csv", "room.toml", "place.toml"}
    tried |= {"arm.toml", "headset.toml", "latencies.toml", "poses.json", "study.zip", "README.md"}
    assert {path.name for path in files} == tried


@pytest.mark.parametrize("path", RECORDINGS, ids=named)
def test_recordings_are_read_shown_and_exported(path: Path, scene: Scene, tmp_path: Path) -> None:
    session = read_session(path)
    (high_five,) = session
    assert session.complete and high_five.about["emotion"] == "angry"
    person, avatar = high_five.arrays("/person"), high_five.arrays("/avatar")
    assert len(person["time"]) > 200 and avatar["quaternions"].shape[1:] == (53, 4)
    trials = RecordedTrials(session, scene)
    assert not trials.lacking
    shown = trials[0]
    assert np.isfinite(shown.bodies).all() and float(shown.times[-1]) > 1.5
    for number, kind in enumerate(("bvh", "csv", "npz")):
        written = export(ExportOptions(path, kind, tmp_path / f"{number}"), lambda label, total: lambda: None)
        assert written["files"]


@pytest.mark.parametrize("path", RECORDINGS, ids=named)
def test_a_recording_without_frames_is_not_played_again_and_says_so(path: Path) -> None:
    with pytest.raises(HighFiveError, match="holds no marker frames, so it cannot be played again"):
        open_replay(read_session(path), "default", True, None)


def test_the_recording_that_comes_along_is_of_the_second_format_and_of_an_earlier_version() -> None:
    with SHIPPED_RECORDING.open("rb") as file:
        _, _, message = next(make_reader(file).iter_messages(topics=["/session"]))
    about = json.loads(message.data)
    assert about["format"] == 2 and about["settings"]["versions"]["high-five"] == "0.2.0"
    assert [one.about["emotion"] for one in read_session(SHIPPED_RECORDING)] == ["neutral", "happy", "angry", "sad"]


@pytest.mark.parametrize(
    "folder", [one for one in folders_with("model.safetensors") if named(one) != "0.1.0-11-21"], ids=named
)
def test_models_answer(folder: Path) -> None:
    model = highfive.load_model(folder / "model.safetensors")
    responder, timing = highfive.Responder(model, "angry", rate_hz=120.0), timing_of(model)
    for height in np.linspace(1.0, 1.4, 30):
        answer = responder.step(np.array([[0.60, -0.20, height], [0.55, -0.20, height + 0.09]]))
    assert answer.joints.shape == (159,) and np.isfinite(answer.joints).all()
    assert np.isfinite(answer.contact_point).all()
    style = responder.style  # and a session plays the answers
    assert np.isfinite(timing.answering(answer, style, timing.waiting(style)).hinges).all()


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("0.1.0-11-21/model.safetensors", "has format version 3, this is 4; train it again"),
        (
            "0.2.0-11-27/whole_arm.safetensors",
            "by an earlier version of High Five, whose layer of the whole arm knows no tempo; train it again",
        ),
    ],
)
def test_models_that_have_to_be_trained_again_say_so(file: str, says: str) -> None:
    with pytest.raises(HighFiveError, match=says):
        highfive.load_model(VERSIONS / file)


def test_tables_of_data_folders_are_read() -> None:
    rows = read_table(VERSIONS / "0.1.0")
    assert len(rows) == 9 and {row.emotion for row in rows} == {"angry"}
    assert [row.cell for row in rows] == [f"{height}{side}" for height in "ABC" for side in "123"]


@pytest.mark.parametrize("folder", folders_with("arm.toml"), ids=named)
def test_calibrations_are_read(folder: Path) -> None:
    arm = load_arm(folder / "arm.toml")
    assert arm.latency == {"mocap_s": 0.0071} and len(arm.joints) == 6
    kept = load_headset(folder / "headset.toml", "vicon", "upper_limb")
    assert kept.registration.delay_s == pytest.approx(0.021)
    np.testing.assert_allclose(kept.registration.translation, [0.4, 0.2, 0.0])
    assert load_latencies(folder / "latencies.toml")["vicon"].latency_ms == pytest.approx(7.2)
    assert len(load_poses(folder / "poses.json", "arm", ("a", "b", "c"), 6)) == 2


def test_a_placement_is_read_and_a_room_without_a_digest_is_measured_again() -> None:
    placement = load_placement(VERSIONS / "0.2.0-11-24" / "place.toml", "vicon")
    np.testing.assert_allclose(placement.apply(np.zeros((1, 3))), [[0.5, 0.1, 0.0]])
    with pytest.raises(HighFiveError, match=r"check\.digest is missing; measure it again"):
        load_arm(VERSIONS / "0.1.0" / "room.toml")


@pytest.mark.parametrize("folder", folders_with("study.zip"), ids=named)
def test_studies_are_read_and_analysed(folder: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(folder / "study.zip") as archive:
        archive.extractall(tmp_path)
    for code in ("P01", "P02"):
        log = trial_log.read_session(tmp_path, code, 1)
        assert len(log.rows) == 87 and {row.participant for row in log.rows} == {code}
    result = analyse(AnalyseOptions(None, study=tmp_path))
    assert result["trials"]["all"] == 2 * 87 and result["trials"]["counted"] > 2 * 60 and result["simulated"]

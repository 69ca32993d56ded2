import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from disk import files_no_larger_than
from mcap.reader import make_reader
from paths import HELPERS
from recorded_trials import record_trial
from trial_results import some_results

from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.recorder import CHUNK_NS, SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.session.shown import Shown
from highfive.hil.trials.summary import SessionSettings
from highfive.model.errors import HighFiveError

SETTINGS = SessionSettings(seed=3, model="default", trials=2, command="highfive simulate")


def shortened(result, count):
    arrays = ["times", "people", "poses", "generated", "person_palm", "palm", "generated_palm"]
    arrays += ["weight", "expected", "markers", "tick_ms"]
    return replace(result, **{name: getattr(result, name)[:count] for name in arrays})


@pytest.fixture(scope="module")
def result():
    return shortened(some_results()[1], 240)


@pytest.fixture(scope="module")
def recorded(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "session.mcap"
    with SessionRecorder(path, SETTINGS) as recorder:
        record_trial(recorder, result)
        record_trial(recorder, replace(shortened(result, 60), number=1))
    return path


def one_line(error):
    return "\n" not in str(error.value)


def test_reads_what_was_written(recorded, result):
    recording = read_recording(recorded)
    assert recording.complete
    assert recording.settings["seed"] == 3 and recording.settings["command"] == "highfive simulate"
    assert [m.data["trial"] for m in recording.channels["/trial"]] == [0 + result.number, 1]
    for topic, written in (("/avatar", result.poses), ("/generated", result.generated)):
        times, poses = recording.poses(topic)
        assert len(poses) == 300
        np.testing.assert_allclose(times[:240], result.times, atol=1e-9)
        for pose, original in zip(poses, written, strict=False):
            np.testing.assert_allclose(pose.root_in_world, original.root_in_world, atol=1e-5)
            same = np.abs(np.sum(pose.quaternions * original.quaternions, axis=-1))
            np.testing.assert_allclose(same, 1.0, atol=1e-8)
    markers = recording.channels["/markers"]
    assert len(markers) == 300 and tuple(markers[0].data["names"]) == result.markers[0].names
    np.testing.assert_allclose(markers[7].data["positions"], result.markers[7].positions, atol=1e-5)
    forecasts = [one for one in result.forecasts if one is not None]
    for said, forecast in zip(recording.channels["/forecast"], forecasts, strict=False):
        np.testing.assert_allclose(said.data["point"], forecast.point, atol=1e-5)
        np.testing.assert_allclose(said.data["covariance"], forecast.covariance[:3, :3], atol=1e-9)
        assert said.data["time"] == pytest.approx(forecast.time, abs=1e-5)
    assert len(recording.channels["/forecast"]) >= len(forecasts) > 0
    (contact, _) = recording.channels["/contact"]
    assert contact.data["met"] and contact.data["distance"] == pytest.approx(result.error, abs=1e-5)


def test_time_never_goes_back(recorded):
    for messages in read_recording(recorded).channels.values():
        assert np.all(np.diff([m.time_ns for m in messages]) >= 0)


def test_other_readers_read_it_and_find_schemas(recorded):
    with recorded.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        seen = {channel.topic: schema for schema, channel, _ in reader.iter_messages() if schema}
    assert summary is not None and summary.statistics is not None
    assert seen["/skeleton"].name == "foxglove.SceneUpdate" and seen["/avatar"].encoding == "jsonschema"
    # A crash loses the chunk being filled: none may be much longer than half a second.
    longest = max(chunk.message_end_time - chunk.message_start_time for chunk in summary.chunk_indexes)
    assert longest <= CHUNK_NS + 1e8


@pytest.mark.slow
def test_a_file_cut_anywhere_reads_up_to_there(recorded, tmp_path):
    whole = recorded.read_bytes()
    expected = [m.data for m in read_recording(recorded).channels["/avatar"]]
    counts, path = [], tmp_path / "cut.mcap"
    first = next(size for size in range(2000, len(whole), 500) if _readable(path, whole[:size]))
    for size in np.linspace(first, len(whole) - 1, 9).astype(int):
        path.write_bytes(whole[:size])
        recording = read_recording(path)
        found = [m.data for m in recording.channels["/avatar"]]
        assert found == expected[: len(found)]
        assert not recording.complete
        counts.append(len(found))
    assert counts == sorted(counts) and counts[0] == 0 and counts[-1] == len(expected)


def _readable(path: Path, content: bytes) -> bool:
    path.write_bytes(content)
    try:
        read_recording(path)
    except HighFiveError as error:
        assert "\n" not in str(error)
        return False
    return True


@pytest.mark.parametrize(
    "content", [b"", b"\x89MCAP0\r\n", b"not a recording", b"\0" * 10_000, b"\x89MCAP0\r\n" + b"\xff" * 99]
)
def test_what_is_no_recording_says_so(content, tmp_path):
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(HighFiveError, match=r"other\.mcap") as error:
        read_recording(path)
    assert one_line(error)


def test_missing_file_says_so(tmp_path):
    with pytest.raises(HighFiveError, match="No such file"):
        read_recording(tmp_path / "none.mcap")


def test_a_full_disk_is_one_line_and_loses_nothing_before_it(result, tmp_path):
    path = tmp_path / "full.mcap"
    recorder = SessionRecorder(path, SETTINGS)
    with files_no_larger_than(250_000), pytest.raises(HighFiveError, match=r"full\.mcap.*make room") as error:
        record_trial(recorder, result)
    assert one_line(error)
    with pytest.raises(HighFiveError):
        record_trial(recorder, result)
    recorder.close()
    recording = read_recording(path)
    assert 0 < len(recording.channels["/avatar"]) < len(result.times)
    assert f"up to {1e-9 * recording.channels['/tick'][-1].time_ns:.1f} s can be read" in str(error.value)
    assert not recording.complete


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_disk_full_from_the_start_is_one_line():
    with pytest.raises(HighFiveError, match="No space left") as error:
        SessionRecorder(Path("/dev/full"), SETTINGS)
    assert one_line(error)


def test_an_interrupted_write_keeps_what_was_whole(result, tmp_path):
    path = tmp_path / "interrupted.mcap"
    before = signal.signal(signal.SIGVTALRM, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), SessionRecorder(path, SETTINGS) as recorder:
            record_trial(recorder, result)
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.05)
            while True:
                record_trial(recorder, result)
    finally:
        signal.signal(signal.SIGVTALRM, before)
    assert len(read_recording(path).channels["/contact"]) >= 1


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(HighFiveError, match="cannot write") as error:
        SessionRecorder(tmp_path / "file" / "session.mcap", SETTINGS)
    assert one_line(error)


WRITES_FOR_EVER = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from trial_results import simulated_result
from highfive.hil.recording.recorder import SessionRecorder
from recorded_trials import record_trial
from highfive.hil.sim.scene import build_scene
from highfive.hil.session.shown import Shown
from highfive.hil.trials.summary import SessionSettings
result = simulated_result(build_scene(), 0, "angry", "B2")
recorder = SessionRecorder(Path(sys.argv[2]), SessionSettings(seed=0, model="m", trials=1))
while True:
    record_trial(recorder, result)
    print("trial", flush=True)
"""


@pytest.mark.slow
def test_a_killed_process_leaves_a_readable_file(tmp_path):
    path = tmp_path / "killed.mcap"
    arguments = [sys.executable, "-c", WRITES_FOR_EVER, str(HELPERS), str(path)]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in range(3):
            assert process.stdout.readline() == "trial\n"
        process.send_signal(signal.SIGKILL)
    recording = read_recording(path)
    assert not recording.complete
    assert len(recording.channels["/contact"]) >= 3


def test_what_pages_showed_is_recorded_at_the_time_at_which_it_was_seen(result, tmp_path):
    path = tmp_path / "shown.mcap"
    with SessionRecorder(path, SETTINGS) as recorder:
        record_trial(recorder, result, from_ns=5_000_000_000)
        recorder.record_shown(2, Shown(7, 5_100_000_000, 5_116_250_000), 300_000)
        recorder.record_shown(2, Shown(9, 5_116_700_000, 5_133_000_000, 1), 300_000)
    first, second = read_recording(path).channels["/shown"]
    assert first.time_ns == 116_250_000 and second.time_ns == 133_000_000
    assert first.data == {
        "page": 2, "frame": 7, "pose_ns": 5_100_000_000, "display_ns": 5_116_250_000, "dropped": 0, "bound_ns": 300_000,
    }  # fmt: skip
    assert second.data["dropped"] == 1


@pytest.mark.parametrize("replaces", [False, True])
def test_a_disk_that_is_full_at_the_last_write_says_so_and_keeps_what_was_there(
    replaces: bool, result, tmp_path, caplog
):
    """The judgement of the last high five fits; what is left to be written in the end does not."""
    path = tmp_path / "last.mcap"
    if replaces:
        path.write_bytes(b"an earlier recording")
    recorder = SessionRecorder(path, SETTINGS)
    background = BackgroundRecorder(recorder, paced=False)
    record_trial(recorder, result)
    with files_no_larger_than(recorder.written + 10):
        background.close()
    assert "make room" in background.trouble and "\n" not in background.trouble
    assert [background.trouble in record.getMessage() for record in caplog.records] == [True]
    recorder.close()  # it was told
    left = next(tmp_path.glob("*last.mcap*")) if not replaces else next(p for p in tmp_path.iterdir() if p != path)
    recording = read_recording(left)
    assert len(recording.channels["/avatar"]) == len(result.times) and not recording.complete
    assert not replaces or path.read_bytes() == b"an earlier recording"

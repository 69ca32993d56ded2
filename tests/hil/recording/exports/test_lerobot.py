"""A session as a lerobot dataset: read back by pyarrow, and held against what was recorded.

``tests/packaging/test_lerobot_plugin.py`` has it read by lerobot itself, where that is installed.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from command_line import failing, running
from shipped import shipped_recording, shipped_trials, written

from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.recording.recording import RecordedMessage
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.view import SHIPPED_RECORDING

run, fails = running("export"), failing("export")
NAMES = find_arm("koch_v1_1").names
DATA, EPISODES = "data/chunk-000/file-000.parquet", "meta/episodes/chunk-000/file-000.parquet"


def angles(seconds: float) -> np.ndarray:
    """(5,) rad, of an arm at a time: so slow that between two cycles it goes straight."""
    return 0.5 * np.sin(0.3 * seconds + np.arange(5))


def with_arm(path: Path, absent: int = -1) -> Path:
    """The recording that comes with the project, and an arm in all of its high fives but one."""
    recording = shipped_recording()
    ticks = [message for message in recording.channels["/tick"] if message.data["trial"] != absent]
    arm, safety = [], []
    for tick in ticks:
        cycle_ns, seconds = tick.time_ns + 3_000_000, 1e-9 * tick.time_ns
        arm.append(RecordedMessage(cycle_ns, {"positions": angles(1e-9 * cycle_ns).tolist()}))
        safety.append(RecordedMessage(tick.time_ns, {"reference": angles(seconds + 1.0).tolist()}))
    settings = recording.settings | {"arm": "virtual", "arm_name": "koch_v1_1"}
    channels = recording.channels | {"/arm": arm, "/safety": safety}
    return written(replace(recording, settings=settings, channels=channels), path)


def dataset(folder: Path) -> tuple[dict, dict[str, np.ndarray], list[dict]]:
    """What it says of itself, its columns, its episodes."""
    info, table = json.loads((folder / "meta/info.json").read_text()), pq.read_table(folder / DATA)
    columns = {name: np.array(table[name].to_pylist()) for name in table.column_names}
    return info, columns, pq.read_table(folder / EPISODES).to_pylist()


def check_whole(folder: Path) -> None:
    """What holds of every dataset."""
    info, columns, episodes = dataset(folder)
    count = info["total_frames"]
    assert set(columns) == set(info["features"]) and {len(values) for values in columns.values()} == {count}
    for name, feature in info["features"].items():
        width = feature["shape"][0]
        assert columns[name].shape == ((count, width) if columns[name].ndim == 2 else (count,))
        assert feature["names"] is None or len(feature["names"]) == len(set(feature["names"])) == width
    assert (columns["index"] == np.arange(count)).all()
    assert columns["timestamp"] == pytest.approx(columns["frame_index"] / info["fps"], abs=1e-6)
    assert info["splits"] == {"train": f"0:{len(episodes)}"} and info["total_episodes"] == len(episodes)
    begin = 0
    for number, episode in enumerate(episodes):
        of = slice(episode["dataset_from_index"], episode["dataset_to_index"])
        assert of.start == begin and episode["length"] == of.stop - of.start and episode["episode_index"] == number
        assert (columns["episode_index"][of] == number).all()
        assert (columns["frame_index"][of] == np.arange(episode["length"])).all()
        values = columns["observation.state"][of]
        assert episode["stats/observation.state/max"] == pytest.approx(values.max(axis=0), abs=1e-4)
        begin = of.stop
    assert begin == count
    said = json.loads((folder / "meta/stats.json").read_text())
    assert set(said) == set(info["features"])
    for name, found in said.items():
        values = columns[name].reshape(count, -1)
        for what in ("min", "max", "mean", "std"):
            assert found[what] == pytest.approx(getattr(values, what)(axis=0), rel=1e-4, abs=1e-4), (name, what)
        assert found["count"] == [count]
        order = [found[what] for what in ("min", "q01", "q10", "q50", "q90", "q99", "max")]
        assert (np.diff(order, axis=0) >= -1e-6).all()
    tasks = pq.read_table(folder / "meta/tasks.parquet")
    assert tasks["task_index"].to_pylist() == list(range(info["total_tasks"]))
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    for episode in episodes:
        index = tasks["task"].to_pylist().index(episode["tasks"][0])
        assert set(columns["task_index"][columns["episode_index"] == episode["episode_index"]]) == {index}


@pytest.mark.slow
@pytest.mark.parametrize("fps", [30, 50, 120])
def test_the_arm_is_where_it_was_and_was_told_what_it_was(run, tmp_path, fps) -> None:
    with_arm(tmp_path / "s.mcap")
    code, out, err = run(tmp_path / "s.mcap", "--to", "lerobot", "--fps", fps, "--json")
    assert code == 0, err
    folder = tmp_path / "s_lerobot"
    check_whole(folder)
    info, columns, episodes = dataset(folder)
    said = json.loads(out)
    assert said["frames"] == info["total_frames"] and len(said["trials"]) == info["total_episodes"] == 4
    assert info["robot_type"] == "high_five" and info["fps"] == fps and info["codebase_version"] == "v3.0"
    assert info["features"]["action"]["names"] == [f"{name}.pos" for name in NAMES]
    for episode, trial in zip(episodes, shipped_trials(), strict=True):
        of = slice(episode["dataset_from_index"], episode["dataset_to_index"])
        at = trial.times[0] + 0.003 + columns["timestamp"][of]  # from the arm's first cycle on
        assert at[-1] <= trial.times[-1] + 1e-6 and at[-1] > trial.times[-1] - 1.0 / fps - 0.004
        assert np.radians(columns["observation.state"][of]) == pytest.approx(np.stack(list(map(angles, at))), abs=2e-5)
        assert np.radians(columns["action"][of]) == pytest.approx(np.stack(list(map(angles, at + 1.0))), abs=2e-5)
        palm = columns["observation.environment_state"][of][:, 15:18]
        for axis in range(3):
            assert palm[:, axis] == pytest.approx(np.interp(at, trial.times, trial.points["palm"][:, axis]), abs=2e-5)


@pytest.mark.slow
def test_without_an_arm_the_avatar_is_the_robot(run, tmp_path) -> None:
    """At the session's own rate each frame is a tick, and an action the next one."""
    code, _, err = run(SHIPPED_RECORDING, "--to", "lerobot", "--fps", 60, "--out", tmp_path / "d")
    assert code == 0, err
    check_whole(tmp_path / "d")
    info, columns, episodes = dataset(tmp_path / "d")
    assert info["robot_type"] == "high_five_avatar"
    trial, of = shipped_trials()[1], slice(episodes[1]["dataset_from_index"], episodes[1]["dataset_to_index"])
    state, action = columns["observation.state"][of], columns["action"][of]
    assert state.shape[1] == 3 + 4 * len(avatar_skeleton().names)
    assert state[0] == pytest.approx(np.concatenate([trial.root[0], trial.quaternions[0].ravel()]), abs=1e-6)
    assert np.linalg.norm(state[:, 3:].reshape(len(state), -1, 4), axis=2) == pytest.approx(1.0, abs=1e-5)
    assert (action[:-1] == state[1:]).all() and (action[-1] == state[-1]).all()


def test_what_is_said_of_it_names_the_emotion(run, tmp_path) -> None:
    assert run(SHIPPED_RECORDING, "--to", "lerobot", "--out", tmp_path / "d")[0] == 0
    tasks = pq.read_table(tmp_path / "d/meta/tasks.parquet")["task"].to_pylist()
    emotions = [trial.span.text("emotion") for trial in shipped_trials()]
    assert len(tasks) == len(set(emotions)) and all(emotion in " ".join(tasks) for emotion in emotions)


def test_high_fives_without_the_arm_are_left_out(run, tmp_path) -> None:
    with_arm(tmp_path / "s.mcap", absent=2)
    code, out, err = run(tmp_path / "s.mcap", "--to", "lerobot", "--json")
    assert code == 0 and json.loads(out)["trials"] == [1, 2, 4]
    assert "left out: 1 high five in which the arm did not take part" in err
    check_whole(tmp_path / "s_lerobot")


def test_one_high_five(run, tmp_path) -> None:
    with_arm(tmp_path / "s.mcap")
    assert run(tmp_path / "s.mcap", "--to", "lerobot", "--trial", "3", "--out", tmp_path / "third")[0] == 0
    check_whole(tmp_path / "third")
    assert dataset(tmp_path / "third")[0]["total_episodes"] == 1


@pytest.mark.slow
def test_refused_in_one_line(fails, run, tmp_path, monkeypatch) -> None:
    assert "--fps is of --to lerobot" in fails(SHIPPED_RECORDING, "--to", "bvh", "--fps", "30")
    recording = shipped_recording()
    lost = recording.settings | {"arm": "virtual", "arm_name": "/nowhere/my_arm"}
    channels = recording.channels | {
        "/arm": [RecordedMessage(5, {"positions": [0.0]})],
        "/safety": [RecordedMessage(5, {"reference": [0.0]})],
    }
    path = written(replace(recording, settings=lost, channels=channels), tmp_path / "lost.mcap")
    assert "my_arm" in fails(path, "--to", "lerobot")
    other = recording.settings | {"arm": "virtual", "arm_name": "koch_v1_1"}
    path = written(replace(recording, settings=other, channels=channels), tmp_path / "other.mcap")
    assert "another version" in fails(path, "--to", "lerobot")
    assert run(SHIPPED_RECORDING, "--to", "lerobot", "--out", tmp_path / "d")[0] == 0
    (tmp_path / "d" / "mine.txt").write_text("mine")
    assert "--overwrite" in fails(SHIPPED_RECORDING, "--to", "lerobot", "--out", tmp_path / "d")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "pip install pyarrow" in fails(SHIPPED_RECORDING, "--to", "lerobot", "--out", tmp_path / "e")
    assert not (tmp_path / "e").exists()

"""What is no file, or too large a one, is refused in one line before it is read: a pipe would be read for ever."""

import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from highfive.calibration.pose_file import load_poses
from highfive.hil.datasets.collection import REASONS, _reasons
from highfive.hil.experiments import protocol_file, trial_log
from highfive.hil.experiments.analysis import csv_rows
from highfive.hil.experiments.protocol_file import TEMPLATES, read_protocol
from highfive.hil.experiments.study import check_planned
from highfive.hil.experiments.trial_log import read_session
from highfive.hil.recording.mcap_file import McapFile
from highfive.mocap_bridge.files import trial_table
from highfive.mocap_bridge.files.take_file import take_to_c3d
from highfive.model.errors import HighFiveError

READERS: dict[str, Callable[[Path], object]] = {
    "trials.csv": lambda path: trial_table.read_table(path.parent, lambda line: None),
    "answers.csv": lambda path: csv_rows.read_rows(path, ("a", "b")),
    "session.mcap": lambda path: list(McapFile(path).messages()),
    "take.raw": lambda path: take_to_c3d(path, path.with_name("take.c3d")),
    "arm.poses.json": lambda path: load_poses(path, "arm", ("a", "b", "c"), 6),
    "en.md": lambda path: protocol_file._instructions(path.parent),
    "planned.json": lambda path: check_planned(path.parent, read_protocol(TEMPLATES / "tipping.toml")),
    "participants/P01/session-1/trials.jsonl": lambda path: read_session(path.parents[3], "P01", 1),
    REASONS: _reasons,
}


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    os.mkfifo(tmp_path / name)
    with pytest.raises(HighFiveError, match="is no file; give a file"):
        READERS[name](tmp_path / name)


@pytest.mark.parametrize("name", READERS)
def test_a_device_that_never_ends_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(HighFiveError, match="is no file; give a file"):
        READERS[name](tmp_path / name)


@pytest.mark.parametrize("name", ["arm.poses.json", "planned.json", "participants/P01/session-1/trials.jsonl"])
@pytest.mark.parametrize("content", ["[" * 200_000, "[" * 900 + "]" * 900, "1" * 10_000, "[]", "\0" * 100])
def test_json_of_any_shape_is_a_line(tmp_path: Path, name: str, content: str) -> None:
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_text(content + "\n{}\n" if name.endswith("l") else content, encoding="utf-8")
    with pytest.raises(HighFiveError):
        READERS[name](tmp_path / name)


def test_a_list_that_is_nested_deeply_takes_little_memory(tmp_path: Path) -> None:
    """Named by its place, each of its numbers would have a name of thousands of characters."""
    (tmp_path / "planned.json").write_text('{"a":' + "[" * 900 + "1," * 20_000 + "1" + "]" * 900 + "}")
    tracemalloc.start()
    with pytest.raises(HighFiveError, match="is nothing that highfive experiment plan wrote"):
        READERS["planned.json"](tmp_path / "planned.json")
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 20e6


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("trials.csv", trial_table.LARGEST_TABLE), ("answers.csv", csv_rows.LARGEST_TABLE),
        (REASONS, trial_table.LARGEST_TABLE), ("en.md", protocol_file.MOST_TEXT),
        ("participants/P01/session-1/trials.jsonl", trial_log.MOST_BYTES),
    ],
)  # fmt: skip
def test_a_file_that_would_take_all_memory_is_refused(tmp_path: Path, name: str, most: int) -> None:
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    with (tmp_path / name).open("wb") as file:
        file.truncate(most + 1)
    with pytest.raises(HighFiveError, match="more than the limit"):
        READERS[name](tmp_path / name)

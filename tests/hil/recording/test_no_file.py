"""What is no file, or too large a one, is refused in one line before it is read: a pipe would be read for ever."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from highfive.hil.experiments.analysis import csv_rows
from highfive.hil.recording.mcap_file import McapFile
from highfive.mocap_bridge.files import trial_table
from highfive.mocap_bridge.files.take_file import take_to_c3d
from highfive.model.errors import HighFiveError

READERS: dict[str, Callable[[Path], object]] = {
    "trials.csv": lambda path: trial_table.read_table(path.parent, lambda line: None),
    "answers.csv": lambda path: csv_rows.read_rows(path, ("a", "b")),
    "session.mcap": lambda path: list(McapFile(path).messages()),
    "take.raw": lambda path: take_to_c3d(path, path.with_name("take.c3d")),
}


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_is_refused(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(HighFiveError, match="is no file; give a file"):
        READERS[name](tmp_path / name)


@pytest.mark.parametrize(
    ("name", "most"), [("trials.csv", trial_table.LARGEST_TABLE), ("answers.csv", csv_rows.LARGEST_TABLE)]
)
def test_a_table_that_would_take_all_memory_is_refused(tmp_path: Path, name: str, most: int) -> None:
    with (tmp_path / name).open("wb") as file:
        file.truncate(most + 1)
    with pytest.raises(HighFiveError, match="more than the limit"):
        READERS[name](tmp_path / name)

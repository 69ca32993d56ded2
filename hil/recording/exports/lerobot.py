"""A session as a lerobot dataset (format v3.0): an episode a high five, in Parquet.

Format: ``lerobot.datasets.lerobot_dataset``, codebase version v3.0.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.recording.exports.dataset_statistics import Statistics, of_all, of_episode
from highfive.hil.recording.exports.export_file import ExportFile, of_bytes
from highfive.hil.recording.exports.lerobot_frames import STATE, Frames, arm_frames, avatar_frames
from highfive.hil.recording.exports.trial_arrays import ExportTrial
from highfive.hil.recording.trial_spans import TrialSpan
from highfive.model.errors import HighFiveError
from highfive.model.files import written_whole
from highfive.model.geometry.rotations import Array

if TYPE_CHECKING:
    import pyarrow as pa

VERSION = "v3.0"
FPS = 30
"""Frames a second, unless they are told otherwise: what lerobot records, and policies are trained on."""

DATA, EPISODES = (
    "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "meta/episodes/chunk-000/file-000.parquet",
)
NUMBERED = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""What every dataset has beside its features."""


def lerobot_files(trials: Sequence[ExportTrial], fps: int = FPS) -> list[ExportFile]:
    """The files of a dataset, in the order in which they are to be written.

    Args:
        trials: its episodes: an arm takes part in all of them, or in none.
        fps: frames a second.

    Raises:
        HighFiveError: there is no pyarrow.
    """
    dataset = _Dataset(trials, fps, _pyarrow())
    return [
        ExportFile(DATA.format(chunk_index=0, file_index=0), dataset.write_frames, 0),
        ExportFile(EPISODES, dataset.write_episodes, 0),
        ExportFile("meta/tasks.parquet", dataset.write_tasks, 0),
        of_bytes("meta/stats.json", dataset.statistics),
        of_bytes("meta/info.json", dataset.info),
    ]


def frames_written(folder: Path) -> int:
    """Of a dataset in a folder."""
    return json.loads((folder / "meta/info.json").read_bytes())["total_frames"]


@dataclass
class _Dataset:
    """What of an episode goes into one file is known once another one is written."""

    trials: Sequence[ExportTrial]
    fps: int
    arrow: Any
    episodes: list[dict[str, Any]] = field(default_factory=list)
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    robot: str = ""

    @property
    def frames(self) -> int:
        return sum(episode["length"] for episode in self.episodes)

    @cached_property
    def tasks(self) -> list[str]:
        return list(dict.fromkeys(_task(trial.span) for trial in self.trials))

    def write_frames(self, path: Path) -> None:
        with self._parquet(path) as write:
            for trial in self.trials:
                arrays, arm = trial.load(), trial.load_arm()
                frames = avatar_frames(arrays, self.fps) if arm is None else arm_frames(arrays, arm, self.fps)
                self.names, self.robot = frames.names, "high_five_avatar" if arm is None else "high_five"
                write(self._table(frames, self._numbered(frames, trial.span)))

    def _numbered(self, frames: Frames, span: TrialSpan) -> dict[str, Array]:
        """Numbers of the frames, (N, 1); and the episode is noted."""
        count, first = len(frames.values[STATE]), self.frames
        numbers = np.arange(count)[:, None]
        numbered = {
            "timestamp": numbers / self.fps,
            "frame_index": numbers,
            "episode_index": np.full_like(numbers, len(self.episodes)),
            "index": numbers + first,
            "task_index": np.full_like(numbers, self.tasks.index(_task(span))),
        }
        found = {name: of_episode(values) for name, values in (*frames.values.items(), *numbered.items())}
        self.episodes.append({"length": count, "first": first, "task": _task(span), "statistics": found})
        return numbered

    def _table(self, frames: Frames, numbered: Mapping[str, Array]) -> pa.Table:
        arrow = self.arrow
        columns = {
            name: arrow.FixedSizeListArray.from_arrays(values.astype(np.float32).reshape(-1), values.shape[1])
            for name, values in frames.values.items()
        }
        columns |= {name: arrow.array(values[:, 0].astype(NUMBERED[name])) for name, values in numbered.items()}
        return arrow.table(columns)

    def write_episodes(self, path: Path) -> None:
        rows = [
            {
                "episode_index": number,
                "tasks": [episode["task"]],
                "length": episode["length"],
                "data/chunk_index": 0,
                "data/file_index": 0,
                "dataset_from_index": episode["first"],
                "dataset_to_index": episode["first"] + episode["length"],
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **{
                    f"stats/{name}/{what}": values.tolist()
                    for name, found in episode["statistics"].items()
                    for what, values in found.items()
                },
            }
            for number, episode in enumerate(self.episodes)
        ]
        with self._parquet(path) as write:
            write(self.arrow.Table.from_pylist(rows))

    def write_tasks(self, path: Path) -> None:
        """A table whose index is the task, as pandas writes one."""
        table = self.arrow.table({"task_index": np.arange(len(self.tasks)), "task": self.tasks})
        column = {"metadata": None, "numpy_type": "int64", "pandas_type": "int64"}
        text = {"metadata": None, "numpy_type": "object", "pandas_type": "unicode"}
        about = {
            "index_columns": ["task"],
            "column_indexes": [],
            "columns": [
                {"name": "task_index", "field_name": "task_index", **column},
                {"name": "task", "field_name": "task", **text},
            ],
            "pandas_version": "2.2.0",
        }
        with self._parquet(path) as write:
            write(table.replace_schema_metadata({"pandas": json.dumps(about)}))

    def statistics(self) -> bytes:
        each: list[Mapping[str, Statistics]] = [episode["statistics"] for episode in self.episodes]
        found = {name: of_all([episode[name] for episode in each]) for name in each[0]}
        return _json({name: {what: values.tolist() for what, values in of.items()} for name, of in found.items()})

    def info(self) -> bytes:
        one = {"shape": [1], "names": None}
        features = {
            name: {"dtype": "float32", "shape": [len(names)], "names": list(names)}
            for name, names in self.names.items()
        }
        features |= {name: {"dtype": kind, **one} for name, kind in NUMBERED.items()}
        return _json(
            {
                "codebase_version": VERSION,
                "robot_type": self.robot,
                "total_episodes": len(self.episodes),
                "total_frames": self.frames,
                "total_tasks": len(self.tasks),
                "chunks_size": 1000,
                "data_files_size_in_mb": 100,
                "video_files_size_in_mb": 200,
                "fps": self.fps,
                "splits": {"train": f"0:{len(self.episodes)}"},
                "data_path": DATA,
                "video_path": None,
                "features": features,
            }
        )

    @contextmanager
    def _parquet(self, path: Path) -> Iterator[Callable[[pa.Table], None]]:
        """Writes tables of one schema, one after the other, into a file that is there once it is whole."""
        from pyarrow import parquet  # noqa: PLC0415

        writers: list[Any] = []
        with written_whole(path) as partly:

            def write(table: pa.Table) -> None:
                if not writers:
                    writers.append(parquet.ParquetWriter(partly, table.schema))
                writers[0].write_table(table)

            try:
                yield write
            finally:
                for writer in writers:
                    writer.close()


def _pyarrow() -> Any:
    try:
        import pyarrow  # noqa: PLC0415
    except ImportError:
        raise HighFiveError("--to lerobot writes Parquet, which needs pyarrow: pip install pyarrow") from None
    return pyarrow


def _task(span: TrialSpan) -> str:
    """What is done, in words: policies are told it."""
    emotion = span.text("emotion")
    return f"Meet the person's raised hand in a high five, {emotion}." if emotion else "Meet the raised hand."


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=4, ensure_ascii=False).encode()

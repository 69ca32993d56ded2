"""``highfive export``: a session's recording as the files of other programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from highfive.hil.commands.written_files import write_files
from highfive.hil.recording.exports.bids import bids_files
from highfive.hil.recording.exports.export_file import ExportFile, trial_names
from highfive.hil.recording.exports.lerobot import FPS, frames_written, lerobot_files
from highfive.hil.recording.exports.motion_files import bvh_files, c3d_files
from highfive.hil.recording.exports.tables import csv_files, npz_file, ticks_of
from highfive.hil.recording.exports.trial_arrays import ExportTrial, export_trials
from highfive.hil.recording.one_recording import one_recording, unended
from highfive.hil.recording.session_reader import read_session
from highfive.hil.runtime.console import Bar, counted, say_aside
from highfive.hil.runtime.folders import check_file, results_folder
from highfive.hil.view.moving_skin import glb_files
from highfive.model.errors import HighFiveError

BY_TRIAL: dict[str, Callable[[Sequence[ExportTrial], Sequence[str]], list[ExportFile]]] = {
    "bvh": bvh_files,
    "glb": glb_files,
    "c3d": c3d_files,
}
"""Formats of one motion a file."""
FOLDERS = ("bids", "lerobot")
"""Formats of a folder."""
FORMATS = (*BY_TRIAL, "csv", "npz", *FOLDERS)
_LARGE = 8 << 20
"""Bytes of a recording, from which on reading it takes two seconds and more."""


@dataclass(frozen=True)
class ExportOptions:
    """What to export, and where.

    Attributes:
        recording: an MCAP file, or a folder that holds one.
        format: one of :data:`FORMATS`.
        out: a folder, or a file's name with the format's ending; None for beside the recording, with its name.
        trial: only the high five of this number, counted from 0.
        overwrite: replace files that are there.
        fps: frames a second of ``lerobot``.
    """

    recording: Path
    format: str
    out: Path | None = None
    trial: int | None = None
    overwrite: bool = False
    fps: int = FPS


def export(options: ExportOptions, bar: Bar) -> dict[str, Any]:
    """Writes the files, all or none of them, and says what they are.

    Raises:
        HighFiveError: an unknown format, a recording that cannot be read or lacks what the format is of, or files that
            are there already or cannot be written.
    """
    if options.format not in FORMATS:
        raise HighFiveError(f"--to {options.format}: no such format; there are {', '.join(FORMATS)}")
    _check_ending(options)
    path = one_recording(options.recording)
    large = path.is_file() and path.stat().st_size > _LARGE
    advance = bar("reading", 1) if large else None
    opened = datetime.now(UTC)
    session = read_session(path)
    trials = export_trials(session)
    if advance is not None:
        advance()
    if not session.complete:
        end = 1e-9 * trials[-1].span.end_ns
        there = f"exported is what there is of it, up to its last whole chunk ({end:.1f} s)"
        say_aside(f"{path.name} {unended(path, opened)}: {there}")
    if options.trial is not None:
        trials = [_chosen(trials, options.trial)]
    trials = _movable(trials, path.name, options.format)
    if options.format == "lerobot":
        trials = _led(trials)
    folder, files = _planned(options, path, trials)
    with results_folder(folder, options.overwrite) if options.format in FOLDERS else nullcontext():
        for file in files:
            check_file(folder / file.name, options.overwrite)
        write_files(files, folder, bar)
    spans = [trial.span for trial in trials]
    return {
        "format": options.format,
        "recording": str(path),
        "files": [str(folder / file.name) for file in files],
        "frames": frames_written(folder) if options.format == "lerobot" else ticks_of(trials),
        "duration": round(1e-9 * sum(span.end_ns - span.start_ns for span in spans), 6),
        "trials": [span.number + 1 for span in spans],
        "complete": session.complete,
    }


def print_export(result: dict[str, Any]) -> None:
    """The same for people."""
    files = result["files"]
    shown = files if len(files) <= 4 else [files[0], f"… and {len(files) - 1} more"]
    print(f"{counted(len(result['trials']), 'high five')}, {result['frames']} frames, {result['duration']:.1f} s:")
    for name in shown:
        print(f"  {name}")


def _check_ending(options: ExportOptions) -> None:
    """Refuses a file's name with the ending of another format, which would become a folder's."""
    ending = options.out.suffix.lower().removeprefix(".") if options.out and not options.out.is_dir() else ""
    if ending in FORMATS and ending != options.format:
        raise HighFiveError(
            f"--out {options.out}: ends in .{ending}, and --to is {options.format}; "
            f"write --to {ending}, or another name for --out"
        )


def _chosen(trials: Sequence[ExportTrial], number: int) -> ExportTrial:
    """The high five of a number; of several, which were broken off, the last."""
    found = [trial for trial in trials if trial.span.number == number]
    if not found:
        known = ", ".join(str(trial.span.number + 1) for trial in trials)
        raise HighFiveError(f"no high five {number + 1} in the recording; it holds {known}; --trial takes one of these")
    return found[-1]


def _movable(trials: list[ExportTrial], name: str, kind: str) -> list[ExportTrial]:
    """The high fives that a format can hold: what moves has two ticks."""
    if kind in ("csv", "npz"):
        return trials
    moving = [trial for trial in trials if trial.span.ticks > 1]
    if not moving:
        raise HighFiveError(f"{name} holds no high five of two ticks or more; csv and npz hold single ticks")
    if len(moving) < len(trials):
        say_aside(f"left out: {counted(len(trials) - len(moving), 'high five')} of a single tick")
    return moving


def _led(trials: list[ExportTrial]) -> list[ExportTrial]:
    """Those in which a servo arm took part, where it did in any: one data set is of one robot."""
    led = [trial for trial in trials if trial.load_arm() is not None]
    if led and len(led) < len(trials):
        say_aside(f"left out: {counted(len(trials) - len(led), 'high five')} in which the arm did not take part")
    return led or trials


def _planned(options: ExportOptions, path: Path, trials: Sequence[ExportTrial]) -> tuple[Path, list[ExportFile]]:
    """The folder, and the files to be written there."""
    kind, out = options.format, options.out
    if kind == "lerobot":
        return out or path.with_name(f"{path.stem}_lerobot"), lerobot_files(trials, options.fps)
    if kind == "bids":
        return out or path.with_name(f"{path.stem}_bids"), bids_files(trials, path.name)
    named = out is not None and out.suffix.lower() == f".{kind}" and not out.is_dir()
    folder = path.parent if out is None else out.parent if named else out
    stem = out.stem if out is not None and named else path.stem
    if kind == "csv":
        return folder, csv_files(trials, stem)
    if kind == "npz":
        return folder, [npz_file(trials, f"{stem}.npz")]
    if named and options.trial is not None:
        return folder, BY_TRIAL[kind](trials, [f"{stem}.{kind}"])
    return folder, BY_TRIAL[kind](trials, trial_names(stem, [trial.span for trial in trials], f".{kind}"))

"""``highfive export STUDY --to bids``: an experiment's answers and motion for others."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from highfive.hil.commands.written_files import write_files
from highfive.hil.experiments.recorded.study_bids import study_bids
from highfive.hil.experiments.study import PROTOCOL
from highfive.hil.experiments.study_rows import study_rows
from highfive.hil.runtime.console import Bar, counted, say, say_aside
from highfive.hil.runtime.folders import check_file, results_folder
from highfive.model.errors import HighFiveError


def is_study(folder: Path) -> bool:
    """Whether it is a study's folder."""
    return (folder / PROTOCOL).is_file()


def export_study(study: Path, out: Path | None, overwrite: bool, bar: Bar) -> dict[str, Any]:
    """Writes a BIDS data set of all sessions so far, all of it or nothing; by default beside the study's folder.

    Raises:
        HighFiveError: nobody took part, a log is damaged, or the files are there already or cannot be written.
    """
    folder = study.resolve().with_name(f"{study.resolve().name}_bids") if out is None else out
    if folder.resolve().is_relative_to(study.resolve()):
        raise HighFiveError(f"--out {folder} lies in the study, which an export does not change; give another folder")
    found = study_rows(study)
    for log in found.incomplete:
        say_aside(log.line, logging.WARNING)
    export = study_bids(study, found)
    with results_folder(folder, overwrite):
        for file in export.files:
            check_file(folder / file.name, overwrite)
        write_files(export.files, folder, bar)
    for why in export.missing:
        say_aside(f"without motion: {why}")
    return {
        "format": "bids",
        "study": str(study),
        "folder": str(folder),
        "files": [str(folder / file.name) for file in export.files],
        "participants": len({row.participant for row in found.rows}),
        "trials": len(found.rows),
        "runs": export.runs,
        "frames": export.frames,
        "missing": export.missing,
    }


def print_study_export(result: dict[str, Any]) -> None:
    """The same for people."""
    say(
        f"{counted(result['participants'], 'participant')}, {counted(result['trials'], 'trial')}, "
        f"{result['runs']} of them with motion, {counted(len(result['files']), 'file')}: {result['folder']}"
    )

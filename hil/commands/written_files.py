"""Several files that a command writes: all of them, or none."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from highfive.hil.recording.exports.export_file import ExportFile
from highfive.hil.runtime.console import Bar
from highfive.model.errors import HighFiveError


def write_files(files: Sequence[ExportFile], folder: Path, bar: Bar) -> None:
    """Writes them below a folder; if one cannot be written, those that are new go away again.

    Raises:
        HighFiveError: one cannot be made or written.
    """
    advance = bar("files", len(files))
    with _none_left(folder) as new:
        for file in files:
            target = folder / file.name
            if not os.path.lexists(target):
                new.append(target)
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                file.write(target)
            except OSError as error:
                why = error.strerror or error
                raise HighFiveError(f"cannot write {target}: {why}; make room, or give another folder") from None
            advance()


@contextmanager
def _none_left(folder: Path) -> Iterator[list[Path]]:
    """Takes away the new files, and folders that they leave empty, if not all of them could be written."""
    new: list[Path] = []
    try:
        yield new
    except BaseException:
        for path in new:
            with suppress(OSError):
                path.unlink(missing_ok=True)
                while (path := path.parent) != folder:
                    path.rmdir()
        raise

"""Which recording a folder means: the one that is in it."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from highfive.model.errors import HighFiveError

_WRITTEN_S = 5.0
"""s since a recording without an end was last written to, within which it is taken to be written still: it grows by a
chunk each half second."""

SUFFIX = ".mcap"
"""Of a recorded session's file."""


def unended(path: Path, opened: datetime) -> str:
    """What is to be said of a recording without an end: being written when it was ``opened``, or cut short."""
    age = opened.timestamp() - path.stat().st_mtime
    return "is still being written" if age < _WRITTEN_S else "has no end"


def one_recording(path: Path) -> Path:
    """The recording that a user means by a file, or by a folder that holds one, however deep.

    Raises:
        HighFiveError: the folder holds none, or several.
    """
    if not path.is_dir():
        return path
    # What a killed command left has no name of its own.
    found = sorted(one for one in path.rglob(f"*{SUFFIX}") if not one.name.startswith("."))
    if len(found) == 1:
        return found[0]
    if not found:
        raise HighFiveError(f"{path} is a folder without a recording; expected an {SUFFIX} file in it")
    several = ", ".join(str(one.relative_to(path)) for one in found[:3])
    more = ", …" if len(found) > 3 else ""
    raise HighFiveError(f"{path} is a folder of {len(found)} recordings; give one of them: {several}{more}")

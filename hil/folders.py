"""Where results go if no one says."""

from __future__ import annotations

from fnmatch import fnmatch
from itertools import count
from pathlib import Path

from model.errors import HighFiveError


def next_folder(kind: str, base: Path = Path("out")) -> Path:
    """The first of ``out/KIND-1``, ``out/KIND-2``, … that is not there yet."""
    return next(folder for number in count(1) if not (folder := base / f"{kind}-{number}").exists())


def check_free(folder: Path, name: str = "*", holds: str = "something") -> None:
    """What an earlier command wrote is never overwritten.

    Args:
        folder: where results are to go; need not be there.
        name: pattern of what must not be in it.
        holds: what that is, in words.

    Raises:
        HighFiveError: such a thing is there, or the folder is none or cannot be looked at.
    """
    try:
        taken = folder.exists() and any(fnmatch(entry.name, name) for entry in folder.iterdir())
    except OSError as error:
        raise HighFiveError(f"cannot write to {folder}: {error.strerror}; give another --out") from None
    if taken:
        raise HighFiveError(f"{folder} holds {holds} already; give another --out")

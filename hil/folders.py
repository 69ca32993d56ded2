"""Where results go if no one says."""

from __future__ import annotations

from itertools import count
from pathlib import Path


def next_folder(kind: str, base: Path = Path("out")) -> Path:
    """The first of ``out/KIND-1``, ``out/KIND-2``, … that is not there yet."""
    return next(folder for number in count(1) if not (folder := base / f"{kind}-{number}").exists())

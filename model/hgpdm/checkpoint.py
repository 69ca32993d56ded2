"""A training's checkpoint: a file of arrays that says what it belongs to and is never half written."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.files import written_whole
from highfive.model.npz_file import read_npz


class Unfitting(HighFiveError):
    """A checkpoint that is broken or of another training."""


def is_checkpoint(path: Path) -> bool:
    """Whether the file was written by :meth:`Checkpoint.save`, for whatever training."""
    try:
        arrays = read_npz(path) or {}
        return isinstance(json.loads(str(arrays["owner"])), dict)
    except Exception:  # as in Checkpoint.load; a file of one array has no entries at all
        return False


@dataclass(frozen=True)
class Checkpoint:
    """Where a training keeps what it needs to go on after an interruption.

    Attributes:
        path: the file, ``.npz``.
        owner: what the checkpoint belongs to (data, preset, seed, sizes); one of another owner is not used.
    """

    path: Path
    owner: Mapping[str, str | int]

    def save(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Writes the arrays in one piece: a kill leaves the old file or the new one.

        Raises:
            HighFiveError: the disk is full, or the folder cannot be written to.
        """
        try:
            with written_whole(self.path) as partial, partial.open("wb") as file:
                # NumPy's types take any name of an array for its flag allow_pickle, too.
                np.savez(file, owner=np.array(json.dumps(dict(self.owner))), **arrays)  # pyright: ignore[reportArgumentType]
        except OSError as error:
            raise HighFiveError(f"cannot write the checkpoint {self.path}: {error.strerror or error}") from None

    def load(self) -> dict[str, NDArray[Any]] | None:
        """The arrays last saved, or None if there is no file.

        Raises:
            Unfitting: the file is no checkpoint, is cut short, or belongs to another training.
        """
        if not self.path.exists():
            return None
        try:
            arrays = read_npz(self.path) or {}
            owner: dict[str, Any] = dict(json.loads(str(arrays.pop("owner"))))
        except Exception as error:  # zipfile, zlib and numpy each have their own for a damaged file
            raise Unfitting(f"{self.path} is not a whole checkpoint ({type(error).__name__})") from None
        if owner != dict(self.owner):
            other = ", ".join(
                f"{name} {owner.get(name)} instead of {value}"
                for name, value in self.owner.items()
                if owner.get(name) != value
            )
            raise Unfitting(f"{self.path} is of another training ({other})")
        return arrays

    def set_aside(self) -> Path:
        """Renames the file, so that a new one can take its place; returns where it is now."""
        names = (self.path.with_name(f"{self.path.name}.old{'' if n == 1 else f'-{n}'}") for n in count(1))
        aside = next(name for name in names if not name.exists())
        os.replace(self.path, aside)
        return aside

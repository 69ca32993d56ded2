"""Recordings of two people's high fives: what is to be recorded, in which order, and what of it is there already.

A data folder that grows: each take that is good is a C3D file and a row of ``trials.csv``, on the disk before the next
cue, so that ``train`` takes the folder at any time and the same command goes on after whatever ended it. Takes that
were not good are kept apart, with the reason.

Which order actors like is not known from the source study. Here they stay in one emotion for all its cells, which are
shuffled, and the emotions come in another order in each repetition.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from highfive.mocap_bridge.files.trial_table import LARGEST_TABLE, TABLE, TrialRow, read_table, write_table
from highfive.model.errors import HighFiveError
from highfive.model.files import read_bounded_text, write_whole
from highfive.model.toml_file import check_keys, read_toml

SETTINGS, REJECTED, REASONS = "collection.toml", "rejected", "rejected.csv"
_SPLIT = {False: "train", True: "test"}
_REASON: tuple[str, ...] = ("file", "why")
_NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")


@dataclass(frozen=True)
class Collection:
    """What is to be recorded; the same whenever the folder is gone on with.

    Attributes:
        emotions, cells: each with each.
        repetitions: of each; the last ``held_out`` of them are for testing.
        held_out: so many.
        seed: of the order.
        human, avatar: prefixes of the markers of who raises the hand, and of who answers.
        simulated: no people act.
    """

    emotions: tuple[str, ...]
    cells: tuple[str, ...]
    repetitions: int
    held_out: int
    seed: int
    human: str
    avatar: str
    simulated: bool = False

    def check(self) -> None:
        """That it can be recorded.

        Raises:
            HighFiveError: it cannot.
        """
        for name in self.emotions:
            if not _NAME.fullmatch(name):
                raise HighFiveError(f"emotion {name!r}: expected a word of small letters, digits and _, such as angry")
        if len(set(self.emotions)) < len(self.emotions) or not self.emotions:
            raise HighFiveError(f"--emotion {', '.join(self.emotions) or 'none'}: expected each once, and one at least")
        if self.human == self.avatar:
            raise HighFiveError(f"both people are called {self.human}; --human and --avatar tell them apart")
        if not 0 <= self.held_out < self.repetitions:
            raise HighFiveError(
                f"{self.repetitions} repetitions of which {self.held_out} held out leave nothing to learn from; "
                "at least one repetition has to be for training"
            )


@dataclass(frozen=True)
class Take:
    """One that is to be recorded; repetitions count from 0, as in the table."""

    emotion: str
    cell: str
    repetition: int
    split: str

    @property
    def block(self) -> str:
        """Those that are recorded in a row."""
        return f"{self.emotion} {self.repetition + 1}"

    @property
    def name(self) -> str:
        """Of its file, without the ending."""
        return f"{self.emotion}_{self.cell}_{self.repetition + 1}"


def takes_of(asked: Collection) -> list[Take]:
    """All of them, in their order: drawn from the seed and the repetition alone."""
    found: list[Take] = []
    for repetition in range(asked.repetitions):
        rng = np.random.default_rng([asked.seed, repetition])
        split = _SPLIT[repetition >= asked.repetitions - asked.held_out]
        for emotion in rng.permutation(len(asked.emotions)):
            cells = [asked.cells[place] for place in rng.permutation(len(asked.cells))]
            found += [Take(asked.emotions[emotion], cell, repetition, split) for cell in cells]
    return found


class CollectionFolder:
    """A data folder that is added to, by one command at a time."""

    def __init__(self, folder: Path, asked: Collection) -> None:
        """A new one, or one that was begun for the same.

        Raises:
            HighFiveError: it was begun for something else, holds something else, or cannot be read or written.
        """
        self.folder = folder
        asked.check()
        known = folder / SETTINGS
        if known.is_file():
            self._same(asked, _stored(known))
        elif (folder / TABLE).exists():
            raise HighFiveError(f"{folder} has a {TABLE} and no {SETTINGS}: it was not begun by this command")
        self._takes = takes_of(asked)
        self._asked = asked
        self.rows: list[TrialRow] = read_table(folder) if (folder / TABLE).exists() else []
        self.rejected = _reasons(folder / REASONS)
        if missing := [row.file for row in self.rows if not (folder / row.file).is_file()]:
            raise HighFiveError(f"{folder / TABLE} names {missing[0]}, which is gone; put it back, or take its row out")

    @property
    def left(self) -> list[Take]:
        """Takes that are still to be recorded, in their order."""
        done = {(row.emotion, row.cell, row.repetition) for row in self.rows}
        return [take for take in self._takes if (take.emotion, take.cell, take.repetition) not in done]

    @property
    def blocks(self) -> list[dict[str, Any]]:
        """Those that are recorded in a row, with how much of each is done."""
        left, names = {take.name for take in self.left}, list(dict.fromkeys(take.block for take in self._takes))
        found: list[dict[str, Any]] = []
        for name in names:
            takes = [take.name for take in self._takes if take.block == name]
            done = sum(take not in left for take in takes)
            found.append({"name": name, "mode": "recorded", "trials": len(takes), "done": done})
        return found

    def begin(self) -> None:
        """Writes what it is for; from now on it is gone on with for the same alone.

        Raises:
            HighFiveError: it cannot be written.
        """
        if not (self.folder / SETTINGS).is_file():
            self._write(self.folder / SETTINGS, _toml(asdict(self._asked)))

    def accept(self, take: Take) -> None:
        """Its file is whole; now it is one of the data.

        Raises:
            HighFiveError: it cannot be written.
        """
        row = TrialRow(f"{take.name}.c3d", take.emotion, take.cell, take.repetition, take.split == "test")
        rows = [*self.rows, row]
        write_table(self.folder, [(r.file, r.emotion, r.cell, str(r.repetition), _SPLIT[r.test]) for r in rows])
        self.rows = rows

    def rejects(self, take: Take) -> Path:
        """The file under which a take that is not good is kept."""
        number = 1 + sum(row["file"].startswith(f"{REJECTED}/{take.name}-") for row in self.rejected)
        return self.folder / REJECTED / f"{take.name}-{number}.c3d"

    def reject(self, path: Path, why: str) -> None:
        """What is kept there is not good, and why.

        Raises:
            HighFiveError: it cannot be written.
        """
        self.rejected = [*self.rejected, {"file": f"{REJECTED}/{path.name}", "why": why}]
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, _REASON)
        writer.writeheader()
        writer.writerows(self.rejected)
        self._write(self.folder / REASONS, text.getvalue().encode())

    def _same(self, asked: Collection, stored: Collection) -> None:
        for one in fields(Collection):
            was, now = getattr(stored, one.name), getattr(asked, one.name)
            if was != now:
                raise HighFiveError(
                    f"{self.folder} was begun with {one.name} {_said(was)}, now it is {_said(now)}; give another "
                    "--out, or ask for the same"
                )

    def _write(self, path: Path, content: bytes) -> None:
        try:
            write_whole(path, content)
        except OSError as error:
            raise HighFiveError(
                f"cannot write {path}: {error.strerror or error}; make room, and the same command goes on"
            ) from None


def _said(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _stored(path: Path) -> Collection:
    values = read_toml(path, "what was collected,")
    check_keys(values, str(path), {one.name for one in fields(Collection)})
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
    return Collection(**values)


def _toml(values: Mapping[str, Any]) -> bytes:
    """TOML writes texts, whole numbers, lists of them, true and false as JSON does."""
    return "".join(f"{name} = {json.dumps(value)}\n" for name, value in values.items()).encode()


def _reasons(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    try:
        rows = list(csv.DictReader(io.StringIO(read_bounded_text(path, LARGEST_TABLE), newline="")))
        return [{name: row[name] for name in _REASON} for row in rows]
    except (OSError, ValueError, KeyError, csv.Error) as error:
        raise HighFiveError(f"cannot read {path}: {error}; expected the columns {','.join(_REASON)}") from None

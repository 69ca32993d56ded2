"""The table of a data folder: which trials there are, in which emotion, and which are held out."""

from __future__ import annotations

import csv
import io
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from highfive.model.errors import HighFiveError
from highfive.model.files import check_size, write_whole

NEEDED = "file"
"""The column without which there is no trial; the others may be missing."""

HOLD_OUT = 5
"""Where nobody says which trials are held out, it is every so many-th of each emotion."""

NO_EMOTION = "neutral"
"""What a set without any emotion is said to show."""

CONTACT = "contact"
"""A column that a table may have: where it is empty, or says ``no``, no contact comes in that trial."""
_WORDS = {"": False, "no": False, "0": False, "false": False, "yes": True, "1": True, "true": True}

Say = Callable[[str], None]


@dataclass(frozen=True)
class TrialRow:
    """A row of ``trials.csv``; ``contact`` where palms meet."""

    file: str
    emotion: str
    cell: str
    repetition: int
    test: bool
    contact: bool = True


def read_table(folder: Path, say: Say = lambda line: None) -> list[TrialRow]:
    """The high fives of a folder: the trials in which a contact comes.

    Where the table says of no trial whether it is held out, every fifth of each emotion is; where it names no emotion
    at all, there is one.

    Args:
        folder: C3D files and ``trials.csv``.
        say: called with a line about each thing that was decided.

    Raises:
        HighFiveError: no folder, no table, columns missing, a value that is none, or no trial in it.
    """
    rows, split = _all_rows(folder, say)
    rows = [row for row in rows if row.contact]
    if not rows:
        raise HighFiveError(f"{folder / TABLE} lists no trial with a contact")
    return rows if split else with_held_out(rows, say)


def read_without_contact(folder: Path) -> list[TrialRow]:
    """The trials of a folder in which no contact comes: those whose column ``contact`` is empty or says no.

    Raises:
        HighFiveError: as :func:`read_table`.
    """
    return [row for row in _all_rows(folder, lambda line: None)[0] if not row.contact]


def _all_rows(folder: Path, say: Say) -> tuple[list[TrialRow], bool]:
    """All rows, and whether the table says of any which are held out."""
    path = folder / TABLE
    try:
        check_size(path, LARGEST_TABLE)
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            found, columns = list(reader), reader.fieldnames or []
    except OSError as error:
        expected = f"a {TABLE} with the columns {','.join(COLUMNS)}"
        raise HighFiveError(
            f"cannot read {path}: {error.strerror}; a data folder holds C3D files and {expected}"
        ) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise HighFiveError(f"{path} is not a table: {error}") from None
    names = {name.strip().lower(): name for name in columns}
    if NEEDED not in names:
        raise HighFiveError(f"{path} has the columns {', '.join(columns) or 'none'}; {NEEDED} is missing")
    if not found:
        raise HighFiveError(f"{path} lists no trial")
    texts = [{key: (row.get(names.get(key, key)) or "").strip() for key in (*COLUMNS, CONTACT)} for row in found]
    if CONTACT not in names:
        texts = [text | {CONTACT: "yes"} for text in texts]
    if not any(text["emotion"] for text in texts):
        say(f"{path.name} names no emotion: all trials count as {NO_EMOTION}")
        texts = [text | {"emotion": NO_EMOTION} for text in texts]
    return [_row(path, number, text) for number, text in enumerate(texts, start=2)], any(t["split"] for t in texts)


def _row(path: Path, line: int, text: dict[str, str]) -> TrialRow:
    contact = _WORDS.get(text[CONTACT].lower())
    if contact is None:
        raise HighFiveError(f"{path}, line {line}: contact is {text[CONTACT]!r}; expected yes, no or nothing")
    if not text["file"] or not (text["emotion"] or not contact):
        raise HighFiveError(f"{path}, line {line}: a trial needs a file and an emotion")
    split = text["split"].lower() or "train"
    if split not in ("train", "test"):
        raise HighFiveError(f"{path}, line {line}: split is {text['split']!r}; expected train or test")
    try:
        repetition = int(text["repetition"] or -1)
    except ValueError:
        raise HighFiveError(f"{path}, line {line}: repetition is {text['repetition']!r}; expected a number") from None
    return TrialRow(text["file"], text["emotion"], text["cell"], repetition, split == "test", contact)


def with_held_out(rows: Sequence[TrialRow], say: Say) -> list[TrialRow]:
    """The rows as they are if some are held out, else with every fifth of each emotion held out; at least one is.

    Raises:
        HighFiveError: there is a single trial.
    """
    if any(row.test for row in rows):
        return list(rows)
    if len(rows) < 2:
        raise HighFiveError("a single trial cannot be both learned from and held out; record more, or set split train")
    count: dict[str, int] = defaultdict(int)
    decided = []
    for row in rows:
        count[row.emotion] += 1
        decided.append(replace(row, test=count[row.emotion] % HOLD_OUT == 0))
    if not any(row.test for row in decided):
        decided[-1] = replace(decided[-1], test=True)
    held = sum(row.test for row in decided)
    say(
        f"{TABLE} holds out no trial, and scoring needs some: {held} of {len(rows)} are, every {HOLD_OUT}th; split "
        "test says which"
    )
    return decided


TABLE = "trials.csv"


LARGEST_TABLE = 4_000_000
"""Bytes: a hundred thousand trials; read, it takes some forty times as much."""


COLUMNS = ("file", "emotion", "cell", "repetition", "split")


def table_bytes(rows: Sequence[tuple[str, str, str, str, str]]) -> bytes:
    """``trials.csv`` with these rows."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(COLUMNS)
    writer.writerows(rows)
    return text.getvalue().encode()


def write_table(folder: Path, rows: Sequence[tuple[str, str, str, str, str]]) -> None:
    """Writes ``trials.csv``, in one piece.

    Raises:
        HighFiveError: it cannot be written.
    """
    try:
        write_whole(folder / TABLE, table_bytes(rows))
    except OSError as error:
        raise HighFiveError(f"cannot write {folder / TABLE}: {error.strerror}") from None

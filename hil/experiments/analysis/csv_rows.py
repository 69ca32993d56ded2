"""Tables in, row by row: what is wrong in one is said with file and line."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from highfive.model.errors import HighFiveError
from highfive.model.files import check_size

LARGEST_TABLE = 32_000_000
"""Bytes: some hundred thousand trials in all columns; read, it takes some forty times as much."""


@dataclass(frozen=True)
class CsvRow:
    """A row of a file, with the number of its last line."""

    path: Path
    line: int
    cells: dict[str, str]

    def text(self, column: str) -> str:
        """A cell that is filled.

        Raises:
            HighFiveError: it is empty.
        """
        if not (text := self.cells[column]):
            raise self.error(f"{column} is empty")
        return text

    def whole(self, column: str) -> int:
        """A cell's whole number.

        Raises:
            HighFiveError: it is none.
        """
        text = self.text(column)
        try:
            return int(text)
        except ValueError:
            raise self.error(f"{column} is {text!r}; expected a whole number") from None

    def share(self, column: str) -> float | None:
        """A cell's number between 0 and 1; None where it is empty or there is no such column.

        Raises:
            HighFiveError: it is none.
        """
        return self.number(column, 0.0, 1.0) if self.cells.get(column) else None

    def number(self, column: str, low: float, high: float) -> float:
        """A cell's number from ``low`` to ``high``.

        Raises:
            HighFiveError: it is none.
        """
        text = self.text(column)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise self.error(f"{column} is {text!r}; expected a number from {low:g} to {high:g}")
        return value

    def error(self, what: str) -> HighFiveError:
        """An error that names the place."""
        return HighFiveError(f"{self.path}, line {self.line}: {what}")


def read_rows(path: Path, columns: Sequence[str], optional: Sequence[str] = ()) -> list[CsvRow]:
    """The rows of a file with a header; empty lines are none.

    Raises:
        HighFiveError: no such file, no table, columns that are missing or not known, or a row of another length.
    """
    try:
        check_size(path, LARGEST_TABLE)
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except OSError as error:
        raise HighFiveError(
            f"cannot read {path}: {error.strerror}; expected a table with the columns {','.join(columns)}"
        ) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise HighFiveError(f"{path} is not a table: {error}") from None
    lines = [(number, cells) for number, cells in lines if any(cells)]
    if not lines:
        raise HighFiveError(f"{path} is empty; expected a table with the columns {','.join(columns)}")
    header = lines[0][1]
    known = {*columns, *optional}
    if not {*columns} <= {*header} <= known or len({*header}) < len(header):
        more = f" and, if wanted, {','.join(optional)}" if optional else ""
        raise HighFiveError(f"{path} has the columns {','.join(header)}; expected {','.join(columns)}{more}, each once")
    rows = []
    for number, cells in lines[1:]:
        if len(cells) != len(header):
            raise HighFiveError(f"{path}, line {number}: {len(cells)} cells; expected {len(header)}")
        rows.append(CsvRow(path, number, dict(zip(header, cells, strict=True))))
    return rows

"""Points as a table with a header: a time column, and three columns a point: ``wrist_x``, ``wrist_y``, ``wrist_z``.

Also ``wrist.x``, ``wrist X``, ``wrist:X`` and ``wristX``, with or without a unit (``wrist_x_mm``, ``wrist_x [m]``);
commas, semicolons (then also decimal commas) or tabs between. Other columns are left alone.
"""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Iterator, Sequence

import numpy as np

from highfive.mocap_bridge.files.named_points import NamedPoints, at_frames, frames_of, number, unique
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

_TIMES = {"time": 1.0, "time_s": 1.0, "time (s)": 1.0, "time [s]": 1.0, "t": 1.0, "timestamp": 1.0, "seconds": 1.0}
_TIMES |= {"time_ms": 1e-3, "time (ms)": 1e-3, "time [ms]": 1e-3, "timestamp_ms": 1e-3}
"""Names of a column of times, lower case, and s a unit."""
_UNIT = re.compile(r"[ _]*[\[(]?\b(mm|cm|m)[\])]?$|_(mm|cm|m)$", re.IGNORECASE)
_APART = re.compile(r"(.*[^ _.:/-])[ _.:/-]+([xyz])", re.IGNORECASE)
_JOINED = re.compile(r"(.*[a-z0-9])([XYZ])")


def parse_csv(text: str, source: str) -> NamedPoints:
    """Reads the text of such a table.

    Raises:
        HighFiveError: no header, no time column, no points, a point without all three columns, or rows of
            other lengths.
    """
    lines = text.splitlines()
    separator = max(";\t,", key=lines[0].count)
    table = (row for row in csv.reader(lines, delimiter=separator) if row)
    try:
        heads = [head.strip() for head in next(table, [])]
        time = [column for column, head in enumerate(heads) if head.lower() in _TIMES]
        if len(time) != 1:
            found = f"{len(time)} time columns" if time else "no time column"
            raise HighFiveError(f"{source} has {found}; one is to be called time, in s; it has {_some(heads)}")
        columns, unit = _columns(heads, source)
        used = [time[0], *(column for three in columns.values() for column in three)]
        values = _values(table, heads, used, separator == ";", source)
    except csv.Error as error:
        raise HighFiveError(f"{source} is no table: {error}") from None
    times = _TIMES[heads[time[0]].lower()] * values[:, 0]
    if not np.isfinite(times).all():
        raise HighFiveError(f"{source}, row {2 + int(np.argmin(np.isfinite(times)))}: the time is missing")
    rate, frames = frames_of(times, source)
    points = values[:, 1:].reshape(len(values), -1, 3)
    return NamedPoints(source, rate, unique(list(columns), source), at_frames(points, frames), unit)


def _values(
    table: Iterator[list[str]], heads: Sequence[str], used: Sequence[int], decimal_comma: bool, source: str
) -> Array:
    """The numbers (T, C) in the ``used`` columns of the rows below the header."""
    trial = next((column for column, head in enumerate(heads) if head.lower() == "trial"), None)
    trials: set[str] = set()  # a table of several has pauses that are no lost frames
    cells, count = array("d"), 0
    for count, row in enumerate(table, start=1):
        if len(row) != len(heads):
            raise HighFiveError(
                f"{source}, row {count + 1}: {len(row)} cells, its header has {len(heads)}; is it cut off?"
            )
        if trial is not None:
            trials.add(row[trial])
        for column in used:
            cell = row[column].replace(",", ".") if decimal_comma else row[column]
            cells.append(number(cell, f"{source}, row {count + 1}, {heads[column]}"))
    if count < 2:
        raise HighFiveError(f"{source} holds {count} frames; two or more are needed")
    if len(trials) > 1:
        raise HighFiveError(
            f"{source} holds {len(trials)} trials; give a file of each (of our own tables: highfive export --trial N)"
        )
    return np.array(cells).reshape(count, len(used))


def _columns(heads: Sequence[str], source: str) -> tuple[dict[str, tuple[int, int, int]], str | None]:
    """Columns of x, y and z by the name of their point, and the unit that they name, if they name one."""
    found: dict[str, dict[str, int]] = {}
    units = set()
    for column, head in enumerate(heads):
        unit = _UNIT.search(head)
        match = _APART.fullmatch(bare := head[: unit.start()] if unit else head) or _JOINED.fullmatch(bare)
        if match is None:
            continue
        units.add((unit.group(1) or unit.group(2)).lower() if unit else None)
        axes = found.setdefault(match.group(1), {})
        if match.group(2).lower() in axes:
            raise HighFiveError(f"{source} has the column {head} twice")
        axes[match.group(2).lower()] = column
    if not found:
        raise HighFiveError(
            f"{source} has no points: three columns each, such as wrist_x, wrist_y, wrist_z; it has {_some(heads)}"
        )
    for name, axes in found.items():
        if lacking := [f"{name}_{axis}" for axis in "xyz" if axis not in axes]:
            raise HighFiveError(f"{source} has no column {' and no '.join(lacking)}, but others of {name}")
    if len(units) > 1:
        raise HighFiveError(f"{source} names different units in its columns; give all of them in one")
    return {name: (axes["x"], axes["y"], axes["z"]) for name, axes in found.items()}, units.pop()


def _some(heads: Sequence[str]) -> str:
    return f"{', '.join(heads[:6])}{f' and {len(heads) - 6} more' if len(heads) > 6 else ''}"

"""TOML files that people write or read: what is wrong with one is reported in one line."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, TypeGuard

from highfive.model.errors import HighFiveError
from highfive.model.files import read_bounded_text

MOST_BYTES = 4 << 20
"""Largest TOML file that is read: a plan of a thousand trials has 0.3 MB."""
MOST_DOTS = 200
_LONG = re.compile(r"[0-9a-fA-F_]{16}|[01_]{63}|[0-7_]{21}")  # hexadecimal ones, too
_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+\.\d+(?:[eE][+-]?\d+)?(?![\w.])")

_KINDS = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    list: "a list",
    datetime: "a date with a time",
}


def read_toml(path: Path, what: str, error: type[HighFiveError] = HighFiveError) -> dict[str, Any]:
    """The content of a file that is to be ``what``, such as ``"the rig file"``.

    Raises:
        HighFiveError: it cannot be read, or is no TOML; of the class ``error``.
    """
    try:
        text = read_bounded_text(path, MOST_BYTES)
        if any(line.count(".") > MOST_DOTS and _dotted(line) > MOST_DOTS for line in text.splitlines()):
            raise ValueError(f"a line has more than {MOST_DOTS} dots that are in no number")
        found = tomllib.loads(text)
        if _LONG.search(text):
            _check_whole(found)
        return found
    except OSError as wrong:
        raise error(f"cannot read {what} {path}: {wrong.strerror or wrong}") from None
    except HighFiveError as wrong:
        raise error(f"cannot read {what}: {wrong}") from None
    except (ValueError, RecursionError) as wrong:  # ValueError: no TOML, no UTF-8, a number of thousands of digits
        raise error(f"cannot read {what} {path}: it is no TOML file: {wrong}") from None


def _check_whole(value: object) -> None:
    """Whole numbers have 64 bits in TOML; tomllib takes longer ones, which then no float and no array holds."""
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError("a whole number has more than 64 bits")
    for part in value.values() if is_table(value) else value if is_list(value) else ():
        _check_whole(part)


def _dotted(line: str) -> int:
    """Dots of a line that are no decimal points: a key of n parts takes tomllib n² steps."""
    return _NUMBER.sub("", line).count(".")


def is_table(value: object) -> TypeGuard[Mapping[str, Any]]:
    """Whether it is a table, or what JSON calls an object; what is in it is not looked at."""
    return isinstance(value, Mapping)


def is_list(value: object) -> TypeGuard[list[Any]]:
    """Whether it is a list; what is in it is not looked at."""
    return isinstance(value, list)


def check_keys(entry: Any, where: str, required: set[str], optional: set[str] | None = None) -> None:
    """A table has the entries that are ``required``, and none that means nothing.

    Raises:
        HighFiveError: it has not, or is no table; the message begins with ``where``.
    """
    if not is_table(entry):
        raise HighFiveError(f"{where}: got {entry!r}, expected a table with {', '.join(sorted(required))}")
    if missing := required - set(entry):
        raise HighFiveError(f"{where}: {', '.join(sorted(missing))} missing")
    if unknown := set(entry) - required - (optional or set()):
        raise HighFiveError(f"{where}: {', '.join(sorted(unknown))} means nothing here; remove it")


def table(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """The table ``[name]``.

    Raises:
        HighFiveError: there is none.
    """
    if not is_table(found := data.get(name)):
        raise HighFiveError(f"[{name}] is missing")
    return found


def typed(entry: Mapping[str, Any], where: str, name: str, kind: type) -> Any:
    """The entry ``name``, which is of the ``kind``; a whole number is a number, too.

    Args:
        entry: the table.
        where: what a message says before the name, such as ``"meta."`` or ``"joint 1: "``.
        name, kind: of the entry.

    Raises:
        HighFiveError: it is missing, or something else.
    """
    if name not in entry:
        raise HighFiveError(f"{where}{name} is missing")
    value = entry[name]
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = as_float(value)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise HighFiveError(f"{where}{name} is {value!r}, expected {_KINDS[kind]}")
    return value


def as_float(value: float) -> float:
    """A number of a TOML file; a whole number that is too large for a float is infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def number(entry: Mapping[str, Any], where: str, name: str, kind: type, low: float, high: float) -> Any:
    """As :func:`typed`, for a number from ``low`` to ``high``."""
    value = typed(entry, where, name, kind)
    if not low <= value <= high:
        raise HighFiveError(f"{where}{name} is {value}, expected {low:g} to {high:g}")
    return value

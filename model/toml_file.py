"""TOML files that people write or read: what is wrong with one is reported in one line."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, TypeGuard

from highfive.model.errors import HighFiveError

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
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as found:
        raise error(f"cannot read {what} {path}: {found.strerror or found}") from None
    except (ValueError, RecursionError) as found:  # ValueError: no TOML, no UTF-8, a number of thousands of digits
        raise error(f"cannot read {what} {path}: it is no TOML file: {found}") from None


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

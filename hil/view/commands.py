"""What a page may ask of the host: a closed list; whatever else comes is dropped."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_MOST_NAMES, _LONGEST_NAME = 32, 64


@dataclass(frozen=True)
class Command:
    """A wish of the person before the page.

    Attributes:
        name: one of :data:`COMMANDS`.
        value: as :data:`COMMANDS` says; None for those that have none.
    """

    name: str
    value: Any = None


def _number(low: float, high: float) -> Callable[[Any], float | None]:
    def check(value: Any) -> float | None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        try:
            number = float(value)
        except OverflowError:
            return None
        return number if math.isfinite(number) and low <= number <= high else None

    return check


def _whole(low: int, high: int) -> Callable[[Any], int | None]:
    return lambda value: value if type(value) is int and low <= value <= high else None


def _yes_or_no(value: Any) -> bool | None:
    return value if isinstance(value, bool) else None


def _name(value: Any) -> str | None:
    return value if isinstance(value, str) and 0 < len(value) <= _LONGEST_NAME else None


def _weights(value: Any) -> dict[str, float] | None:
    """Style weights by emotion: none below 0, their sum above."""
    if not isinstance(value, dict) or not 0 < len(value) <= _MOST_NAMES:
        return None
    share = _number(0.0, 1.0)
    weights = {name: share(weight) for name, weight in value.items()}
    known = {name: weight for name, weight in weights.items() if _name(name) and weight is not None}
    return known if len(known) == len(value) and sum(known.values()) > 1e-6 else None


COMMANDS: dict[str, Callable[[Any], Any] | None] = {
    "style": _weights,
    "cell": _name,
    "correct": _yes_or_no,
    "pause": _yes_or_no,
    "next": None,
    "again": None,
    "end": None,
    "estop": None,
    "trial": _whole(0, 1_000_000),
    "seek": _number(0.0, 1e6),
    "speed": _number(0.01, 4.0),
    "step": _whole(-1000, 1000),
}
"""Name → what checks its value, giving None for one that is wrong; None where there is no value."""


def parse_command(text: str) -> Command | None:
    """The command in a message; None where there is none that is right.

    Args:
        text: JSON, ``{"kind": "command", "name": …, "value": …}``.
    """
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(message, dict) or message.get("kind") != "command":
        return None
    name = message.get("name")
    if not isinstance(name, str) or name not in COMMANDS:
        return None
    check = COMMANDS[name]
    if check is None:
        return Command(name)
    value = check(message.get("value"))
    return None if value is None else Command(name, value)

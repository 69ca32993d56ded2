"""What a page may ask of the host: a closed list; whatever else comes is dropped."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeGuard

_MOST_NAMES, _LONGEST_NAME, _LONGEST_NOTE = 32, 64, 2000


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
    return value if _is_text(value) and 0 < len(value) <= _LONGEST_NAME else None


def _is_text(value: Any) -> TypeGuard[str]:
    """A text that can be written: JSON may name halves of characters, which no file and no terminal takes."""
    return isinstance(value, str) and not any("\ud800" <= sign <= "\udfff" for sign in value)


def _weights(value: Any) -> dict[str, float] | None:
    """Style weights by emotion: none below 0, their sum above."""
    if not isinstance(value, dict) or not 0 < len(value) <= _MOST_NAMES:
        return None
    share = _number(0.0, 1.0)
    weights = {name: share(weight) for name, weight in value.items()}
    known = {name: weight for name, weight in weights.items() if _name(name) and weight is not None}
    return known if len(known) == len(value) and sum(known.values()) > 1e-6 else None


def _answer(value: Any) -> dict[str, Any] | None:
    """Which key, or label, answers; ``at_ms``, where the page knows the host's time, when it was pressed."""
    if not isinstance(value, dict) or not set(value) <= {"key", "at_ms"} or _name(value.get("key")) is None:
        return None
    at_ms = value.get("at_ms")
    if at_ms is not None and (at_ms := _number(0.0, 1e15)(at_ms)) is None:
        return None
    return {"key": value["key"], "at_ms": at_ms}


def _rating(value: Any) -> dict[str, Any] | None:
    """Where a slider stands."""
    if not isinstance(value, dict) or set(value) != {"name", "value"} or _name(value["name"]) is None:
        return None
    stands = _number(-1e3, 1e3)(value["value"])
    return None if stands is None else {"name": value["name"], "value": stands}


def _note(value: Any) -> str | None:
    return value if _is_text(value) and 0 < len(value.strip()) <= _LONGEST_NOTE else None


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
    "ready": None,
    "answer": _answer,
    "rate": _rating,
    "done": None,
    "note": _note,
    "break_off": None,
    "stop": None,
}
"""Name → what checks its value, giving None for one that is wrong; None where there is no value."""

OF_PARTICIPANTS = frozenset({"ready", "answer", "rate", "done", "estop"})
"""What a participant's page may ask for, in an experiment; all else is the experimenter's."""


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

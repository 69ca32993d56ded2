"""Settings as values: what an algorithm can be tuned by, checked when it is made, with a unit for each field.

A settings class is a frozen dataclass below :class:`Settings` whose fields are made by :func:`setting`; the reason, and
the data that a value was chosen on, stand in the text after each field. Settings are passed to the algorithm, recorded
by :meth:`Settings.values` and varied by ``dataclasses.replace``.
"""

from __future__ import annotations

import math
import sys
from collections import namedtuple
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, cast

from highfive.model.errors import HighFiveError


def setting(
    default: Any,
    unit: str = "",
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
) -> Any:
    """A field of a settings class.

    Args:
        default: a number, a flag, or a tuple of numbers.
        unit: of it, as in ``m/s``; none for shares and counts.
        above, below: bounds that the value, and each number of a tuple, must not reach.
        least, most: bounds that it may reach.
    """
    bounds = {"more than": above, "at least": least, "less than": below, "at most": most}
    return field(default=default, metadata={"unit": unit, "bounds": bounds})


@dataclass(frozen=True)
class Settings:
    """The base of all settings classes.

    Raises:
        HighFiveError: a value that is no finite number of the field's kind, or out of its bounds.
    """

    def __post_init__(self) -> None:
        """Checks every field."""
        for one in fields(self):
            kind, found = cast("type[Any]", type(one.default)), getattr(self, one.name)
            if one.default is MISSING or "bounds" not in one.metadata:
                raise TypeError(f"{type(self).__name__}.{one.name} is no setting()")
            right = isinstance(found, tuple) if kind is tuple else _is_number(found, kind)
            members = cast("tuple[Any, ...]", found) if isinstance(found, tuple) else (found,)
            if not right or not all(_is_number(member, float) or kind is bool for member in members):
                raise HighFiveError(f"{self._named(one.name)}, expected {_described(kind)}")
            for words, bound in one.metadata["bounds"].items():
                if bound is not None and not all(_within(member, words, bound) for member in members):
                    raise HighFiveError(f"{self._named(one.name)}, expected {words} {bound:g}")

    def _named(self, name: str) -> str:
        unit = next(one.metadata["unit"] for one in fields(self) if one.name == name)
        return f"{type(self).__name__}.{name} is {getattr(self, name)!r}{' ' if unit else ''}{unit}"

    def values(self) -> dict[str, Any]:
        """Every field's value by its name, as a recording keeps them."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def compiled(self) -> Any:
        """The same names and values as a named tuple, which compiled code takes: that of :func:`named_tuple`."""
        made = getattr(sys.modules[type(self).__module__], f"{type(self).__name__}Values")
        return made(**self.values())


def named_tuple(settings: type[Settings]) -> Any:
    """The class of :meth:`Settings.compiled`; to be kept in the settings' module as ``<name of the class>Values``.

    There it is found by its name: code that was compiled for it is kept from one process to the next.
    """
    names = [one.name for one in fields(settings)]
    # Its fields are known at run time only.
    return namedtuple(f"{settings.__name__}Values", names, module=settings.__module__)  # pyright: ignore[reportUntypedNamedTuple]


def _is_number(value: object, kind: type) -> bool:
    if kind is bool:
        return isinstance(value, bool)
    if isinstance(value, bool) or not isinstance(value, int if kind is int else (int, float)):
        return False
    return math.isfinite(value)


def _described(kind: type) -> str:
    names = {int: "a whole number", bool: "true or false", tuple: "a tuple of finite numbers"}
    return names.get(kind, "a finite number")


def _within(value: float, words: str, bound: float) -> bool:
    return {
        "more than": value > bound,
        "at least": value >= bound,
        "less than": value < bound,
        "at most": value <= bound,
    }[words]

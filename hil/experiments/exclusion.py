"""What a lab leaves out of its analysis: rules in a TOML file, written before the data are looked at.

    [[trials]]                       # a trial that one of these holds for
    why = "faster than anybody sees it"
    column = "rt_s"                  # of the log; ratings.natural for a rating
    below = 0.2                      # or above, or is

    [[people]]                       # all trials of a person whom one of these holds for
    why = "a quarter of her trials does not count"
    not_counted_above = 0.25         # or right_below, or codes

A trial has one reason, that of the first rule that holds; the log's own come before these.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from highfive.hil.experiments.protocol import Mode
from highfive.hil.experiments.trial_row import TrialRow
from highfive.model.errors import HighFiveError
from highfive.model.toml_file import as_float, check_keys, is_list, read_toml, typed

RATING = "ratings."
"""Before the name of a rating that a rule is about."""
_NUMBERS = {one.name for one in fields(TrialRow) if str(one.type).startswith(("int", "float"))}
_OTHERS = {one.name for one in fields(TrialRow) if str(one.type) in ("str", "bool")}
_PERSON = ("not_counted_above", "right_below", "codes")
_TRIAL = ("below", "above", "is")


@dataclass(frozen=True)
class TrialRule:
    """Leaves out trials.

    Attributes:
        why: the reason that is listed.
        column: of the log, or ``ratings.NAME``.
        below, above: holds for a number beyond it; None where that is not asked.
        equals: holds for this text, number, or true or false; None where that is not asked.
        conditions: of the trials that are looked at; empty for all.
    """

    why: str
    column: str
    below: float | None = None
    above: float | None = None
    equals: str | float | bool | None = None
    conditions: tuple[str, ...] = ()

    def holds(self, row: TrialRow) -> bool:
        """Whether the trial is left out; what has no value in that column is not."""
        if self.conditions and row.condition not in self.conditions:
            return False
        rating = self.column.startswith(RATING)
        value: Any = row.ratings.get(self.column.removeprefix(RATING)) if rating else getattr(row, self.column)
        if value is None:
            return False
        if self.equals is not None:
            return value == self.equals
        return (self.below is not None and value < self.below) or (self.above is not None and value > self.above)


@dataclass(frozen=True)
class PersonRule:
    """Leaves out people, by their trials that still count.

    Attributes:
        why: the reason that is listed.
        not_counted_above: holds where a larger share of those of her trials that would be compared does not count.
        right_below: holds where a smaller share of what counts was answered rightly.
        codes: holds for these.
    """

    why: str
    not_counted_above: float | None = None
    right_below: float | None = None
    codes: tuple[str, ...] = ()

    def holds(self, code: str, counted: Sequence[TrialRow], asked: int) -> bool:
        """Whether she is left out; ``asked`` of her trials would be compared if nothing had happened."""
        if code in self.codes:
            return True
        if self.not_counted_above is not None and asked and 1.0 - len(counted) / asked > self.not_counted_above:
            return True
        judged = [row for row in counted if row.expected]
        share = None if not judged else sum(row.answer == row.expected for row in judged) / len(judged)
        return self.right_below is not None and share is not None and share < self.right_below


@dataclass(frozen=True)
class ExclusionRules:
    """A file of them.

    Attributes:
        source: the file's name.
        digest: 12 digits of its content: which rules they were.
        trials, people: in the file's order.
    """

    source: str = ""
    digest: str = ""
    trials: tuple[TrialRule, ...] = ()
    people: tuple[PersonRule, ...] = ()


def read_rules(path: Path) -> ExclusionRules:
    """The rules of a file.

    Raises:
        HighFiveError: it cannot be read, or a rule in it means nothing.
    """
    values = read_toml(path, "the rules")
    check_keys(values, str(path), set(), {"trials", "people"})
    found: dict[str, list[Any]] = {"trials": [], "people": []}
    for kind, made in (("trials", _trial_rule), ("people", _person_rule)):
        entries = values.get(kind, [])
        if not is_list(entries):
            raise HighFiveError(f"{path}: {kind} is {entries!r}, expected [[{kind}]] tables")
        found[kind] = [made(entry, f"{path}: {kind} {number}") for number, entry in enumerate(entries, start=1)]
    if not found["trials"] and not found["people"]:
        raise HighFiveError(f"{path} has no rule; expected [[trials]] or [[people]]")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    return ExclusionRules(path.name, digest, tuple(found["trials"]), tuple(found["people"]))


def _trial_rule(entry: Any, where: str) -> TrialRule:
    check_keys(entry, where, {"why", "column"}, {*_TRIAL, "conditions"})
    column, given = typed(entry, f"{where}: ", "column", str), [name for name in _TRIAL if name in entry]
    known = column in _NUMBERS | _OTHERS or column.startswith(RATING)
    if not known:
        raise HighFiveError(f"{where}: column is {column!r}; there are {', '.join(sorted(_NUMBERS | _OTHERS))}")
    if not given or ("is" in given and len(given) > 1):
        raise HighFiveError(f"{where}: expected below, above, both, or is")
    if column in _OTHERS and "is" not in given:
        raise HighFiveError(f"{where}: {column} is no number; expected is")
    limits = {name: _finite(entry, where, name) for name in given if name != "is"}
    equals = entry.get("is")
    if equals is not None and not isinstance(equals, str | int | float | bool):
        raise HighFiveError(f"{where}: is is {equals!r}, expected a text, a number, true or false")
    conditions = _texts(entry, where, "conditions")
    if unknown := [one for one in conditions if one not in [mode.value for mode in Mode]]:
        raise HighFiveError(f"{where}: condition {unknown[0]!r}; there are {', '.join(mode.value for mode in Mode)}")
    return TrialRule(_why(entry, where), column, limits.get("below"), limits.get("above"), equals, conditions)


def _person_rule(entry: Any, where: str) -> PersonRule:
    check_keys(entry, where, {"why"}, set(_PERSON))
    given = [name for name in _PERSON if name in entry]
    if len(given) != 1:
        raise HighFiveError(f"{where}: expected one of {', '.join(_PERSON)}")
    shares = {name: _finite(entry, where, name) for name in given if name != "codes"}
    for name, share in shares.items():
        if not 0.0 <= share <= 1.0:
            raise HighFiveError(f"{where}: {name} is {share:g}, expected a share from 0 to 1")
    return PersonRule(
        _why(entry, where), shares.get("not_counted_above"), shares.get("right_below"), _texts(entry, where, "codes")
    )


def _why(entry: Mapping[str, Any], where: str) -> str:
    why = typed(entry, f"{where}: ", "why", str).strip()
    if not why:
        raise HighFiveError(f"{where}: why is empty; the reason is listed with each trial")
    return why


def _finite(entry: Mapping[str, Any], where: str, name: str) -> float:
    value = as_float(typed(entry, f"{where}: ", name, float))
    if not abs(value) < float("inf"):
        raise HighFiveError(f"{where}: {name} is {value}, expected a finite number")
    return value


def _texts(entry: Mapping[str, Any], where: str, name: str) -> tuple[str, ...]:
    value = entry.get(name, [])
    if not is_list(value) or not all(isinstance(one, str) for one in value) or (name in entry and not value):
        raise HighFiveError(f"{where}: {name} is {value!r}, expected a list of texts")
    return tuple(value)

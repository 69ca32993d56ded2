"""How many answers were right, a person and a condition: what the tables of recognition are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from highfive.hil.experiments.analysis.csv_rows import CsvRow, read_rows
from highfive.model.errors import HighFiveError

CONDITIONS = ("interactive", "replay")
"""The avatar answers the person; the person sees one of her earlier trials again."""
MOST = 1_000_000
"""Trials of a person and condition: more are a mistake."""
COLUMNS = ("participant", "condition", "correct", "n")


@dataclass(frozen=True)
class Count:
    """Answers of one person in one condition.

    Attributes:
        correct: right ones, at most ``n``.
        n: all of them, at least one.
    """

    correct: int
    n: int

    @property
    def wrong(self) -> int:
        """The others."""
        return self.n - self.correct


@dataclass(frozen=True)
class PersonCounts:
    """One person in both conditions, with her code."""

    participant: str
    interactive: Count
    replay: Count


def read_counts(path: Path) -> list[PersonCounts]:
    """The people of a file with the columns ``participant,condition,correct,n``, in its order.

    Raises:
        HighFiveError: no such file or no table, other columns, a value that is none, a condition that is not known or
            is there twice, no people, or one person or one condition alone.
    """
    found: dict[str, dict[str, Count]] = {}
    for row in read_rows(path, COLUMNS):
        person, condition = row.text("participant"), row.text("condition")
        counts = found.setdefault(person, {})
        if condition in CONDITIONS and condition in counts:
            raise row.error(f"{person} has {condition} twice; give the sum of the blocks in one row")
        counts[check_condition(row, condition)] = _count(row)
    return paired(found, str(path))


def check_condition(row: CsvRow, condition: str) -> str:
    """The condition of a row.

    Raises:
        HighFiveError: it is none of :data:`CONDITIONS`.
    """
    if condition not in CONDITIONS:
        raise row.error(f"condition is {condition!r}; expected {' or '.join(CONDITIONS)}")
    return condition


def paired(found: dict[str, dict[str, Count]], source: str, least: int = 2) -> list[PersonCounts]:
    """The people whose counts can be compared.

    Args:
        found: person → condition → count.
        source: what errors name: the file.
        least: so many people are needed.

    Raises:
        HighFiveError: nobody, one person or one condition alone, or somebody who lacks a condition.
    """
    if not found:
        raise HighFiveError(f"{source} holds no answers; run the experiment first")
    there = {condition for counts in found.values() for condition in counts}
    if len(there) < 2:
        missing = next(condition for condition in CONDITIONS if condition not in there)
        raise HighFiveError(
            f"{source} holds {next(iter(there))} trials alone; the comparison needs {missing} trials as well"
        )
    for person, counts in found.items():
        for condition in CONDITIONS:
            if condition not in counts:
                raise HighFiveError(f"{source}: {person} has no {condition} trials; complete or leave out {person}")
    if len(found) < least:
        raise HighFiveError(
            f"{source} holds one person, {next(iter(found))}; what differs between people needs two or more"
        )
    return [PersonCounts(person, *(counts[condition] for condition in CONDITIONS)) for person, counts in found.items()]


def pooled(people: Sequence[PersonCounts]) -> PersonCounts:
    """All people's answers as if one person had given them."""
    interactive, replay = [[getattr(person, condition) for person in people] for condition in CONDITIONS]
    sums = [Count(sum(c.correct for c in counts), sum(c.n for c in counts)) for counts in (interactive, replay)]
    return PersonCounts("pooled", *sums)


def _count(row: CsvRow) -> Count:
    correct, n = row.whole("correct"), row.whole("n")
    if not 1 <= n <= MOST:
        raise row.error(f"n is {n}; expected 1 to {MOST} trials")
    if not 0 <= correct <= n:
        raise row.error(f"{correct} correct of {n}; expected 0 to {n}")
    return Count(correct, n)

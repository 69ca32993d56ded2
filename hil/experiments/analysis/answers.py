"""Answers trial by trial: what was shown, what was said, and of morphs, how much of a style there was."""

from __future__ import annotations

import csv
import io
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from highfive.hil.experiments.analysis.confusion import Confusion, confusion
from highfive.hil.experiments.analysis.counts import CONDITIONS, Count, PersonCounts, check_condition, paired
from highfive.hil.experiments.analysis.csv_rows import read_rows
from highfive.hil.experiments.analysis.psychometric import Psychometric, fit
from highfive.model.errors import HighFiveError

COLUMNS = ("participant", "condition", "emotion", "answer")
BESIDE = ("other_replay", "no_contingency")
"""Conditions beside those of the source's comparison: another's trials are shown; she acts, and is not answered."""
TIDY = ("participant", "condition", "trial", "emotion", "weight", "answer", "correct")


@dataclass(frozen=True)
class Answer:
    """One trial.

    Attributes:
        participant: code.
        condition: one of :data:`~highfive.hil.experiments.analysis.counts.CONDITIONS`, or of :data:`BESIDE`.
        emotion: shown; of a morph, its second style.
        answer: the emotion that was said.
        weight: of a morph, the share of ``emotion`` in it, 0 to 1; else None.
    """

    participant: str
    condition: str
    emotion: str
    answer: str
    weight: float | None = None

    @property
    def agrees(self) -> bool:
        """Whether the emotion was said."""
        return self.answer == self.emotion


def read_answers(path: Path) -> list[Answer]:
    """The trials of a file with the columns ``participant,condition,emotion,answer`` and, of morphs, ``weight``; also
    those of :func:`tidy_csv`.

    Raises:
        HighFiveError: no such file or no table, other columns, a value that is none, no trials, or morphs towards more
            than one style.
    """
    answers = [
        Answer(
            row.text("participant"),
            condition if (condition := row.text("condition")) in BESIDE else check_condition(row, condition),
            row.text("emotion"),
            row.text("answer"),
            row.share("weight"),
        )
        for row in read_rows(path, COLUMNS, ("weight", "trial", "correct"))
    ]
    if not answers:
        raise HighFiveError(f"{path} holds no answers; run the experiment first")
    seconds = sorted({one.emotion for one in answers if one.weight is not None})
    if len(seconds) > 1:
        raise HighFiveError(
            f"{path} morphs towards {' and '.join(seconds)}; give each pair of styles a file of its own"
        )
    return answers


def counts_of(answers: Sequence[Answer], source: str, least: int = 2) -> list[PersonCounts]:
    """How many answers to whole emotions were right, of ``least`` people or more; nobody if all were to morphs.

    Raises:
        HighFiveError: people or conditions are missing that a comparison needs.
    """
    counts = right_by_person(answers)
    return paired(counts, source, least) if counts else []


def right_by_person(answers: Sequence[Answer]) -> dict[str, dict[str, Count]]:
    """Person → condition → how many answers to whole emotions were right."""
    found: dict[str, dict[str, list[bool]]] = defaultdict(lambda: defaultdict(list))
    for one in answers:
        if one.weight is None:
            found[one.participant][one.condition].append(one.agrees)
    return {
        person: {condition: Count(sum(right), len(right)) for condition, right in conditions.items()}
        for person, conditions in found.items()
    }


def confusions_of(answers: Sequence[Answer]) -> dict[str, Confusion]:
    """Condition → confusion matrix of all people's answers to whole emotions, where there are such.

    Raises:
        HighFiveError: one label alone occurs.
    """
    found: dict[str, Confusion] = {}
    for condition in (*CONDITIONS, *BESIDE):
        here = [one for one in answers if one.weight is None and one.condition == condition]
        if here:
            found[condition] = confusion([one.emotion for one in here], [one.answer for one in here])
    return found


def fits_of(answers: Sequence[Answer], level: float = 0.95) -> dict[str, dict[str, Psychometric]]:
    """Condition → person → psychometric function of the answers to morphs, where there are such."""
    found: dict[str, dict[str, Psychometric]] = {}
    for condition in (*CONDITIONS, *BESIDE):
        here = [one for one in answers if one.weight is not None and one.condition == condition]
        for person in dict.fromkeys(one.participant for one in here):
            own = [(one.weight, one.agrees) for one in here if one.participant == person and one.weight is not None]
            weights, seconds = zip(*own, strict=True)
            found.setdefault(condition, {})[person] = fit(weights, seconds, level=level)
    return found


def tidy_csv(answers: Sequence[Answer]) -> bytes:
    """One row a trial, numbered from 1 a person and condition; ``correct`` is empty for morphs."""
    text, numbers = io.StringIO(), defaultdict[tuple[str, str], int](int)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(TIDY)
    for one in answers:
        numbers[one.participant, one.condition] += 1
        weight, correct = ("", int(one.agrees)) if one.weight is None else (f"{one.weight:.6g}", "")
        number = numbers[one.participant, one.condition]
        writer.writerow([one.participant, one.condition, number, one.emotion, weight, one.answer, correct])
    return text.getvalue().encode()

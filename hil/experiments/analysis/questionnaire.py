"""Questionnaires that a lab supplies: items, poles, subscales and licence as TOML, answers as CSV, scores a person.

A subscale's score is the mean of its items; of a reversed one, low + high − answer counts. No questionnaire's items
come along: what may be copied is the lab's to know. Reliability is Cronbach's alpha (1951), over those who answered all
items of a subscale.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.experiments.analysis.csv_rows import read_rows
from highfive.hil.experiments.analysis.times import mean_and_sd
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.toml_file import check_keys, is_list, number, read_toml, typed


@dataclass(frozen=True)
class Item:
    """A question.

    Attributes:
        name: by which it is answered.
        subscale: that it is of.
        low, high: what its two ends are called; may be empty.
        reversed: more of it is less of the subscale.
    """

    name: str
    subscale: str
    low: str = ""
    high: str = ""
    reversed: bool = False


@dataclass(frozen=True)
class Questionnaire:
    """As its file says.

    Attributes:
        name: of it.
        licence, source: of its items.
        low, high: ends of the scale of all items.
        items: in their order.
        answers: file with the columns ``participant,item,value`` and, if wanted, ``condition``.
    """

    name: str
    licence: str
    source: str
    low: float
    high: float
    items: tuple[Item, ...]
    answers: Path

    @property
    def subscales(self) -> list[str]:
        """Their names, in the order of their items."""
        return list(dict.fromkeys(item.subscale for item in self.items))


Answers = Mapping[tuple[str, str], Mapping[str, float]]
"""(participant, condition) -> item -> answer."""


def read_questionnaire(path: Path) -> Questionnaire:
    """What a file says.

    Raises:
        HighFiveError: it cannot be read, or is no questionnaire.
    """
    data = read_toml(path, "the questionnaire")
    where = f"{path}: "
    check_keys(data, str(path), {"name", "licence", "source", "low", "high", "answers", "items"})
    low, high = (float(number(data, where, name, float, -1e6, 1e6)) for name in ("low", "high"))
    if low >= high:
        raise HighFiveError(f"{where}low is {low:g} and high {high:g}; expected a scale from low to high")
    entries = data["items"]
    if not is_list(entries) or not entries:
        raise HighFiveError(f"{where}items: expected a table [[items]] for each item")
    items = tuple(_item(entry, f"{path}, item {place}") for place, entry in enumerate(entries, 1))
    names = [item.name for item in items]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise HighFiveError(f"{where}item {twice} is there twice; each has a name of its own")
    texts = [_text(data, where, name) for name in ("name", "licence", "source")]
    return Questionnaire(texts[0], texts[1], texts[2], low, high, items, path.parent / _text(data, where, "answers"))


def read_questionnaire_answers(asked: Questionnaire, people: Collection[str] | None = None) -> Answers:
    """Everybody's answers; the condition is empty where the file has none. ``people`` are those of the study.

    Raises:
        HighFiveError: no table, an item that the questionnaire lacks or that was answered twice, an answer off the
            scale, or of who is none of those people, or none at all.
    """
    known = {item.name for item in asked.items}
    found: dict[tuple[str, str], dict[str, float]] = {}
    for row in read_rows(asked.answers, ("participant", "item", "value"), ("condition",)):
        item, value = row.text("item"), row.number("value", asked.low, asked.high)
        if item not in known:
            raise row.error(f"item is {item!r}; {asked.name} has {', '.join(item.name for item in asked.items)}")
        if people is not None and row.text("participant") not in people:
            raise row.error(f"participant is {row.text('participant')!r}; the study has {', '.join(sorted(people))}")
        hers = found.setdefault((row.text("participant"), row.cells.get("condition", "")), {})
        if item in hers:
            raise row.error(f"{item} is answered twice")
        hers[item] = value
    if not found:
        raise HighFiveError(f"{asked.answers} holds no answers")
    return found


def scores(asked: Questionnaire, answers: Answers) -> dict[tuple[str, str], dict[str, float | None]]:
    """(participant, condition) -> subscale -> mean of its items; None where more than half of them are missing."""
    result: dict[tuple[str, str], dict[str, float | None]] = {}
    for who, hers in answers.items():
        result[who] = {}
        for subscale in asked.subscales:
            items = [item for item in asked.items if item.subscale == subscale]
            values = [_turned(asked, item, hers[item.name]) for item in items if item.name in hers]
            result[who][subscale] = float(np.mean(values)) if 2 * len(values) >= len(items) and values else None
    return result


def alpha(asked: Questionnaire, subscale: str, answers: Answers) -> float | None:
    """Cronbach's alpha of a subscale; None of one item, of fewer than three people, or where nobody differs."""
    items = [item for item in asked.items if item.subscale == subscale]
    rows = [
        [_turned(asked, item, hers[item.name]) for item in items]
        for hers in answers.values()
        if all(item.name in hers for item in items)
    ]
    if len(items) < 2 or len(rows) < 3:
        return None
    values: Array = np.array(rows)
    total = float(values.sum(axis=1).var(ddof=1))
    if total <= 0.0:
        return None
    return float(len(items) / (len(items) - 1) * (1.0 - values.var(axis=0, ddof=1).sum() / total))


def summary(asked: Questionnaire, answers: Answers) -> dict[str, Any]:
    """For a report: scores of everybody, and a subscale's mean, sd, number of people and alpha, by condition."""
    found = scores(asked, answers)
    conditions = list(dict.fromkeys(condition for _, condition in answers))
    subscales: dict[str, Any] = {}
    for name in asked.subscales:
        subscales[name] = {}
        for condition in conditions:
            here = {who: hers for who, hers in answers.items() if who[1] == condition}
            values = [score for who in here if (score := found[who][name]) is not None]
            subscales[name][condition] = {**mean_and_sd(values), "alpha": alpha(asked, name, here)}
    people = [
        {"participant": participant, "condition": condition, "scores": one}
        for (participant, condition), one in found.items()
    ]
    return {
        "licence": asked.licence, "source": asked.source, "low": asked.low, "high": asked.high,
        "subscales": subscales, "people": people,
    }  # fmt: skip


def _turned(asked: Questionnaire, item: Item, value: float) -> float:
    return asked.low + asked.high - value if item.reversed else value


def _item(entry: Any, where: str) -> Item:
    check_keys(entry, where, {"name", "subscale"}, {"low", "high", "reversed"})
    texts = {name: typed(entry, f"{where}: ", name, str) for name in ("low", "high") if name in entry}
    turned = typed(entry, f"{where}: ", "reversed", bool) if "reversed" in entry else False
    named = [_text(entry, f"{where}: ", name) for name in ("name", "subscale")]
    return Item(named[0], named[1], texts.get("low", ""), texts.get("high", ""), turned)


def _text(entry: Mapping[str, Any], where: str, name: str) -> str:
    text: str = typed(entry, where, name, str)
    if not text.strip():
        raise HighFiveError(f"{where}{name} is empty")
    return text

"""Tables of an experiment's page: times and synchrony, ratings, questionnaires, and what does not count."""

from __future__ import annotations

from collections import Counter
from html import escape
from typing import Any

from highfive.hil.report.page import table


def times_table(result: dict[str, Any]) -> str:
    """Median and quartiles of each figure by condition."""
    rows = [
        [
            condition.replace("_", " "),
            _in_words(name),
            str(one["n"]),
            *(f"{one[key]:.4g}" for key in ("q1", "median", "q3")),
        ]
        for condition, figures in (result.get("timing") or {}).items()
        for name, one in figures.items()
        if one["n"]
    ]
    if not rows:
        return ""
    missing = Counter(one["why"] for one in result.get("motion", {}).get("missing", []))
    lines = "".join(f"<p>Without timing: {count} trials: {escape(why)}.</p>" for why, count in missing.most_common())
    return table(["condition", "figure", "trials", "first quartile", "median", "third quartile"], rows, {0, 1}) + lines


_UNITS = {"s": "s", "m": "m", "speed": "m/s"}
"""Last word of a figure's name -> unit; a speed stays one."""


def _in_words(name: str) -> str:
    *words, last = name.split("_")
    if last not in _UNITS:
        return name.replace("_", " ")
    return f"{' '.join([*words, last] if len(last) > 1 else words)}, {_UNITS[last]}"


def ratings_table(result: dict[str, Any]) -> str:
    """Mean and standard deviation of each rating, by condition and style."""
    rows = [
        [name, condition.replace("_", " "), style, str(one["n"]), _figure(one["mean"]), _figure(one["sd"])]
        for name, conditions in (result.get("ratings") or {}).items()
        for condition, styles in conditions.items()
        for style, one in styles.items()
    ]
    return table(["rating", "condition", "style", "trials", "mean", "sd"], rows, {0, 1, 2}) if rows else ""


def questionnaires_table(result: dict[str, Any]) -> str:
    """Scores of questionnaires, with licence and source."""
    rows, lines = [], []
    for name, asked in result.get("questionnaires", {}).items():
        lines.append(f"<p>{escape(name)}: {escape(asked['source'])}; licence: {escape(asked['licence'])}.</p>")
        for subscale, conditions in asked["subscales"].items():
            for condition, one in conditions.items():
                figures = [_figure(one[key]) for key in ("mean", "sd", "alpha")]
                rows.append([name, subscale, condition or "–", str(one["n"]), *figures])
    heads = ["questionnaire", "subscale", "condition", "people", "mean", "sd", "Cronbach's alpha"]
    return table(heads, rows, {0, 1, 2}) + "".join(lines) if rows else ""


def excluded_table(result: dict[str, Any]) -> str:
    """How many trials do not count, by reason, each of them in the tidy table; and logs in which trials are missing."""
    why = Counter(one["why"] for one in result.get("excluded", []))
    rows = [[reason, str(count)] for reason, count in why.most_common()]
    lines = "".join(
        f'<p class="warning">Log of {one["participant"]}, session {one["session"]}: {escape(one["why"])}.</p>'
        for one in result.get("incomplete_logs", [])
    )
    return (table(["reason", "trials"], rows, {0}) if rows else "") + lines


def _figure(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"

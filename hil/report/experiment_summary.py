"""The tables of an experiment's page as one CSV in long form, for a paper's own tables: one row a figure."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from typing import Any

from highfive.hil.experiments.analysis.counts import CONDITIONS

COLUMNS = ("table", "condition", "item", "figure", "n", "estimate", "sd", "low", "high", "range", "p_above_0")
QUARTILES = "quartiles"

Row = dict[str, Any]


def summary_csv(result: dict[str, Any]) -> bytes:
    """UTF-8 CSV of :data:`COLUMNS`; a cell is empty where a figure has no such value.

    ``low`` and ``high`` are what ``range`` says: a credible interval, or the quartiles about a median.

    Args:
        result: from :func:`highfive.hil.commands.experiment_analyse.analyse`.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for part in (_recognition, _effects, _emotions, _psychometric, _timing, _ratings, _questionnaires):
        for row in part(result):
            writer.writerow([row.get(column) for column in COLUMNS])
    return text.getvalue().encode()


def _recognition(result: dict[str, Any]) -> Iterator[Row]:
    """Table 1 of the source study."""
    for person, row in (result.get("table") or {}).items():
        if not isinstance(row, dict):
            continue
        at = {"table": "recognition", "item": person, "figure": "rate"}
        for condition in CONDITIONS:
            yield at | {"condition": condition, "estimate": row[condition]["mean"], "sd": row[condition]["se"]}
        yield at | {
            "condition": "interactive - replay",
            "figure": "interactive higher",
            "p_above_0": row["p_interactive_higher"],
        }


def _effects(result: dict[str, Any]) -> Iterator[Row]:
    found = {"replay": result["hierarchical"]} if result.get("hierarchical") else {}
    for condition, one in result.get("contrasts", {}).items():
        if one["effects"] is not None:
            found[condition] = one["effects"]
    for condition, one in found.items():
        yield _effect(one) | {"table": "effect", "condition": f"interactive - {condition}", "figure": "logit"}


def _effect(one: dict[str, Any]) -> Row:
    low, high = one["interval"]
    return {
        "estimate": one["mean"],
        "sd": one["sd"],
        "low": low,
        "high": high,
        "range": _level(one["level"]),
        "p_above_0": one["p_positive"],
    }


def _emotions(result: dict[str, Any]) -> Iterator[Row]:
    for condition, found in result.get("confusion", {}).items():
        for emotion, one in found["emotions"].items():
            low, high = one["interval"]
            at = {"table": "emotions", "condition": condition, "item": emotion, "n": one["shown"]}
            rate = {"estimate": one["mean"], "low": low, "high": high, "range": _level(result["level"])}
            yield at | {"figure": "rate"} | rate
            yield at | {"figure": "unbiased hit rate", "estimate": one["unbiased"]}
            yield at | {"figure": "answer bias", "estimate": one["answer_bias"]}


def _psychometric(result: dict[str, Any]) -> Iterator[Row]:
    found = result.get("psychometric") or {"conditions": {}}
    at = {"table": "psychometric"}
    for condition, here in found["conditions"].items():
        for person, one in here["people"].items():
            for name in ("pse", "jnd", "lapse"):
                low, high = one[name]["interval"]
                figures = {"estimate": one[name]["value"], "low": low, "high": high, "range": _level(result["level"])}
                yield at | {"condition": condition, "item": person, "figure": name, "n": one["trials"]} | figures
        for key, name in (("pooled_pse", "pse, all people"), ("pooled_log_jnd", "ln jnd, all people")):
            if key in here:
                yield at | _effect(here[key]) | {"condition": condition, "figure": name}
    if "pse_shift" in found:
        yield at | _effect(found["pse_shift"]) | {"condition": "interactive - replay", "figure": "shift of the pse"}


def _timing(result: dict[str, Any]) -> Iterator[Row]:
    for condition, figures in (result.get("timing") or {}).items():
        for name, one in figures.items():
            if one["n"]:
                values = {"estimate": one["median"], "low": one["q1"], "high": one["q3"], "range": QUARTILES}
                yield {"table": "timing", "condition": condition, "figure": name, "n": one["n"]} | values


def _ratings(result: dict[str, Any]) -> Iterator[Row]:
    for name, conditions in (result.get("ratings") or {}).items():
        for condition, styles in conditions.items():
            for style, one in styles.items():
                at = {"table": "ratings", "condition": condition, "item": style, "figure": name}
                yield at | {"n": one["n"], "estimate": one["mean"], "sd": one["sd"]}


def _questionnaires(result: dict[str, Any]) -> Iterator[Row]:
    for name, asked in result.get("questionnaires", {}).items():
        for subscale, conditions in asked["subscales"].items():
            for condition, one in conditions.items():
                at = {"table": "questionnaires", "condition": condition, "item": f"{name}, {subscale}", "n": one["n"]}
                yield at | {"figure": "score", "estimate": one["mean"], "sd": one["sd"]}
                yield at | {"figure": "Cronbach's alpha", "estimate": one["alpha"]}


def _level(level: float) -> str:
    return f"{100.0 * level:g}% interval"

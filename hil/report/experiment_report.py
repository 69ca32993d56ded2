"""The report of an experiment: one self-contained page, its figures for print, its numbers, and one row a trial.

The same answers give the same files, bit for bit: nothing in them says when or where they were made.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from highfive.hil.experiments.analysis.answers import Answer, tidy_csv
from highfive.hil.experiments.analysis.counts import CONDITIONS, PersonCounts
from highfive.hil.report import experiment_figures
from highfive.hil.report.drawing import Drawing, draw, to_pdf, to_png, to_svg_file
from highfive.hil.report.experiment_summary import summary_csv
from highfive.hil.report.experiment_tables import excluded_table, questionnaires_table, ratings_table, times_table
from highfive.hil.report.page import figures, render, section, table
from highfive.hil.report.report import DATA, FIGURES, PAGE
from highfive.hil.runtime.console import counted
from highfive.hil.runtime.folders import write_file

TRIALS = "trials.csv"
SUMMARY = "summary.csv"
SIMULATED = "All participants are simulated: nothing here is a finding about people."


def write_experiment(
    folder: Path, result: dict[str, Any], people: Sequence[PersonCounts], answers: Sequence[Answer]
) -> Path:
    """Writes ``report.html``, ``report.json``, ``summary.csv``, ``figures/`` (PNG, SVG, PDF) and ``trials.csv``.

    Returns:
        the page.

    Args:
        folder: made if it is not there; an older report in it is replaced.
        result: from :func:`highfive.hil.commands.experiment_analyse.analyse`; ``report.json`` is the same.
        people: counts, of answers to whole emotions.
        answers: trial by trial; none where there were counts alone.

    Raises:
        HighFiveError: a file cannot be written.
    """
    drawings = draw(
        [
            partial(experiment_figures.rates, result),
            partial(experiment_figures.effects, result, people),
            partial(experiment_figures.confusions, answers),
            partial(experiment_figures.psychometric, answers, result["level"]),
            partial(experiment_figures.timing, result),
        ]
    )
    files: dict[Path, bytes] = {}
    for drawing in drawings:
        for ending, made in (("png", to_png), ("svg", to_svg_file), ("pdf", to_pdf)):
            files[folder / FIGURES / f"{drawing.name}.{ending}"] = made(drawing.figure)
    if answers:
        files[folder / TRIALS] = tidy_csv(answers)
    files[folder / SUMMARY] = summary_csv(result)
    files[folder / DATA] = json.dumps(result, indent=2, allow_nan=False, ensure_ascii=False).encode()
    files[folder / PAGE] = _page(result, drawings, answers).encode()
    for path, content in files.items():
        write_file(path, content)
    return folder / PAGE


def _page(result: dict[str, Any], drawings: Sequence[Drawing], answers: Sequence[Answer]) -> str:
    drawn = {drawing.name: drawing for drawing in drawings}
    names = [counted(result["people"], "participant")] if "people" in result else []
    names += [counted(len(answers), "trial")] if answers else ["counts alone"]
    names += ["simulated participants"] if result.get("simulated") else []
    badges = "".join(f'<span class="badge">{escape(name)}</span>' for name in names)
    sections = [
        f'<p class="warning">{SIMULATED}</p>' if result.get("simulated") else "",
        section("Recognition, by the source study's rules", figures(drawn, "rates") + _source_table(result)),
        section("Whether interaction helps", figures(drawn, "effects") + _hierarchical(result)),
        section("Confusions", figures(drawn, "confusions") + _emotions(result)),
        section("Psychometric functions", figures(drawn, "psychometric") + _psychometric(result)),
        section("Timing and synchrony", figures(drawn, "timing") + times_table(result)),
        section("Ratings", ratings_table(result) + questionnaires_table(result)),
        section("Not counted", excluded_table(result)),
        section("Files", _files(bool(answers))),
    ]
    return render("High Five: experiment", escape(result["source"]), badges, sections)


def _source_table(result: dict[str, Any]) -> str:
    if result.get("table_refused"):
        return f'<p class="warning">{escape(result["table_refused"])}</p>'
    if not result.get("table"):
        return ""
    rows = [
        [
            name,
            *(f"{row[c]['mean']:.3f} ± {row[c]['se']:.3f}" for c in CONDITIONS),
            f"{row['p_interactive_higher']:.3f}",
        ]
        for name, row in result["table"].items()
        if isinstance(row, dict)
    ]
    rows.append(["overall P", "", "", f"{result['table']['overall']:.3f}"])
    shown = table(["participant", *CONDITIONS, "P(interactive higher)"], rows, {0})
    return f'{shown}<p class="warning">{escape(result["overall_warning"])}</p>'


def _hierarchical(result: dict[str, Any]) -> str:
    found = {"interactive − replay, logit": result["hierarchical"]} if result.get("hierarchical") else {}
    for condition, one in result.get("contrasts", {}).items():
        if one["effects"] is not None:
            found[f"interactive − {condition.replace('_', ' ')}, logit"] = one["effects"]
    lacking = f'<p class="warning">{escape(result["lacking"])}</p>' if "lacking" in result else ""
    return (_effects_table(found, signed=True) if found else "") + lacking


def _effects_table(found: dict[str, dict[str, Any]], *, signed: bool) -> str:
    rows, level = [], next(iter(found.values()))["level"]
    for name, one in found.items():
        low, high = one["interval"]
        row = [name, f"{one['mean']:.3f}", f"{one['sd']:.3f}", f"{low:.3f} … {high:.3f}", f"{one['between']:.3f}"]
        rows.append([*row, f"{one['p_positive']:.3f}"] if signed else row)
    heads = ["", "mean", "sd", f"{100.0 * level:g}% interval", "between people", *(["P(above 0)"] if signed else [])]
    return table(heads, rows, {0})


def _emotions(result: dict[str, Any]) -> str:
    rows, lines = [], []
    for condition, found in result.get("confusion", {}).items():
        for name, one in found["emotions"].items():
            low, high = one["interval"]
            unbiased = "–" if one["unbiased"] is None else f"{one['unbiased']:.3f}"
            counts = [f"{one['correct']} of {one['shown']}", str(one["answered"]), f"{one['mean']:.3f}"]
            rows.append([condition, name, *counts, f"{low:.3f} … {high:.3f}", unbiased, f"{one['answer_bias']:+.3f}"])
        bits = f"{found['mutual_information']:.3f} bits; blind answers would seem to say {found['chance_bits']:.3f}"
        lines.append(f"<p>Mutual information of shown and answered, {escape(condition)}: {bits}.</p>")
    if not rows:
        return ""
    interval = f"{100.0 * result['level']:g}% interval"
    heads = ["condition", "emotion", "correct", "answered", "estimate", interval, "unbiased hit rate", "answer bias"]
    return table(heads, rows, {0, 1}) + "".join(lines)


def _psychometric(result: dict[str, Any]) -> str:
    found = result.get("psychometric")
    if found is None:
        return ""
    rows, together = [], {}
    for condition, here in found["conditions"].items():
        for person, one in here["people"].items():
            cells = [
                f"{one[n]['value']:.3f} ({one[n]['interval'][0]:.3f} … {one[n]['interval'][1]:.3f})" for n in _SHOWN
            ]
            rows.append([condition, person, str(one["trials"]), *cells])
        for key, name in (("pooled_pse", "PSE"), ("pooled_log_jnd", "ln JND")):
            if key in here:
                together[f"{condition}, {name}"] = here[key]
    shown = table(["condition", "participant", "trials", "PSE", "JND", "lapses"], rows, {0, 1})
    shown += _effects_table(together, signed=False) if together else ""
    if "pse_shift" in found:
        shown += _effects_table({"shift of the PSE, interactive − replay": found["pse_shift"]}, signed=True)
    return shown


_SHOWN = ("pse", "jnd", "lapse")


def _files(trials: bool) -> str:
    tidy = f" <code>{TRIALS}</code>: one row a trial." if trials else ""
    return (
        f"<p><code>{DATA}</code>: all numbers. <code>{SUMMARY}</code>: the tables above, one row a figure. "
        f"<code>{FIGURES}/</code>: the figures as PNG, SVG and PDF.{tidy} What each figure means: docs/analysis.md.</p>"
    )

"""The report of an evaluation: ``report.json``, one self-contained ``report.html``, and its figures as PNG."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from highfive.hil.evaluation.cross_validation import Run
from highfive.hil.evaluation.score_table import method_label, methods_of, metric_named, rows_of
from highfive.hil.evaluation.style_mixtures import morphs
from highfive.hil.report import evaluation_figures, model_figures
from highfive.hil.report.drawing import Drawing, draw, to_png
from highfive.hil.report.page import figures, render, section, table
from highfive.hil.report.report import DATA, FIGURES, PAGE
from highfive.hil.runtime.console import counted, given_command
from highfive.hil.runtime.folders import write_file
from highfive.model.evaluation import forecast_errors as horizons
from highfive.model.hgpdm.trials import Trial

_HEADLINE = ("all_joints", "palm", "palm_at_contact", "contact_point", "unseen_over_seen")
_METRICS = (
    "Errors are distances of joints and palms by forward kinematics of the generated angles, before any correction, "
    "from the recorded ones. Calibration: shares near 50 % and 90 %, and a mean z² near 1, say that the predicted "
    "uncertainty is right. Smoothness: minus the arc length of the speed's spectrum (Balasubramanian et al. 2015), 0 "
    "is smoothest; as smooth as recorded is best. Latency: the shift at which generated and recorded palm speed "
    "correlate best; one step is from hand to pose with its uncertainty, on this machine. Bold: nearest "
    "to what is wished for."
)


def write_evaluation(folder: Path, result: dict[str, Any], run: Run | None, trials: Sequence[Trial]) -> Path:
    """Writes the report of an evaluation into ``folder``; returns the page.

    Args:
        folder: made if it is not there; an older report in it is replaced.
        result: from :func:`highfive.hil.commands.evaluate.evaluate`; ``report.json`` is the same.
        run: the first seed's; None for a windows file, which has scores alone.
        trials: all trials of the first fold.

    Raises:
        HighFiveError: a file cannot be written.
    """
    drawings = draw_evaluation(result, run, trials)
    files = {folder / FIGURES / f"{drawing.name}.png": to_png(drawing.figure) for drawing in drawings}
    files[folder / DATA] = json.dumps(result, indent=2, allow_nan=False, ensure_ascii=False).encode()
    files[folder / PAGE] = _page(result, drawings).encode()
    for path, content in files.items():  # all at once: interrupted before, the evaluation goes on from its trainings
        write_file(path, content)
    return folder / PAGE


def draw_evaluation(result: dict[str, Any], run: Run | None, trials: Sequence[Trial]) -> list[Drawing]:
    """All figures that can be drawn."""
    painters = [partial(evaluation_figures.errors, result), partial(evaluation_figures.over_trials, result)]
    if run is None:
        return draw(painters)
    model = run.fitted.model
    palm = horizons.palm_errors(model, run.fitted.task, trials)
    return draw(
        [
            *painters,
            partial(evaluation_figures.left_out, result),
            partial(evaluation_figures.calibration, run),
            partial(evaluation_figures.by_horizon, result, palm),
            partial(model_figures.trajectories, run),
            partial(model_figures.latent_spaces, model, trials),
            partial(model_figures.style_strips, morphs(model, run.trials)),
            partial(model_figures.learning_curve, model),
        ]
    )


def _page(result: dict[str, Any], drawings: Sequence[Drawing]) -> str:
    drawn = {drawing.name: drawing for drawing in drawings}
    source = result.get("windows") or result["data"]
    sections = [
        _headline(result),
        section("Scores", figures(drawn, "errors") + _scores(result)),
        section("Few trials", figures(drawn, "over_trials") + _advice(result)),
        section("Left out in turn", figures(drawn, "left_out") + _by_fold(result)),
        section("How sure it is", figures(drawn, "calibration")),
        section("Looking ahead", figures(drawn, "by_horizon")),
        section("False starts", _false_starts(result)),
        section("Movement", figures(drawn, "trajectories")),
        section("Style", figures(drawn, "style_strips")),
        section("Latent spaces", figures(drawn, "latent_spaces")),
        section("Training", figures(drawn, "learning_curve")),
        section("Do it again", _reproduce()),
    ]
    return render("High Five: evaluation", escape(f"{source}. {_setting(result)}"), _badges(result), sections)


def _false_starts(result: dict[str, Any]) -> str:
    """What came of simulated gestures that are no high five, if they were played."""
    found = result.get("false_starts")
    if not found:
        return ""
    head = ("gesture", "played", "reach began", "palm led", "palm raised", "decided after")
    rows = [
        (name, str(row["gestures"]), *(f"{100.0 * row[key]:.0f} %" for key in ("started", "led", "raised")),
         f"{row['decided_s_median']:.2f} s")
        for name, row in [*found["by_gesture"].items(), ("all", found)]
    ]  # fmt: skip
    said = (
        f"Simulated people who raise a hand for something else. Of {found['high_fives']} true high fives, "
        f"{100.0 * found['not_started']:.0f} % were not begun; the others {found['delay_ms_median']:.0f} ms later "
        f"(median) than without the doubt, {100.0 * found['late']:.0f} % by more than 50 ms."
    )
    return f"<p>{said}</p>{table(head, rows, words={0})}"


def _setting(result: dict[str, Any]) -> str:
    """What was trained on what, in a sentence."""
    seeds = "one seed" if result["seeds"] == 1 else f"{result['seeds']} seeds"
    what = f"Preset {result['preset']}, {result['inducing']} inducing inputs per layer and for the sparse GP, {seeds}"
    if result.get("model"):
        what = (
            f"hGPDM is {result['model']} as it stands, by what it learned before; the regressions learned "
            "from the training trials here alone. Of a "
            "held-out trial that it was trained on, it knows more than it should. "
            f"Sparse GP: {result['inducing']} inducing inputs, {seeds}"
        )
    if "windows" in result:
        return f"{what}; {result['points']} training windows."
    if result.get("leave_out"):
        held = f"each of {result['folds']} {result['leave_out']}s held out in turn"
        return f"{what}; {counted(result['trials'], 'trial')}, {held}."
    return f"{what}; {counted(result['trials'], 'training trial')}, {result['held_out_trials']} held out."


def _badges(result: dict[str, Any]) -> str:
    if "windows" in result:
        names = ["windows file", "no action given"]
    else:
        names = [
            f"leave one {result['leave_out']} out" if result.get("leave_out") else "held-out trials",
            "uncorrected",
        ]
    return "".join(f'<span class="badge">{escape(name)}</span>' for name in names)


def _headline(result: dict[str, Any]) -> str:
    scores, unit = result["scores"], result.get("unit", "")
    names = [n for n in _HEADLINE if n in scores["hgpdm"]] or list(scores["hgpdm"])[:4]
    cards = []
    for name in names:
        metric, own = metric_named(name, unit), scores["hgpdm"][name]
        other, best = min((values[name], method) for method, values in scores.items() if method != "hgpdm")
        word = "better" if own < other else "as good" if own == other else "worse"
        state = f'<span class="{"met" if own <= other else "unmet"}">{word}</span>'
        shown = f"{metric.show(own)} {metric.unit}".strip()
        against = (
            f"best regression, {method_label(best)}, {escape(f'{metric.show(other)} {metric.unit}'.strip())}: {state}"
        )
        if name == "unseen_over_seen":
            good = "met" if own <= 1.4 else "unmet"
            against = f'target at most 1.4: <span class="{good}">{"met" if own <= 1.4 else "not met"}</span>'
        cards.append(
            f'<div class="figure"><div class="what">hGPDM, {escape(metric.label)}</div>'
            f'<div class="value">{escape(shown)}</div><div class="target">{against}</div></div>'
        )
    return f'<div class="headline">{"".join(cards)}</div>'


def _scores(result: dict[str, Any]) -> str:
    heads = ["", *(method_label(method) for method in methods_of(result))]
    rows, found, group = [], rows_of(result), ""
    for row in found:
        if row.group != group and len({each.group for each in found}) > 1:
            group = row.group
            rows.append([f'<span class="soft">{escape(group)}</span>', *[""] * (len(heads) - 1)])
        shown = [escape(text).replace(" (", '<br><span class="soft">(') for text in row.cells]
        shown = [text + "</span>" if "<br>" in text else text for text in shown]
        cells = [f"<b>{text}</b>" if i in row.best else text for i, text in enumerate(shown)]
        rows.append([escape(row.label), *cells])
    spread = " In brackets the smallest and the largest of the seeds." if result["seeds"] > 1 else ""
    note = "" if "windows" in result else f'<p class="soft">{_METRICS}{spread}</p>'
    return table(heads, rows, words={0}, escaped=True) + note


def _advice(result: dict[str, Any]) -> str:
    lines = result.get("learning_curve", {}).get("advice", [])
    return "".join(f"<p>{escape(line)}.</p>" for line in lines)


def _by_fold(result: dict[str, Any]) -> str:
    if not result.get("by_fold"):
        return ""
    methods, metric = list(result["scores"]), metric_named("palm_at_contact", "")
    heads = [result["leave_out"], *(f"{method_label(m)}, cm" for m in methods)]
    rows = []
    for fold, values in result["by_fold"].items():
        cells = [metric.show(values[m]["palm_at_contact"]) for m in methods]
        seen = [values[m].get("palm_at_contact_seen") for m in methods]
        cells = [c if s is None else f"{c} (seen {metric.show(s)})" for c, s in zip(cells, seen, strict=True)]
        rows.append([fold, *cells])
    return table(heads, rows, words={0})


def _reproduce() -> str:
    return (
        f"<pre>{escape(given_command())}</pre>"
        f"<p>All values of this page are in <code>{DATA}</code>, in metres, "
        f"radians and seconds unless a name says otherwise; its pictures are in <code>{FIGURES}/</code>. What each "
        "metric is, and how it is scored: docs/evaluation.md.</p>"
    )

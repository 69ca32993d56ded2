"""Figures of an evaluation's scores: errors, calibration, what was left out, and errors by horizon."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from highfive.hil.evaluation.cross_validation import Run
from highfive.hil.evaluation.curves import SHOWN
from highfive.hil.evaluation.score_table import METHODS, metric_named
from highfive.hil.report.colours import method_look
from highfive.hil.report.drawing import FAINT, INK, Drawing, new_figure
from highfive.model.evaluation import forecast_errors as horizons
from highfive.model.evaluation import metrics
from highfive.model.evaluation import scores as evaluation
from highfive.model.geometry.rotations import Array

CM = 100.0
_SHOWN = ("all_joints", "joint_angle", "palm", "palm_at_contact_median", "contact_point", "time_to_contact")
_KINDS = {
    "pose": "joint channels", "palm": "palm", "contact_point": "contact point, last 0.3 s",
    "time_to_contact": "time to contact, last 0.3 s",
}  # fmt: skip
_NAMES = {
    **METHODS,
    "mean": "mean pose",
    "knn": "nearest neighbours",
    "constant_velocity": "constant velocity",
    "minimum_jerk": "least jerk",
    "gaussian_mixture": "Gaussian mixture",
}


def errors(result: dict[str, Any]) -> Drawing:
    """Errors of each method, a panel each: the median of the seeds, and their range."""
    scores = result["scores"]
    names = [name for name in _SHOWN if name in scores["hgpdm"]] or list(scores["hgpdm"])
    columns = 2 if len(names) == 4 else min(3, len(names))
    rows = -(-len(names) // columns)
    figure = new_figure(9.0, 0.55 + 1.85 * rows)
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for axes in grid.flat[len(names) :]:
        axes.set_axis_off()
    for axes, name in zip(grid.flat, names, strict=False):
        _error_panel(axes, result, name)
    spread = "; a line is the range over the seeds" if result["seeds"] > 1 else ""
    what = "held-out windows" if "windows" in result else "held-out trials"
    caption = (
        f"Errors on {what}, less is better; a mark is the median of {_seeds(result['seeds'])}{spread}. "
        "An arrow: further off."
    )
    return Drawing("errors", caption, figure)


def _label(method: str) -> str:
    """A method's name in a figure; a model of the user's own is called by its file and function."""
    return _NAMES.get(method, Path(method).name)


def _seeds(count: int) -> str:
    return "one seed" if count == 1 else f"{count} seeds"


def _error_panel(axes: Axes, result: dict[str, Any], name: str) -> None:
    metric, methods = metric_named(name, result.get("unit", "")), list(result["scores"])
    ends = {m: [metric.factor * result[part][m][name] for part in ("scores", "smallest", "largest")] for m in methods}
    # The mean pose is far off: to its scale the others would look alike.
    edge = 1.35 * max(largest for method, (_, _, largest) in ends.items() if method != "mean")
    for place, (method, (value, low, high)) in enumerate(ends.items()):
        colour, mark = method_look(method)
        shown, inside = metric.show(result["scores"][method][name]), value <= edge
        axes.plot([0.0, min(value, edge)], [place, place], color=colour, lw=0.8, alpha=0.5)
        if inside:
            axes.plot([low, high], [place, place], color=colour, lw=4.0, alpha=0.45, solid_capstyle="butt")
        axes.plot(min(value, edge), place, mark if inside else ">", color=colour, ms=6, clip_on=False)
        axes.annotate(
            shown, (high if inside else edge, place), (7 if inside else -7, 0), textcoords="offset points", fontsize=9,
            va="center" if inside else "bottom", ha="left" if inside else "right",
        )  # fmt: skip
    axes.set_yticks(range(len(methods)), [_label(method) for method in methods])
    axes.set_ylim(len(methods) - 0.5, -0.5)
    axes.set_xlim(0.0, edge)
    axes.tick_params(axis="y", length=0)
    axes.set_title(metric.heading, fontsize=10, fontweight="normal")


def calibration(run: Run) -> Drawing | None:
    """Share of held-out values inside predicted regions, against the probability of the region."""
    found = {name: evaluation.surprises(answers, run.held) for name, answers in run.answers.items()}
    found = {name: squares for name, squares in found.items() if squares}
    if not found:
        return None
    figure = new_figure(9.0, 3.1)
    panels = figure.subplots(1, len(_KINDS), sharex=True, sharey=True)
    probability = np.linspace(0.0, 1.0, 51)
    for axes, (kind, title) in zip(panels, _KINDS.items(), strict=True):
        axes.plot([0, 100], [0, 100], color=FAINT, lw=0.8, ls=(0, (4, 3)))
        for method, squares in found.items():
            if len(squares[kind]):
                at = np.sort(metrics.levels(squares[kind], evaluation.CALIBRATED[kind]))
                share = np.searchsorted(at, probability, side="right") / len(at)
                colour, mark = method_look(method)
                axes.plot(
                    100.0 * probability, 100.0 * share, color=colour, marker=mark, ms=5, markevery=[25, 45], lw=1.6,
                    label=_label(method),
                )  # fmt: skip
        axes.set_title(title, fontsize=10, fontweight="normal")
        axes.set_aspect("equal")
        axes.set_xticks([0, 50, 90])
        axes.set_yticks([0, 50, 90])
        axes.grid(color=FAINT, alpha=0.25, lw=0.6)
    panels[0].set_ylabel("held-out values inside, %")
    figure.supxlabel("probability of the predicted region, %", fontsize=10)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(found), fontsize=9)
    caption = (
        "Calibration: how many held-out values lie in the central region to which the prediction gives a probability. "
        "On the dashed line the predicted uncertainty is right; below it is too small, above too large. Marks at 50 "
        "and 90 %. Joint channels and time are intervals, palm and contact point are ellipsoids."
    )
    return Drawing("calibration", caption, figure)


def left_out(result: dict[str, Any]) -> Drawing | None:
    """Error at contact of what was left out, a column each, beside the same trials when their cell was seen."""
    table = result.get("by_fold")
    if not table:
        return None
    what, folds = result["leave_out"], list(table)
    figure = new_figure(9.0, 3.2)
    axes = figure.subplots()
    shown = ["hgpdm", "sparse_gp"]
    highest = 0.0
    for number, method in enumerate(shown):
        colour, mark = method_look(method)
        x = np.arange(len(folds)) + (number - 0.5) * 0.3
        values = np.array([CM * table[fold][method]["palm_at_contact"] for fold in folds])
        seen = np.array([CM * table[fold][method].get("palm_at_contact_seen", np.nan) for fold in folds])
        highest = max(highest, *values, *seen[np.isfinite(seen)])
        axes.plot(np.stack([x, x]), np.stack([seen, values]), color=colour, lw=1.0, alpha=0.6)
        if np.isfinite(seen).any():
            axes.plot(x, seen, mark, mfc="none", mec=colour, ms=6, label=f"{_label(method)}, {what} seen in training")
        axes.plot(x, values, mark, color=colour, ms=7, label=f"{_label(method)}, {what} left out")
    axes.set_xticks(range(len(folds)), folds)
    axes.set_xlabel(what)
    axes.set_ylim(0.0, 1.1 * highest)
    axes.set_ylabel("palm at contact, cm")
    figure.legend(loc="outside upper center", ncols=2, fontsize=9)
    seen_too = " Open: the same trials by trainings that saw other repetitions of their cell." if what == "cell" else ""
    caption = (
        f"Distance of generated and recorded palm at contact, before any correction, mean over the trials of each "
        f"{what} while no trial of that {what} was learned from.{seen_too} First seed."
    )
    return Drawing("left_out", caption, figure)


def by_horizon(result: dict[str, Any], palm: horizons.Errors) -> Drawing:
    """Errors against the time that is looked ahead: of the contact point in the result, and of the avatar's palm."""
    ahead = result["looking_ahead"]
    contact = {name: np.array(row, dtype=float) for name, row in ahead["contact_point"].items()}  # None is NaN
    figure = new_figure(9.0, 3.5)
    left, right = figure.subplots(1, 2)
    _lines(left, 1e3 * np.array(ahead["before_s"]), contact)
    left.axhline(3.0, color=FAINT, lw=0.8, ls=(0, (1, 2)))
    left.axvline(200.0, color=FAINT, lw=0.8, ls=(0, (1, 2)))
    left.set_xlabel("time before contact, ms")
    left.set_ylabel("contact point, median error, cm")
    left.set_title("where the palms will meet", fontsize=10, fontweight="normal")
    left.invert_xaxis()
    _lines(right, 1e3 * horizons.AHEAD, palm)
    right.set_xticks(1e3 * horizons.AHEAD)
    right.set_xlabel("time ahead of the last hand seen, ms")
    right.set_ylabel("palm, median error, cm")
    right.set_title("where the avatar's palm will be, in the reach", fontsize=10, fontweight="normal")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=(len(labels) + 1) // 2, fontsize=9)
    caption = (
        "Left: error of the contact point that each method names so long before contact. Constant velocity is the "
        "person's palm going straight on, given the time of contact; least jerk a reach that ends where its jerk is "
        "least; Gaussian mixture a regression on hands, places and times together; dotted: 3 cm, and 200 ms. Right: "
        "forecasts of the avatar's palm made every 0.1 s of the last 0.6 s before contact; constant velocity is the "
        "generated palm going straight on, ridge a regression for each horizon. Axes are cut where a method leaves the "
        "picture."
    )
    return Drawing("by_horizon", caption, figure)


def _lines(axes: Axes, x: Array, found: horizons.Errors) -> None:
    shown = {name: values for name, values in found.items() if name != "mean" and np.isfinite(values).any()}
    for name, values in shown.items():
        colour, mark = method_look(name)
        axes.plot(
            x, CM * values, color=colour, marker=mark, ms=5, lw=1.8 if name == "hgpdm" else 1.1, label=_label(name)
        )
    trusted = [np.nanmax(values) for name, values in shown.items() if name not in ("constant_velocity", "minimum_jerk")]
    axes.set_ylim(0.0, 130.0 * max(trusted))
    axes.spines["left"].set_color(INK)


def over_trials(result: dict[str, Any]) -> Drawing | None:
    """Errors over the number of trials a style, a panel each, with the range of the draws."""
    curve = result.get("learning_curve")
    if curve is None:
        return None
    own, counts = curve["methods"]["hgpdm"], curve["trials_per_style"]
    names = [name for name in SHOWN if name in own] or list(own)
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = new_figure(9.0, 0.8 + 2.3 * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[len(names) :]:
        axes.set_axis_off()
    for axes, name in zip(grid.flat, names, strict=False):
        metric = metric_named(name, result.get("unit", ""))
        for method, values in curve["methods"].items():
            if name not in values or method == "mean":  # far off: to its scale the others would look alike
                continue
            colour, mark = method_look(method)
            middle, low, high = (metric.factor * np.array(values[name][e]) for e in ("median", "smallest", "largest"))
            axes.fill_between(counts, low, high, color=colour, alpha=0.2, lw=0.0)
            axes.plot(counts, middle, color=colour, marker=mark, ms=4, lw=1.4, label=_label(method))
        axes.set_xscale("log")
        axes.set_xticks(counts, [str(count) for count in counts])
        axes.minorticks_off()
        axes.set_ylim(bottom=0.0)
        axes.set_title(metric.heading, fontsize=9)
    grid[0, 0].legend(fontsize=8, frameon=False)
    grid[-1, 0].set_xlabel("trials a style")
    caption = (
        f"Errors over the number of trials a style that were learned from: median and range of {curve['draws']} draws."
    )
    return Drawing("over_trials", caption, figure)

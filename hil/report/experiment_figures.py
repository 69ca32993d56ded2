"""Figures of an experiment: rates a person, effects over people, confusion matrices, psychometric functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from highfive.hil.experiments.analysis.answers import Answer, confusions_of, fits_of
from highfive.hil.experiments.analysis.counts import CONDITIONS, PersonCounts
from highfive.hil.experiments.analysis.hierarchical import logit_differences
from highfive.hil.experiments.analysis.psychometric import JND_OF_WIDTH, p_second
from highfive.hil.report.drawing import FAINT, INK, Drawing, new_figure

_LOOKS = {
    "interactive": ("#0072B2", "o"),
    "replay": ("#D55E00", "s"),
    "other_replay": ("#009E73", "^"),
    "no_contingency": ("#CC79A7", "D"),
}
"""Colour and mark of a condition: of Okabe & Ito's palette."""


def rates(result: dict[str, Any]) -> Drawing | None:
    """Each person's classification rate in both conditions, with its standard error."""
    people = {name: row for name, row in (result.get("table") or {}).items() if isinstance(row, dict)}
    if not people:
        return None
    figure = new_figure(max(4.5, min(9.0, 1.6 + 0.55 * len(people))), 3.0)
    axes = figure.subplots()
    for shift, condition in zip((-0.12, 0.12), CONDITIONS, strict=True):
        colour, mark = _LOOKS[condition]
        means, errors = np.array([[row[condition]["mean"], row[condition]["se"]] for row in people.values()]).T
        axes.errorbar(np.arange(len(people)) + shift, means, errors, color=colour, fmt=mark, ms=5, label=condition)
    chance = 1.0 / result["emotions"]
    axes.axhline(chance, color=FAINT, lw=0.8, ls=(0, (4, 3)))
    at = axes.get_yaxis_transform()
    axes.text(0.99, chance + 0.015, "chance", ha="right", va="bottom", fontsize=9, color=FAINT, transform=at)
    axes.set_xticks(range(len(people)), [_text(name) for name in people], rotation=0 if len(people) < 13 else 90)
    axes.set_ylim(0.0, 1.0)
    axes.set_ylabel("classification rate")
    figure.legend(loc="outside upper center", ncols=2, fontsize=9)
    caption = (
        "Emotion classification rate of each person, mean and standard error of the source study's posterior: a "
        f"pseudo-count in each cell of the {result['emotions']} × {result['emotions']} confusion matrix."
    )
    return Drawing("rates", caption, figure)


def effects(result: dict[str, Any], people: Sequence[PersonCounts]) -> Drawing | None:
    """Each person's logit difference, and the mean over people; None of one person."""
    if len(people) < 2:
        return None
    d, v = logit_differences(people)
    half, places = 1.96 * np.sqrt(v), np.arange(len(people), 0, -1)
    found = result["hierarchical"]
    figure = new_figure(6.0, 1.1 + 0.28 * (len(people) + 1))
    axes = figure.subplots()
    axes.axvline(0.0, color=FAINT, lw=0.8)
    axes.errorbar(d, places, xerr=half, fmt="o", color=INK, ms=4, lw=1.0)
    axes.plot(found["interval"], [0, 0], color=_LOOKS["interactive"][0], lw=5.0, alpha=0.5, solid_capstyle="butt")
    axes.plot(found["mean"], 0, "D", color=_LOOKS["interactive"][0], ms=7)
    axes.set_yticks([*places.tolist(), 0], [*(_text(person.participant) for person in people), "all"])
    axes.set_ylim(-0.6, len(people) + 0.6)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("interactive − replay, logit")
    caption = (
        "Effect of interaction. People: empirical logit difference ± 1.96 standard errors. All: posterior mean and "
        f"{100.0 * found['level']:g}% interval of the mean over people; P that it is above 0 is "
        f"{found['p_positive']:.3f}."
    )
    return Drawing("effects", caption, figure)


def confusions(answers: Sequence[Answer]) -> Drawing | None:
    """What was answered to what was shown, a matrix a condition."""
    matrices = confusions_of(answers)
    if not matrices:
        return None
    size = 1.1 + 0.62 * max(len(matrix.emotions) for matrix in matrices.values())
    figure = new_figure(min(9.0, (size + 0.6) * len(matrices)), size)
    panels = figure.subplots(1, len(matrices), squeeze=False)[0]
    for axes, (condition, matrix) in zip(panels, matrices.items(), strict=True):
        shown = matrix.counts.sum(axis=1, keepdims=True)
        share = matrix.counts / np.maximum(shown, 1)
        axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
        for row, column in np.ndindex(share.shape):
            text = f"{share[row, column]:.2f}\n{matrix.counts[row, column]}"
            # On the picture's own colours: black or white, whatever the page's ink.
            ink = "white" if share[row, column] > 0.55 else "black"
            axes.annotate(text, (column, row), ha="center", va="center", fontsize=8, color=ink)
        names = [_text(emotion) for emotion in matrix.emotions]
        axes.set_xticks(range(len(names)), names)
        axes.set_yticks(range(len(names)), names)
        axes.tick_params(length=0)
        axes.set_xlabel("answered")
        axes.set_ylabel("shown")
        axes.set_title(condition.replace("_", " "), fontsize=10, fontweight="normal")
    caption = "Share, and number, of each answer to each emotion shown; all people together."
    return Drawing("confusions", caption, figure)


def psychometric(answers: Sequence[Answer], level: float) -> Drawing | None:
    """Each person's functions, with the shares that they are fitted to, and intervals of so much."""
    fits = fits_of(answers, level)
    people = list(dict.fromkeys(person for found in fits.values() for person in found))
    if not people:
        return None
    columns = min(4, len(people))
    rows = -(-len(people) // columns)
    figure = new_figure(max(3.5, 2.25 * columns), 0.7 + 1.9 * rows)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes in grid.flat[len(people) :]:
        axes.set_axis_off()
    for axes, person in zip(grid.flat, people, strict=False):
        axes.set_title(_text(person), fontsize=10, fontweight="normal")
        axes.axhline(0.5, color=FAINT, lw=0.6)
        for condition, found in fits.items():
            if person not in found:
                continue
            colour, mark = _LOOKS[condition]
            weights, shares, sizes = _shares(answers, person, condition)
            axes.scatter(weights, shares, s=4.0 + 3.0 * sizes, color=colour, marker=mark, alpha=0.6, lw=0)
            one, at = found[person], np.linspace(0.0, 1.0, 101)
            curve = p_second(at, one.pse.value, one.jnd.value / JND_OF_WIDTH, one.lapse.value)
            axes.plot(at, curve, color=colour, label=condition.replace("_", " "))
            axes.plot(one.pse.interval, [0.5, 0.5], color=colour, lw=4.0, alpha=0.5, solid_capstyle="butt")
        axes.set_ylim(-0.05, 1.05)
    second = _text(next(one.emotion for one in answers if one.weight is not None))
    figure.supxlabel(f"share of {second}", fontsize=10)
    figure.supylabel(f"{second} answered", fontsize=10)
    _legend(figure, len(fits))
    caption = (
        "Psychometric functions: posterior means of PSE, JND and lapses. Marks: shares at the weights shown, larger "
        f"for more answers. Bars at one half: {100.0 * level:g}% intervals of the PSE."
    )
    return Drawing("psychometric", caption, figure)


def timing(result: dict[str, Any]) -> Drawing | None:
    """Median and quartiles of how palms met, a mark a condition in which somebody acted."""
    found = {name: one for name, one in (result.get("timing") or {}).items() if "asynchrony_s" in one}
    if not found:
        return None
    panels = [panel for panel in _PANELS if any(panel[0] in one for one in found.values())]
    figure = new_figure(1.0 + 2.0 * len(panels), 1.3 + 0.35 * len(found))
    places = np.arange(len(found), 0, -1)
    for axes, (name, label, scale) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for place, one in zip(places, found.values(), strict=True):
            if name in one:
                low, middle, high = (scale * one[name][key] for key in ("q1", "median", "q3"))
                axes.plot([low, high], [place, place], color=INK, lw=1.0)
                axes.plot(middle, place, "o", color=INK, ms=5)
        if name == "share_below":
            axes.axvline(50.0, color=FAINT, lw=0.8, ls=(0, (4, 3)))
            axes.set_xlim(-4.0, 104.0)
        axes.set_ylim(0.5, len(found) + 0.5)
        axes.set_yticks(places, [_text(one.replace("_", " ")) for one in found] if axes.get_subplotspec().is_first_col()
                        else [""] * len(found))  # fmt: skip
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel(label)
    caption = (
        "How palms met: median and quartiles over trials. Asynchrony below 0: the person was at the place first. "
        "Pseudo-pairs: hers with the avatar's of other trials of the same condition, style and cell; 50% is chance."
    )
    return Drawing("timing", caption, figure)


_PANELS = (
    ("person_onset_s", "person's onset, s", 1.0),
    ("asynchrony_s", "asynchrony, ms", 1e3),
    ("closing_speed", "closing speed, m/s", 1.0),
    ("share_below", "pseudo-pairs below, %", 100.0),
)
"""Figure, what its axis is called, and by what it is multiplied."""


def _shares(answers: Sequence[Answer], person: str, condition: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    own = [
        (one.weight, one.agrees)
        for one in answers
        if one.participant == person and one.condition == condition and one.weight is not None
    ]
    shown, said = np.array([weight for weight, _ in own]), np.array([second for _, second in own], dtype=float)
    weights, place = np.unique(shown, return_inverse=True)
    sizes = np.bincount(place)
    return weights, np.bincount(place, weights=said) / sizes, sizes


def _legend(figure: Figure, conditions: int) -> None:
    found: dict[str, Any] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    figure.legend(list(found.values()), list(found), loc="outside upper center", ncols=conditions, fontsize=9)


def _text(name: str) -> str:
    """A name as it is: a dollar sign in it begins no formula."""
    return name.replace("$", r"\$")

"""Learning curves: a protocol run again and again on parts of the trials, and what more trials would bring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from highfive.hil.evaluation.score_table import METRICS, Scored, method_label, metric_named
from highfive.model.evaluation.learning_curve import fit_power_law, gains

SHOWN = (
    "joint_angle", "all_joints", "palm", "palm_at_contact", "palm_at_contact_median", "contact_point", "time_to_contact"
)  # fmt: skip
"""Metrics of a data folder that have a curve in tables and figures; a windows file has its actions."""
ADVISED = "palm"
"""The metric that the advice is about."""


def learning_curve(counts: Sequence[int], runs: Sequence[Sequence[Scored]], unit: str = "") -> dict[str, Any]:
    """Scores over the number of trials.

    Args:
        counts: (n,) trials a style, rising.
        runs: of each count, the scores of each draw.
        unit: of a windows file's actions.

    Returns:
        ``trials_per_style`` (n,), ``draws``; ``methods``: method → metric → ``median``, ``smallest``, ``largest`` (n,)
        over the draws and ``law``, the power law of the medians (``floor``, ``gain``, ``exponent``); ``more``: method →
        metric → further trials → fall of the error, median, smallest and largest; ``advice``: lines. SI units.
    """
    methods: dict[str, dict[str, Any]] = {}
    more: dict[str, dict[str, Any]] = {}
    further = further_trials(counts)
    for method in runs[0][0]:
        methods[method], more[method] = {}, {}
        for metric in runs[0][0][method]:
            if metric in METRICS and METRICS[metric].group != "error":
                continue
            values = np.array([[scores[method].get(metric, np.nan) for scores in draws] for draws in runs]).T
            if not np.all(np.isfinite(values)):
                continue
            middle = np.median(values, axis=0)
            law = fit_power_law(counts, middle.tolist())
            methods[method][metric] = {
                "median": middle.tolist(),
                "smallest": values.min(axis=0).tolist(),
                "largest": values.max(axis=0).tolist(),
                "law": {"floor": law.floor, "gain": law.gain, "exponent": law.exponent},
            }
            if len(counts) > 2:
                found = gains(counts, values, further)
                more[method][metric] = {str(n): list(fall) for n, fall in zip(further, found, strict=True)}
    result: dict[str, Any] = {"trials_per_style": list(counts), "draws": len(runs[0]), "methods": methods}
    result |= {"more": more}
    return result | {"advice": _advice(result, unit)}


def further_trials(counts: Sequence[int]) -> tuple[int, int]:
    """Numbers of further trials a style that the advice is about: half as many again, and as many again."""
    return max(1, counts[-1] // 2), counts[-1]


def _advice(curve: dict[str, Any], unit: str) -> list[str]:
    """In words, of the model and the adapted one: what more trials a style would bring."""
    lines: list[str] = []
    most = curve["trials_per_style"][-1]
    for method in ("hgpdm", "adapted"):
        for name, falls in curve["more"].get(method, {}).items():
            if name != ADVISED and name in METRICS:
                continue
            metric, now = metric_named(name, unit), curve["methods"][method][name]["median"][-1]
            parts = [
                f"{n} more: {metric.show(middle)} less ({metric.show(low)} to {metric.show(high)})"
                for n, (middle, low, high) in falls.items()
            ]
            lines.append(
                f"{method_label(method)}, {metric.heading}: {metric.show(now)} with {most} trials a style; "
                f"{', '.join(parts)}"
            )
    return lines

"""Scores as rows that people read: what it is, in which unit, who is best."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

Scored = dict[str, dict[str, float]]
"""Method → action or metric → value."""

METHODS = {
    "hgpdm": "hGPDM", "adapted": "adapted", "sparse_gp": "sparse GP", "knn": "kNN", "ridge": "ridge", "mean": "mean",
    "recorded": "recorded",
}  # fmt: skip
NOTHING = "–"
_SEEN = "the same trials, their cell seen in training"


@dataclass(frozen=True)
class Metric:
    """How a metric is shown.

    Attributes:
        group: heading.
        label: what it is.
        unit: unit shown, '' for none.
        factor: from the SI value to that unit.
        digits: after the point.
        best: the value that all would like to have; None where there is none, as smooth as recorded is best.
    """

    group: str
    label: str
    unit: str = ""
    factor: float = 1.0
    digits: int = 1
    best: float | None = 0.0

    @property
    def heading(self) -> str:
        """What it is and its unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label

    def show(self, value: float) -> str:
        """The value in the metric's unit."""
        text = f"{self.factor * value:.{self.digits}f}"
        return (text.lstrip("-") if float(text) == 0.0 else text).replace("-", "−")


def _calibration(kind: str, label: str) -> dict[str, Metric]:
    group = "calibration"
    return {
        f"{kind}_within_50": Metric(group, f"{label}: % inside 50 %", "", 100.0, 0, 0.5),
        f"{kind}_within_90": Metric(group, f"{label}: % inside 90 %", "", 100.0, 0, 0.9),
        f"{kind}_z2": Metric(group, f"{label}: mean z²", "", 1.0, 2, 1.0),
    }


METRICS = {
    "all_joints": Metric("error", "all joints", "cm", 100.0, 2),
    "joint_angle": Metric("error", "joint angle", "°", math.degrees(1.0), 2),
    "palm": Metric("error", "palm, all frames", "cm", 100.0, 2),
    "palm_at_contact": Metric("error", "palm at contact, mean", "cm", 100.0, 2),
    "palm_at_contact_median": Metric("error", "palm at contact, median", "cm", 100.0, 2),
    "contact_point": Metric("error", "contact point, last 0.3 s", "cm", 100.0, 2),
    "time_to_contact": Metric("error", "time to contact, last 0.3 s", "ms", 1e3, 0),
    "palm_at_contact_seen": Metric(_SEEN, "palm at contact, mean", "cm", 100.0, 2),
    "palm_at_contact_median_seen": Metric(_SEEN, "palm at contact, median", "cm", 100.0, 2),
    "unseen_over_seen": Metric(_SEEN, "unseen / seen, means", "", 1.0, 2, None),
    "unseen_over_seen_median": Metric(_SEEN, "unseen / seen, medians", "", 1.0, 2, None),
    **_calibration("pose", "joint channels"),
    **_calibration("palm", "palm, direct"),
    **_calibration("contact_point", "contact point"),
    **_calibration("time_to_contact", "time to contact"),
    "spectral_arc_length": Metric("smoothness", "spectral arc length", "", 1.0, 2, None),
    "rms_jerk": Metric("smoothness", "RMS jerk of the palm", "m/s³", 1.0, 0, None),
    "lag_ms": Metric("latency", "behind the recorded palm", "ms", 1.0, 0),
    "step_ms_p50": Metric("latency", "one step, median", "ms", 1.0, 3),
    "step_ms_p99": Metric("latency", "one step, 99th percentile", "ms", 1.0, 3),
}
"""All metrics of a data folder, in order."""


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes:
        group: heading that it stands under.
        label: what it is, with its unit.
        cells: text of each method's value, with its range over the seeds where there are several.
        best: indices of the methods nearest to what is wished for.
    """

    group: str
    label: str
    cells: tuple[str, ...]
    best: tuple[int, ...]


def metric_named(name: str, unit: str) -> Metric:
    """How a metric is shown; an action of a windows file in ``unit``."""
    if name in METRICS:
        return METRICS[name]
    action = name.replace("_", " ")
    return Metric("error", action, "cm", 100.0, 2) if unit == "m" else Metric("error", action, unit, 1.0, 4)


def method_label(method: str) -> str:
    """How a method is called in tables; a model of somebody else's by its own name."""
    return METHODS.get(method, method)


def methods_of(result: dict[str, Any]) -> list[str]:
    """The columns: all methods, then what was recorded, if there is something of it."""
    return [*result["scores"], *(["recorded"] if result.get("recorded") else [])]


def rows_of(result: dict[str, Any], ranges: bool = True) -> list[Row]:
    """The rows of an evaluation's result, see :func:`highfive.hil.commands.evaluate.evaluate`; with the ranges over
    its seeds or not.
    """
    names = dict.fromkeys(name for values in result["scores"].values() for name in values)
    order = {name: place for place, name in enumerate(METRICS)}
    return [
        _row(name, metric_named(name, result.get("unit", "")), result, ranges)
        for name in sorted(names, key=lambda n: order.get(n, 0))
    ]


def _row(name: str, metric: Metric, result: dict[str, Any], ranges: bool) -> Row:
    methods = methods_of(result)
    values = [_value(result, method, name) for method in methods]
    cells = tuple(
        NOTHING if value is None else metric.show(value) + (_spread(result, method, name, metric) if ranges else "")
        for method, value in zip(methods, values, strict=True)
    )
    return Row(metric.group, metric.heading, cells, _best(values, metric))


def _value(result: dict[str, Any], method: str, name: str) -> float | None:
    return (result["recorded"] if method == "recorded" else result["scores"][method]).get(name)


def _spread(result: dict[str, Any], method: str, name: str, metric: Metric) -> str:
    """The range over the seeds, where it shows at the digits shown."""
    if method == "recorded":
        return ""
    low, high = (metric.show(result[end][method][name]) for end in ("smallest", "largest"))
    dash = " to " if "−" in low + high else "–"
    return "" if low == high else f" ({low}{dash}{high})"


def _best(values: Sequence[float | None], metric: Metric) -> tuple[int, ...]:
    if metric.best is None:
        return ()
    shown = [
        None if v is None else abs(float(f"{metric.factor * (v - metric.best):.{metric.digits}f}")) for v in values
    ]
    known = [value for value in shown if value is not None]
    if len(known) < 2:
        return ()
    return tuple(place for place, value in enumerate(shown) if value == min(known))

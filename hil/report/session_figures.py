"""The figures of a session's report; a line here adds one (docs/extending.md)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from highfive.hil.report.drawing import Drawing, draw
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.plugins import load_object

FIGURES = (
    "highfive.hil.report.figures:contact_error",
    "highfive.hil.report.figures:error_by_cell",
    "highfive.hil.report.figures:palm_distance",
    "highfive.hil.report.figures:palm_paths",
    "highfive.hil.report.figures:joint_angles",
    "highfive.hil.report.figures:latency",
)
"""Painters in the order of the page: each takes the trials, and gives a drawing of its own name, or None."""


def figure_names() -> list[str]:
    """Names of all figures that a report may have; the servo arm's come beside them."""
    return [painter.rpartition(":")[2] for painter in FIGURES]


def draw_all(results: Sequence[TrialResult]) -> list[Drawing]:
    """All figures that can be drawn of these trials."""
    if not results:
        return []
    return draw(partial(load_object(painter, "the figure"), results) for painter in FIGURES)

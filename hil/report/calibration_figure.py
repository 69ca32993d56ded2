"""The picture of one calibration: where the arm stands in the room, and what is left of each posture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from highfive.hil.report.drawing import FAINT, INK, Drawing, draw, new_figure, to_png
from highfive.hil.runtime.folders import write_file
from highfive.model.geometry.rotations import Array

MM = 1e3
_COLOURS = ("#b5533c", "#4d8b57", "#3d6ea6")
"""Of x, y and z."""


@dataclass(frozen=True)
class CalibrationShown:
    """What is drawn.

    Attributes:
        title: of the whole.
        frames: places (3,), m, and axes (3, 3), in columns, by name, in the world.
        plates: (N, 3) m, the plate's middle in each posture; none where the arm is not known.
        held_out, residuals: (N,) m, of each posture; NaN where there is none.
        worst: m, most that 95 of 100 may be off.
    """

    title: str
    frames: Mapping[str, tuple[Array, Array]]
    plates: Array
    held_out: Array
    residuals: Array
    worst: float


def draw_calibration(path: Path, shown: CalibrationShown, *, replace: bool = True) -> None:
    """Draws the room from above and from the side, and a bar for each posture, as PNG.

    Raises:
        HighFiveError: it cannot be written, or is there and may not be replaced.
    """
    (drawing,) = draw([lambda: Drawing("calibration", "", _figure(shown))])
    drawing.figure.set_facecolor("white")
    write_file(path, to_png(drawing.figure), replace=replace)


def _figure(shown: CalibrationShown) -> Figure:
    figure = new_figure(9.0, 7.0)
    above, side, bars = figure.subplot_mosaic([["above", "side"], ["bars", "bars"]], height_ratios=(1.5, 1.0)).values()
    for axes, pick, title in ((above, [0, 1], "from above"), (side, [0, 2], "from the side")):
        _room(axes, shown, pick, title)
        if len(shown.plates):
            off = MM * np.where(np.isfinite(shown.held_out), shown.held_out, shown.residuals)
            dots = axes.scatter(*shown.plates[:, pick].T, c=off, cmap="viridis_r", vmin=0.0, s=22, zorder=3)
            if axes is side:
                figure.colorbar(dots, ax=axes, label="plate, held out, mm", shrink=0.8)
    _bars(bars, shown)
    return figure


def _room(axes: Axes, shown: CalibrationShown, pick: list[int], title: str) -> None:
    for name, (at, turn) in shown.frames.items():
        for n, colour in enumerate(_COLOURS):
            ends = np.array([at, at + 0.2 * turn[:, n]])[:, pick]
            axes.plot(*ends.T, color=colour, lw=2.0)
        axes.annotate(
            name, (at[pick[0]], at[pick[1]]), xytext=(4, -11), textcoords="offset points", color=INK, fontsize=8,
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8}, zorder=5,
        )  # fmt: skip
    if pick[1] == 2:
        axes.axhline(0.0, color=FAINT, lw=1.5, zorder=0)
        axes.annotate(
            "floor", (1.0, 0.0), xycoords=axes.get_yaxis_transform(), xytext=(-3, 3), textcoords="offset points",
            ha="right", color=FAINT, fontsize=8,
        )  # fmt: skip
    else:
        axes.legend(
            [Line2D([], [], color=colour, lw=2.0) for colour in _COLOURS], ["x", "y", "z, of each frame"], fontsize=8,
            loc="best", ncols=3, handlelength=1.2,
        )  # fmt: skip
    axes.set_aspect("equal", "datalim")
    axes.set_xlabel(f"{'xyz'[pick[0]]}, m")
    axes.set_ylabel(f"{'xyz'[pick[1]]}, m")
    axes.set_title(title)


def _bars(axes: Axes, shown: CalibrationShown) -> None:
    numbers = np.arange(1, len(shown.held_out) + 1)
    axes.bar(numbers, MM * shown.held_out, color="#3d7ea6", width=0.7, label="plate, held out")
    axes.plot(numbers, MM * shown.residuals, "o", color="#e58a5b", ms=4, label="markers, root mean square")
    axes.axhline(MM * shown.worst, color=FAINT, lw=0.8, ls=":")
    axes.set_xlabel("posture")
    axes.set_ylabel("mm")
    axes.set_title(shown.title if len(numbers) else f"{shown.title}: no postures were kept in it")
    axes.legend(loc="upper right", ncols=2)

"""The map of what an arm could do in each cell and emotion, and what it did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Rectangle

from highfive.hil.report.drawing import FAINT, INK, STYLE, new_figure, to_png
from highfive.hil.runtime.folders import write_file
from highfive.hil.sim.people.grid import CELLS, GRID_Y, GRID_Z

WORST_MM = 30.0
"""From here on the colour stays the same."""


def draw_contact_map(path: Path, rows: Sequence[Mapping[str, Any]], *, replace: bool = True) -> None:
    """Draws a grid of cells for each emotion, a line of grids for each player that is an arm.

    Args:
        path: of the picture.
        rows: of :func:`highfive.hil.bench.contact.bench_contact`.
        replace: whether a picture that is there may be replaced.

    Raises:
        HighFiveError: the file cannot be written.
    """
    arms = [row for row in rows if row["given_s"] is not None]
    players, emotions = (list(dict.fromkeys(row[key] for row in arms)) for key in ("player", "emotion"))
    with mpl.rc_context(STYLE | {"figure.facecolor": "white"}):
        figure = new_figure(3.2 * len(emotions) + 1.0, 3.6 * len(players) + 0.5)
        grids = figure.subplots(len(players), len(emotions), squeeze=False)
        colours = ScalarMappable(Normalize(0.0, WORST_MM), "YlOrBr")
        for line, player in zip(grids, players, strict=True):
            for axes, emotion in zip(line, emotions, strict=True):
                _grid(axes, [r for r in arms if (r["player"], r["emotion"]) == (player, emotion)], colours)
                axes.set_title(f"{player}, {emotion}" if len(players) > 1 else emotion)
        figure.colorbar(colours, ax=grids, label="plate to palm at contact, mm", extend="max", pad=0.01)
        figure.supxlabel(
            "y, m (from behind the arm)\nNeeds: quickest reach. Has: since the arm knew of a contact. Known: so long "
            "before contact the place was forecast to 5 cm. Hatched: needs more than it has. Dashed: no touch.",
            fontsize=9,
        )
        figure.supylabel("z, m", fontsize=10)
        write_file(path, to_png(figure), replace=replace)


def _grid(axes: Axes, rows: Sequence[Mapping[str, Any]], colours: ScalarMappable) -> None:
    for row in rows:
        line, column = divmod(CELLS.index(row["cell"]), 3)
        corner = (1.5 - column, line - 0.5)  # columns 1 to 3 go from the right to the left, seen from behind
        error = row["error_mm"]
        hot = WORST_MM if error is None else min(error, WORST_MM)
        face = colours.to_rgba(np.array([hot]))[0] if row["possible"] else "#e4e6e9"
        axes.add_patch(Rectangle(corner, 1, 1, fc=face, ec="white", lw=2.0, hatch=None if row["possible"] else "///"))
        if row["possible"] and not row["touched"]:
            axes.add_patch(
                Rectangle((corner[0] + 0.05, corner[1] + 0.05), 0.9, 0.9, fill=False, ec=INK, lw=1.2, ls=(0, (4, 2)))
            )
        came = "stopped" if error is None else f"{error:.0f} mm"
        needs = "not reached" if row["needed_s"] is None else f"needs {row['needed_s']:.2f} s"
        axes.text(
            2 - column,
            line,
            f"{row['cell']}   {came}\n{needs}\nhas {row['given_s']:.2f} s\n"
            f"known {row['place_known_s']:.2f} s",
            ha="center", va="center", fontsize=8, linespacing=1.35,
            color="white" if row["possible"] and hot > 0.6 * WORST_MM else INK,
            bbox=None if row["possible"] else {"fc": "#e4e6e9", "ec": "none", "pad": 2.0},
        )  # fmt: skip
    axes.set_xlim(-0.5, 2.5)
    axes.set_ylim(-0.5, 2.5)
    axes.set_xticks(range(3), [f"{n}:  {y:+.2f}" for n, y in zip("321", GRID_Y[::-1], strict=True)])
    axes.set_yticks(range(3), [f"{row}:  {z:.1f}" for row, z in zip("ABC", GRID_Z, strict=True)])
    axes.tick_params(length=0, colors=FAINT)
    axes.set_aspect("equal")
    for side in axes.spines.values():
        side.set_visible(False)

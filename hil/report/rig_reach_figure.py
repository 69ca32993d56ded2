"""The map of what the mounted arm can reach."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from highfive.hil.arm.reachability import DEPTH, REACHABILITY, BaseReach, cell_point
from highfive.hil.arm_model import kinematics
from highfive.hil.runtime.folders import write_file
from highfive.hil.sim.people.grid import CELLS, GRID_Y, GRID_Z
from highfive.model.geometry.rotations import Array

INK, QUIET = "#2b2d33", "#8a8d94"
REACHED, LACKING, CELL = "#3d7ea6", "#c44e52", "#e58a5b"


def draw_reach(path: Path, arm: str, chosen: BaseReach, found: Sequence[BaseReach], *, replace: bool = True) -> None:
    """Draws the chosen base of an arm cell by cell, its postures from above and from the side, and, where there was a
    search, its map.

    Raises:
        HighFiveError: the file cannot be written, or is there and may not be replaced.
    """
    if found:
        figure, grid = plt.subplots(2, 2, figsize=(12, 10.5), constrained_layout=True)
        cells, side, above = grid[0, 0], grid[1, 1], grid[1, 0]
        _search(grid[0, 1], found)
    else:
        figure, (cells, above, side) = plt.subplots(
            1, 3, figsize=(14, 5.2), width_ratios=(1.1, 1.2, 0.9), constrained_layout=True
        )
    _cells(cells, chosen)
    _postures(above, chosen, (1, 0), "from above")
    _postures(side, chosen, (0, 2), "from the side")
    base = chosen.base
    figure.suptitle(
        f"{arm}: base {base.height:.2f} m high, {base.standoff:.2f} m behind the grid, {base.side:.0f}° aside, tilted "
        f"{base.tilt:.0f}°, plate {base.out:.2f} m out: {chosen.reached} of 9 cells, slowest {chosen.slowest:.2f} s",
        color=INK,
    )
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    plt.close(figure)
    write_file(path, picture.getvalue(), replace=replace)


def _cells(axes: Axes, reach: BaseReach) -> None:
    times = np.array([cell.seconds if cell.reached else np.nan for cell in reach.cells]).reshape(3, 3)
    # columns 1 to 3 go from the avatar's right to its left; seen from behind it, left is on the left
    axes.imshow(times[:, ::-1], origin="lower", cmap="YlGnBu", vmin=0.2, vmax=1.2)
    for index, cell in enumerate(reach.cells):
        row, column = divmod(index, 3)
        text = f"{cell.cell}\n{cell.seconds:.2f} s\nmargin {np.degrees(cell.margin):.0f}°\ngap {100 * cell.gap:.0f} cm"
        if not cell.reached:
            text = "\n".join((cell.cell, "not reached:", *wrap(cell.lacking, 16)))
        dark = cell.reached and cell.seconds > 0.7
        axes.text(2 - column, row, text, ha="center", va="center", color="white" if dark else INK)
    axes.set_xticks(range(3), [f"{n}:  {y:+.2f}" for n, y in zip("321", GRID_Y[::-1], strict=True)])
    axes.set_yticks(range(3), [f"{row}:  {z:.1f}" for row, z in zip("ABC", GRID_Z, strict=True)])
    axes.set_xlabel("y, m (from behind the arm)")
    axes.set_ylabel("z, m")
    axes.set_title("quickest reach from the ready posture")


def _search(axes: Axes, found: Sequence[BaseReach]) -> None:
    axes.set_title("the search: cells reached, slowest reach")
    heights, standoffs = REACHABILITY.heights, REACHABILITY.standoffs
    best = np.full((len(heights), len(standoffs)), np.nan)
    for reach in found:
        row, column = heights.index(reach.base.height), standoffs.index(reach.base.standoff)
        if not reach.reached <= best[row, column]:
            best[row, column] = reach.reached
    axes.imshow(best, origin="lower", cmap="Greens", vmin=0, vmax=9)
    for row, height in enumerate(heights):
        for column, standoff in enumerate(standoffs):
            here = [r for r in found if (r.base.height, r.base.standoff) == (height, standoff)]
            whole = [r.slowest for r in here if r.reached == len(CELLS)]
            if not here:
                continue
            text = f"9\n{min(whole):.2f} s" if whole else f"{best[row, column]:.0f}"
            axes.text(column, row, text, ha="center", va="center", color="white" if best[row, column] > 6 else INK)
    axes.set_xticks(range(len(standoffs)), [f"{value:.2f}" for value in standoffs])
    axes.set_yticks(range(len(heights)), [f"{value:.1f}" for value in heights])
    axes.set_xlabel("stand-off, m")
    axes.set_ylabel("height of the base, m")


def _postures(axes: Axes, reach: BaseReach, shown: tuple[int, int], title: str) -> None:
    arm = reach.base.arm()
    for cell in reach.cells:
        _line(axes, _chain(reach, cell.joints), shown, REACHED if cell.reached else LACKING, 1.2)
        axes.plot(*cell_point(cell.cell)[list(shown)], "o", color=CELL, ms=5, zorder=3)
    _line(axes, _chain(reach, reach.ready), shown, INK, 2.6)
    base = arm.packed.base
    axes.plot(*base[list(shown)], "s", color=QUIET, ms=9)
    if shown[1] == 2:
        axes.plot([base[0], base[0]], [0.0, base[2]], color=QUIET, lw=5, zorder=0)
        axes.axvline(DEPTH, color=QUIET, lw=0.6, ls=":")
        axes.set_ylim(min(base[2], *GRID_Z) - 0.25, 1.95)
        axes.set_xlim(min(axes.get_xlim()[0], base[0] - 0.1), DEPTH + 0.1)
    else:
        axes.axhline(DEPTH, color=QUIET, lw=0.6, ls=":")
        axes.invert_xaxis()
    axes.set_aspect("equal")
    axes.set_xlabel(f"{'xyz'[shown[0]]}, m")
    axes.set_ylabel(f"{'xyz'[shown[1]]}, m")
    axes.set_title(title)
    if shown[1] != 2:
        key = (("waits", INK), ("reaches a cell", REACHED), ("does not", LACKING))
        lines = [Line2D([], [], color=colour) for _, colour in key]
        dots = [Line2D([], [], color=colour, marker=mark, ls="") for colour, mark in ((CELL, "o"), (QUIET, "s"))]
        axes.legend([*lines, *dots], [*(name for name, _ in key), "cell", "base"], fontsize=8, loc="best")


def _chain(reach: BaseReach, joints: Array) -> Array:
    arm = reach.base.arm()
    return np.vstack([arm.packed.base, kinematics.joint_centres(arm.packed, joints), arm.plate_at(joints).position])


def _line(axes: Axes, points: Array, shown: tuple[int, int], colour: str, width: float) -> None:
    axes.plot(*points[:, list(shown)].T, color=colour, lw=width, marker=".", ms=4, alpha=0.85)

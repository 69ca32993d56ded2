"""``highfive rig reach``: which bases reach every cell, with what margin and how fast, and what the chosen one does."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.runtime.folders import check_file
from highfive.hil.sim.people.grid import CELLS

if TYPE_CHECKING:
    from highfive.hil.runtime.console import Bar
from highfive.hil.arm.reachability import (
    CHOSEN,
    REACHABILITY,
    BaseReach,
    as_mounted,
    bases,
    cell_point,
    facing,
    from_ready,
    postures,
    search,
    tried,
)


def rig_reach(
    picture: Path | None, quick: bool, bar: Bar, *, overwrite: bool = False, arm: str = DEFAULT_ARM
) -> dict[str, Any]:
    """What ``highfive rig reach`` tells: the chosen base cell by cell, and the best of the search.

    Args:
        picture: where to draw the map; None draws none.
        quick: looks at the chosen base only.
        bar: of progress.
        overwrite: replace a picture that is there.
        arm: name or folder; a search is made for the default one alone.

    Raises:
        HighFiveError: the picture cannot be written, or is there and may not be replaced.
    """
    if picture is not None:
        check_file(picture, overwrite, "--picture")
    folder = find_arm(arm)
    default = folder == find_arm(DEFAULT_ARM)
    chosen = _chosen() if default else as_mounted(folder)
    look = bases() if default and not quick else []
    found = search(look, bar("bases", len(look))) if look else []
    if picture is not None:
        from highfive.hil.report.rig_reach_figure import draw_reach  # noqa: PLC0415 (matplotlib takes a second)

        draw_reach(picture, folder.name, chosen, found, replace=overwrite)
    return {
        "arm": folder.name,
        "gives_up": folder.gives_up,
        "chosen": _described(chosen),
        "cells": {
            cell.cell: {
                "reached": cell.reached,
                "lacking": cell.lacking,
                "margin_deg": round(float(np.degrees(cell.margin)), 1),
                "gap_m": round(cell.gap, 3),
                "seconds": round(cell.seconds, 3),
                "miss_mm": round(1e3 * cell.miss, 1),
                "turned_deg": round(float(np.degrees(cell.turned)), 1),
            }
            for cell in chosen.cells
        },
        "bases": len(found),
        "bases_with_all_cells": sum(reach.reached == len(CELLS) for reach in found),
        "best": [_described(reach) for reach in found[: REACHABILITY.finalists]],
        "picture": None if picture is None else str(picture),
    }


def print_rig_reach(result: dict[str, Any]) -> None:
    """The reach of the mount as it is, and the best of the search, for people."""
    of = result["chosen"]
    print(f"{result['arm']}" + (f" gives up {result['gives_up']}" if result["gives_up"] else ""))
    print(
        f"base {of['height']:.2f} m high, {of['standoff']:.2f} m behind the grid, {of['side_deg']:.0f}° aside, tilted "
        f"{of['tilt_deg']:.0f}°: {of['cells']} of {len(result['cells'])} cells, slowest reach {of['slowest_s']:.2f} s"
    )
    for name, cell in result["cells"].items():
        reached = "reached" if cell["reached"] else f"not reached ({cell['lacking']})"
        if cell["reached"] and cell["turned_deg"] >= 0.5:
            reached += f" (palm turned away by {cell['turned_deg']:.0f}°)"
        print(
            f"  {name}  {reached}, {cell['seconds']:.2f} s, {cell['margin_deg']:.0f}° from a joint's limit, "
            f"{100.0 * cell['gap_m']:.0f} cm from anything"
        )
    if result["bases"]:
        print(f"of {result['bases']} bases {result['bases_with_all_cells']} reach every cell; the best:")
        for best in result["best"]:
            where = f"{best['height']:.2f} m high, {best['standoff']:.2f} m behind, {best['side_deg']:.0f}° aside"
            print(
                f"  {where}, tilted {best['tilt_deg']:.0f}°, plate {best['plate']:.2f} m: {best['cells']} cells, "
                f"slowest {best['slowest_s']:.2f} s"
            )
    print(f"map: {result['picture']}")


def _chosen() -> BaseReach:
    arm, normal = CHOSEN.arm(), facing()
    return from_ready(CHOSEN, arm, arm.ready, [postures(arm, cell_point(cell), normal) for cell in CELLS])


def _described(reach: BaseReach) -> dict[str, Any]:
    base, trial = reach.base, tried(reach)
    return {
        "height": base.height, "standoff": base.standoff, "side_deg": base.side, "tilt_deg": base.tilt,
        "plate": round(base.out, 3), "cells": reach.reached, "slowest_s": round(reach.slowest, 3),
        "margin_deg": round(float(np.degrees(reach.margin)), 1),
        "miss_mm": {"median": round(1e3 * trial.median, 1), "max": round(1e3 * trial.largest, 1)},
        "notice_s": trial.notice, "ready_rad": np.round(reach.ready, 3).tolist(),
    }  # fmt: skip

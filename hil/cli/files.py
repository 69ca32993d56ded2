"""The commands between our files and those of other programs: a session exported, foreign motion imported."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli.options import Json
from highfive.hil.runtime.console import print_result, progress_bars

app = typer.Typer()


@app.command()
def export(
    session: Annotated[Path, typer.Argument(metavar="SESSION", help="A session's session.mcap, or its folder.")],
    to: Annotated[str, typer.Option("--to", help="bvh, glb, csv, npz, c3d or bids (docs/recordings.md).")],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder, or a name with the format's ending (default: beside the recording, with its name)."),
    ] = None,
    trial: Annotated[int | None, typer.Option(min=0, help="Only this high five, by its number from 0.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the files that are written.")] = False,
    json: Json = False,
) -> None:
    """Turn a session's recording into files of other programs: animation, tables, motion capture, BIDS."""
    from highfive.hil.commands.export import ExportOptions, export, print_export  # noqa: PLC0415

    with progress_bars() as bar:
        result = export(ExportOptions(session, to, out, trial, overwrite), bar)
    print_result(result, json, print_export)

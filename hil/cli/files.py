"""The commands between our files and those of other programs: a session exported, foreign motion imported."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli.options import Json, Overwrite
from highfive.hil.runtime.console import print_result, progress_bars
from highfive.model.errors import HighFiveError

app = typer.Typer()


@app.command()
def export(
    session: Annotated[
        Path,
        typer.Argument(metavar="SESSION", help="A recording, or a folder that holds one; a study with bids."),
    ],
    to: Annotated[str, typer.Option("--to", help="bvh, glb, csv, npz, c3d, bids or lerobot (docs/recordings.md).")],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder, or a name with the format's ending (default: beside the recording, with its name)."),
    ] = None,
    trial: Annotated[int | None, typer.Option(min=1, help="Only this high five; the first is 1.")] = None,
    fps: Annotated[
        int | None, typer.Option(min=1, max=1000, help="Frames a second of --to lerobot (default: 30).")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the files that are written.")] = False,
    json: Json = False,
) -> None:
    """Turn a session's recording into files of other programs: animation, tables, motion capture, BIDS, lerobot."""
    from highfive.hil.commands.export import FPS, ExportOptions, export, print_export  # noqa: PLC0415
    from highfive.hil.commands.export_study import export_study, is_study, print_study_export  # noqa: PLC0415

    if fps is not None and to != "lerobot":
        raise HighFiveError(f"--fps is of --to lerobot; {to} keeps the recording's own times")
    if is_study(session):
        if to != "bids" or trial is not None:
            raise HighFiveError(
                f"{session} is a study, which --to bids exports as a whole; give one of its recordings for all else"
            )
        with progress_bars() as bar:
            result = export_study(session, out, overwrite, bar)
        print_result(result, json, print_study_export)
        return
    with progress_bars() as bar:
        number = None if trial is None else trial - 1
        result = export(ExportOptions(session, to, out, number, overwrite, fps or FPS), bar)
    print_result(result, json, print_export)


@app.command("import")
def import_motion(
    to: Annotated[Path, typer.Option("--to", help="Folder for the C3D files and trials.csv.")],
    files: Annotated[
        list[Path] | None, typer.Argument(metavar="[FILE]...", help="BVH, TRC or CSV files, a trial each.")
    ] = None,
    human: Annotated[
        str | None,
        typer.Option("--human", "--person", help="Prefix of the person's points; without FILE, her file or folder."),
    ] = None,
    avatar: Annotated[
        str | None, typer.Option(help="Prefix of whom the avatar learns from; without FILE, that one's file or folder.")
    ] = None,
    units: Annotated[
        str | None,
        typer.Option(help="mm, cm, m, in, or metres a unit (default: as the file, or a person's size, says)."),
    ] = None,
    up: Annotated[str | None, typer.Option(help="The files' vertical, y or z (default: found by the heads).")] = None,
    emotion: Annotated[str, typer.Option(help="Emotion of these trials, for trials.csv.")] = "",
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Turn motion of other programs (BVH, TRC, CSV) into C3D files and trials.csv, to train on or to play."""
    from highfive.hil.commands.import_motion import ImportOptions, import_motion, print_imported  # noqa: PLC0415

    options = ImportOptions(tuple(files or ()), to, human, avatar, units, up, emotion, overwrite)
    with progress_bars() as bar:
        result = import_motion(options, bar)
    print_result(result, json, print_imported)

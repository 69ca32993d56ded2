"""``highfive experiment``: studies with people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli.options import Json, Overwrite
from highfive.hil.runtime.console import print_result

app = typer.Typer(help="Studies with people: what was found in them.", no_args_is_help=True)


@app.callback()
def experiment() -> None:
    """Studies with people: what was found in them."""


@app.command()
def analyse(
    counts: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Right answers: participant,condition,correct,n.")
    ] = None,
    trials: Annotated[
        Path | None,
        typer.Option(metavar="FILE.csv", help="Or every answer: participant,condition,emotion,answer[,weight]."),
    ] = None,
    emotions: Annotated[
        int | None, typer.Option(min=2, max=99, help="Answers to choose from (default: those given, or three).")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for a page, figures for print and a tidy table.")] = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Tell whether interaction helps to see emotions: the source study's table, and calibrated estimates beside it."""
    from highfive.hil.commands.experiment_analyse import AnalyseOptions, analyse, print_analysis  # noqa: PLC0415

    print_result(analyse(AnalyseOptions(counts, trials, emotions, out, overwrite)), json, print_analysis)

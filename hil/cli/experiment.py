"""``highfive experiment``: studies with people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli.options import Json, Overwrite
from highfive.hil.runtime.console import print_result, progress_bars
from highfive.model.errors import HighFiveError

app = typer.Typer(help="Studies with people.", no_args_is_help=True)


@app.callback()
def experiment() -> None:
    """Studies with people: plans, and what was found in them."""


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


@app.command()
def plan(
    file: Annotated[Path | None, typer.Argument(metavar="FILE.toml", help="The experiment.")] = None,
    template: Annotated[
        str | None, typer.Option(metavar="NAME", help="Write this one to --out instead: tipping, high_five or morph.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.toml", help="With --template (default: NAME.toml).")] = None,
    study: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the study, also one to be added to (default: out/study-1, …)."),
    ] = None,
    participants: Annotated[int | None, typer.Option(min=1, max=9999, help="Another number than in the file.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, max=2**62, help="Another one than in the file.")] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Draw the plans anew of those who did not take part yet.")
    ] = False,
    json: Json = False,
) -> None:
    """Draw everybody's trials, balanced: a table, a picture, and a plan a participant that stays as it is."""
    from highfive.hil.commands import experiment_plan as command  # noqa: PLC0415
    from highfive.hil.runtime.folders import next_folder  # noqa: PLC0415

    if (file is None) == (template is None):
        raise HighFiveError("give FILE.toml, or --template NAME for one to begin with")
    if template is not None:
        result = command.template(template, out or Path(f"{template}.toml"), overwrite)
        print_result(result, json, command.print_template)
        return
    if file is None or out is not None:
        raise HighFiveError("--out goes with --template; the plans go to --study DIR")
    options = command.PlanOptions(file, study or next_folder("study"), participants, seed, overwrite)
    with progress_bars() as bar:
        result = command.plan(options, bar)
    print_result(result, json, command.print_plan)


@app.command()
def forget(
    code: Annotated[str, typer.Argument(metavar="CODE", help="The participant's code, such as P07.")],
    study: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the study.")],
    json: Json = False,
) -> None:
    """Delete a participant's plan, rows and recordings, and say what remains."""
    from highfive.hil.commands.experiment_forget import forget, print_forgotten  # noqa: PLC0415

    print_result(forget(code, study), json, print_forgotten)

"""``highfive rig``: the servo arm and its stand-in."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli_options import Json, Seed
from hil.console import STDERR, print_result

app = typer.Typer(help="The servo arm, and the stand-in that behaves like it.", no_args_is_help=True)


@app.callback()
def rig() -> None:
    """The servo arm, and the stand-in that behaves like it."""


@app.command()
def emulate(
    file: Annotated[Path | None, typer.Option("--rig", metavar="FILE.toml", help="The arm (default: ours).")] = None,
    port_link: Annotated[
        Path | None, typer.Option(help="Make this a link to the port, which else has no name.")
    ] = None,
    baud: Annotated[int | None, typer.Option(help="Baud rate of the servos (default: the arm's).")] = None,
    faults: Annotated[
        list[str] | None, typer.Option(help="What goes wrong: dead=4@2-3; may be given again (docs/rig.md).")
    ] = None,
    factory: Annotated[bool, typer.Option("--factory", help="Servos as from the factory, to be configured.")] = False,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="End after so long.")] = None,
    unpaced: Annotated[bool, typer.Option("--unpaced", help="Bytes take no time.")] = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Serve an emulated arm on a pseudo-terminal until Ctrl-C (docs/rig.md). Nothing real moves."""
    from hil.drivers.emulator_process import EmulatorOptions  # noqa: PLC0415
    from hil.emulate import emulate, print_emulated  # noqa: PLC0415

    options = EmulatorOptions(
        rig=str(file) if file else None,
        faults=tuple(faults or ()),
        link=str(port_link) if port_link else None,
        paced=not unpaced,
        configured=not factory,
        baud_rate=baud,
        seed=seed,
    )
    result = emulate(options, seconds, _say_aside if json else _say)
    print_result(result, json, print_emulated)


def _say(line: str) -> None:
    print(line, flush=True)


def _say_aside(line: str) -> None:
    STDERR.print(line, soft_wrap=True, markup=False)

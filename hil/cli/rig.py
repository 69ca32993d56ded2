"""``highfive rig``: the servo arm and its stand-in."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli.options import (
    MONTH_S,
    ArmCommand,
    Armed,
    Https,
    Json,
    NoOpen,
    Overwrite,
    OverwriteFile,
    PagePort,
    Seed,
    WhichArm,
)
from highfive.hil.runtime.console import STDERR, print_result, progress_bars, say, say_aside
from highfive.model.errors import HighFiveError

RigFile = Annotated[Path | None, typer.Option("--rig", metavar="FILE.toml", help="The arm (default: ours).")]
ThatArm = Annotated[Path | None, typer.Option(metavar="FILE.toml", help="That arm (default: ours).")]
"""Beside a port that is told otherwise."""
Port = Annotated[str, typer.Argument(metavar="PORT", help="Serial port, such as /dev/ttyUSB0 (highfive rig scan).")]
Lower = Annotated[
    list[str] | None,
    typer.Option(help="A stricter limit, such as contact.speed=0.5 or face.radius=0.4 (docs/safety.md)."),
]
LimitsFile = Annotated[
    Path | None, typer.Option(metavar="FILE.toml", help="All limits, safer ones than ours (docs/safety.md).")
]
Estop = Annotated[
    Path | None, typer.Option(metavar="PIPE", help="Named pipe that stops the arm when anything is written to it.")
]
Calibration = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        "--registration",
        metavar="FILE.toml",
        help="Where the arm stands, and by what it differs from its drawing (highfive calibrate extrinsics).",
    ),
]
NobodyNear = Annotated[
    bool,
    typer.Option("--nobody-near", help="Beside --arm: nobody can be reached by the real arm. You answer for that."),
]
Slow = Annotated[
    bool, typer.Option("--slow", help="Beside --arm: every point of the arm at most as fast as near a face, 0.22 m/s.")
]
Faults = Annotated[
    list[str] | None,
    typer.Option(help="What goes wrong on an emulated arm: dead=4@2-3; may be given again (docs/rig.md)."),
]
ArmName = Annotated[str, typer.Option("--arm", metavar="NAME", help="Which arm, or its folder (docs/arm.md).")]
DEFAULT_NAME = "vx300s"
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask.")]

app = typer.Typer(help="The servo arm, and the stand-in that behaves like it.", no_args_is_help=True)


@app.callback()
def rig() -> None:
    """The servo arm, and the stand-in that behaves like it."""


@app.command()
def emulate(
    file: RigFile = None,
    port_link: Annotated[
        Path | None, typer.Option(help="Make this a link to the port, which else has no name.")
    ] = None,
    baud: Annotated[int | None, typer.Option(help="Baud rate of the servos (default: the arm's).")] = None,
    faults: Faults = None,
    factory: Annotated[bool, typer.Option("--factory", help="Servos as from the factory, to be configured.")] = False,
    seconds: Annotated[float | None, typer.Option(min=0.0, max=MONTH_S, help="End after so long.")] = None,
    unpaced: Annotated[bool, typer.Option("--unpaced", help="Bytes take no time.")] = False,
    seed: Seed = 0,
    plate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Rehearse a calibration: the arm differs from its drawing, as the seed says; a motion capture system "
            "(Vicon's protocol) sees its plate, whose template is written here.",
        ),
    ] = None,
    mocap_port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of that system (default: any that is free).")
    ] = 0,
    overwrite: OverwriteFile = False,
    arm: ArmName = DEFAULT_NAME,
    json: Json = False,
) -> None:
    """Serve an emulated arm on a pseudo-terminal until Ctrl-C (docs/rig.md). Nothing real moves."""
    if plate is None and (mocap_port or overwrite):
        raise HighFiveError("--mocap-port and --overwrite go with --plate: a calibration is rehearsed")
    if STDERR.is_terminal:  # what follows takes seconds, and until then there is no port
        say_aside("starting…")
    from highfive.hil.commands.rig.emulate import EmulatorOptions, emulate, print_emulated  # noqa: PLC0415
    from highfive.hil.commands.rig.rehearsal import RehearsalOptions  # noqa: PLC0415

    options = EmulatorOptions(
        rig=str(file) if file else None,
        faults=tuple(faults or ()),
        link=str(port_link) if port_link else None,
        paced=not unpaced,
        configured=not factory,
        baud_rate=baud,
        seed=seed,
    )
    rehearsal = None if plate is None else RehearsalOptions(plate, mocap_port, overwrite)
    result = emulate(options, seconds, say_aside if json else say, arm, rehearsal)
    print_result(result, json, print_emulated)


@app.command()
def draft(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="An arm of your own: model and arm.toml.")],
    overwrite: OverwriteFile = False,
    json: Json = False,
) -> None:
    """Draft an own arm's limits and rig from its model and servos, to be looked at (docs/own_arm.md)."""
    from highfive.hil.commands.rig.draft import draft_rig, print_draft  # noqa: PLC0415

    print_result(draft_rig(str(folder), overwrite), json, print_draft)


@app.command()
def scan(
    ports: Annotated[list[str] | None, typer.Argument(metavar="PORT…", help="Ports (default: all there are).")] = None,
    all_ids: Annotated[bool, typer.Option("--all", help="Ask for all 253 IDs, not 1 to 20.")] = False,
    file: RigFile = None,
    arm: ArmName = DEFAULT_NAME,
    json: Json = False,
) -> None:
    """List serial ports and the servos that answer there. Nothing moves; exit code 1 if some of the arm's do not."""
    from highfive.hil.commands.rig.service import EVERY_ID, PROBED_IDS, ScanOptions, print_scan, scan  # noqa: PLC0415

    options = ScanOptions(tuple(ports or ()), ids=EVERY_ID if all_ids else PROBED_IDS, rig=file, arm=arm)
    with progress_bars() as bar:
        result = scan(options, bar)
    print_result(result, json, print_scan)
    if any(row["missing"] for row in result["ports"]):
        raise typer.Exit(1)


@app.command()
def joints(arm: ArmName = DEFAULT_NAME, file: RigFile = None, json: Json = False) -> None:
    """List an arm's joints, their servos and limits."""
    from highfive.hil.commands.rig.joints import joints, print_joints  # noqa: PLC0415

    print_result(joints(arm, file), json, print_joints)


@app.command()
def check(
    port: Port,
    file: RigFile = None,
    arm: ArmName = DEFAULT_NAME,
    calibration: Calibration = None,
    json: Json = False,
) -> None:
    """Read everything back from the servos and compare it with the rig. Nothing moves; exit code 1 on any mismatch."""
    from highfive.hil.commands.rig.service import check, print_check  # noqa: PLC0415

    result = check(port, file, arm=arm, calibration=calibration)
    print_result(result, json, print_check)
    if not result["ready"]:
        raise typer.Exit(1)


@app.command()
def configure(
    port: Port, file: RigFile = None, arm: ArmName = DEFAULT_NAME, yes: Yes = False, json: Json = False
) -> None:
    """Show in what the servos differ from the rig, ask, and set them. Nothing moves; torque has to be off."""
    from highfive.hil.commands.rig.service import configure_rig, print_configured  # noqa: PLC0415

    def agreed(lines: list[str]) -> bool:
        for line in lines:
            say_aside(f"  {line}")
        return yes or typer.confirm("Write these?", default=False, err=True)

    result = configure_rig(port, file, agreed, arm)
    print_result(result, json, print_configured)
    if result["differences"] and not result["written"]:
        raise typer.Exit(1)


@app.command()
def reach(
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Where to draw the map (default: out/reach-1/reach.png, -2, …)."),
    ] = None,
    overwrite: OverwriteFile = False,
    quick: Annotated[bool, typer.Option("--quick", help="Only the mount as it is; no search.")] = False,
    arm: ArmName = DEFAULT_NAME,
    json: Json = False,
) -> None:
    """Show which cells the mounted arm reaches and how fast, and search for the best mount. Nothing moves."""
    from highfive.hil.commands.rig.reach import print_rig_reach, rig_reach  # noqa: PLC0415
    from highfive.hil.runtime.folders import next_folder  # noqa: PLC0415

    drawn = picture or next_folder("reach") / "reach.png"
    with progress_bars() as bar:
        result = rig_reach(drawn, quick, bar, overwrite=overwrite, arm=arm)
    print_result(result, json, print_rig_reach)


@app.command(cls=ArmCommand)
def play(
    session: Annotated[Path, typer.Argument(metavar="SESSION", help="A recording, or a folder that holds one.")],
    port: Annotated[
        str,
        typer.Option(
            help="Serial port of a real arm, which MOVES (with --arm); emulated; or virtual: emulated in virtual time."
        ),
    ] = "emulated",
    arm: Armed = False,
    which_arm: WhichArm = None,
    trial: Annotated[list[int] | None, typer.Option(min=1, help="Only this trial, from 1; may be given again.")] = None,
    begin: Annotated[int | None, typer.Option("--from", metavar="TRIAL", min=1, help="Begin with this trial.")] = None,
    trials: Annotated[int | None, typer.Option(min=1, help="Play so many at most.")] = None,
    file: RigFile = None,
    limits: LimitsFile = None,
    lower: Lower = None,
    estop: Estop = None,
    calibration: Calibration = None,
    nobody_near: NobodyNear = False,
    slow: Slow = False,
    faults: Faults = None,
    view: Annotated[bool, typer.Option("--view", help="Show it live on a page, with an emergency stop.")] = False,
    page_port: PagePort = None,
    no_open: NoOpen = False,
    https: Https = False,
    out: Annotated[Path | None, typer.Option(help="Folder for the report (default: out/play-1, -2, …).")] = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Play a recorded session's high fives on the arm. THE ARM MOVES, as far as it reaches. Nobody is tracked: a
    real arm needs --nobody-near or --slow beside --arm. Space or Esc stops it."""
    from highfive.hil.commands.arm_options import arm_options  # noqa: PLC0415
    from highfive.hil.commands.page_options import page_options  # noqa: PLC0415
    from highfive.hil.commands.rig.play import PlayOptions, play, print_played  # noqa: PLC0415
    from highfive.hil.runtime.folders import next_folder  # noqa: PLC0415

    which = arm_options(port, arm, file, limits, lower, estop, calibration, nobody_near, slow, faults, which_arm)
    assert which is not None
    chosen, first = tuple(number - 1 for number in trial or ()), None if begin is None else begin - 1
    page = page_options(view, None, None, page_port, no_open, https, port_name="--page-port")
    options = PlayOptions(session, which, chosen, first, trials, overwrite, page)
    folder = out or next_folder("play")
    with progress_bars() as bar:
        summary = play(options, folder, bar)
    if summary["stopped"]:  # first, for it matters most
        say_aside(f"the arm was stopped: {summary['stopped']}")
        if summary["remedy"]:
            say_aside(summary["remedy"])
    print_result(summary, json, lambda found: print_played(found, folder))
    if summary["stopped"]:
        if summary["from"] is not None:
            say_aside(f"go on with the same command, --from {summary['from'] + 1} and another --out")
        raise typer.Exit(1)


@app.command(cls=ArmCommand)
def follow(
    port: Annotated[
        str,
        typer.Argument(
            metavar="PORT",
            help="Serial port of a real arm, which MOVES (with --arm); emulated; or virtual: a line takes 1/30 s.",
        ),
    ],
    arm: Armed = False,
    which_arm: WhichArm = None,
    file: RigFile = None,
    limits: LimitsFile = None,
    lower: Lower = None,
    estop: Estop = None,
    calibration: Calibration = None,
    nobody_near: NobodyNear = False,
    slow: Slow = False,
    faults: Faults = None,
) -> None:
    """Have the arm follow joint goals of another program: a JSON object a line in, one out (docs/lerobot.md). THE ARM
    MOVES, as far as it reaches. Nobody is tracked: a real arm needs --nobody-near or --slow beside --arm."""
    from highfive.hil.commands.arm_options import arm_options  # noqa: PLC0415
    from highfive.hil.commands.rig.follow import follow  # noqa: PLC0415

    options = arm_options(port, arm, file, limits, lower, estop, calibration, nobody_near, slow, faults, which_arm)
    assert options is not None
    end = follow(options, sys.stdin, lambda line: print(line, flush=True))
    if end.stopped:
        say_aside(end.stopped)
    if not end.heard:  # a thread still holds standard output, for which Python's own end would wait
        os._exit(1)
    if end.stopped:
        raise typer.Exit(1)


@app.command()
def release(
    port: Port, file: RigFile = None, arm: ArmName = DEFAULT_NAME, yes: Yes = False, json: Json = False
) -> None:
    """Switch torque off. THE ARM FALLS: it has no brakes. Hold it, and keep hands from between its links."""
    from highfive.hil.commands.rig.service import print_released, release  # noqa: PLC0415

    if not yes and not typer.confirm("The arm will fall. Is somebody holding it?", default=False, err=True):
        say_aside(f"torque stays as it was on {port}")
        raise typer.Exit(1)
    result = release(port, file, arm)
    print_result(result, json, print_released)
    if result["failed"]:
        raise typer.Exit(1)

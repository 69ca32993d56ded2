"""The command line: ``highfive COMMAND``. Exit code 0: done; 1: ran and found a failure; 2: bad input, in one line."""

from __future__ import annotations

import errno
import math
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.exceptions import TyperException

from highfive.hil.cli import bench as cli_bench
from highfive.hil.cli import experiment as cli_experiment
from highfive.hil.cli import files as cli_files
from highfive.hil.cli import mocap as cli_mocap
from highfive.hil.cli import model as cli_model
from highfive.hil.cli import rig as cli_rig
from highfive.hil.cli.options import (
    ArmCommand,
    Armed,
    Camera,
    Cells,
    FieldOfView,
    Headset,
    Height,
    Https,
    Interrupted,
    Json,
    Latencies,
    Latency,
    NoOpen,
    Overwrite,
    Port,
    Publish,
    PublishNetwork,
    RecordLsl,
    Seed,
    WhichArm,
    refuse_two_people,
)
from highfive.hil.runtime.console import STDERR, escape, print_json, print_result, progress_bars, show_log
from highfive.hil.runtime.interrupts import comes_of_an_interrupt, ended_as_interrupted, raise_swallowed_interrupts
from highfive.model.errors import HighFiveError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

app.add_typer(cli_model.app)
app.add_typer(cli_mocap.app)
app.add_typer(cli_files.app)
app.add_typer(cli_bench.app, name="bench")
app.add_typer(cli_experiment.app, name="experiment")
app.add_typer(cli_rig.app, name="rig")

_INTERRUPTED = 130
"""What Typer makes of Ctrl-C."""
_TAKES_NO_MORE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Of a file that a command writes to: what it is cannot be told, most often it is standard output."""


def _print_version(requested: bool) -> None:
    if requested:
        from highfive import __version__  # noqa: PLC0415 (reads the installed package's metadata)

        print(f"highfive {__version__}")
        raise typer.Exit


@app.callback()
def begin(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Raise your hand, and an avatar, or a servo arm, meets it, in the mood you chose."""
    show_log()


@app.command(cls=ArmCommand)
def simulate(
    trials: Annotated[
        int | None, typer.Option(min=1, max=10_000, help="Number of high fives (default: emotions × cells).")
    ] = None,
    emotion: Annotated[list[str] | None, typer.Option(help="Only this emotion; may be given again.")] = None,
    cell: Cells = None,
    style: Annotated[str | None, typer.Option(help="Mixed style, such as angry=0.5,neutral=0.5.")] = None,
    source: Annotated[
        str | None,
        typer.Option(
            help="A real person instead: a C3D file, an address such as vicon://host, headset, or webcam. "
            "Or a session's recording, which is played again."
        ),
    ] = None,
    human: Annotated[
        str | None, typer.Option("--human", "--person", help="Prefix of that person's markers, such as A or human.")
    ] = None,
    marker_set: Annotated[str | None, typer.Option(help="That person's marker set: a name or a TOML file.")] = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Model file (default: the one that comes with High Five), or FILE.py:FUNCTION, your own.",
        ),
    ] = None,
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Data folder that a model of your own learns from.")
    ] = None,
    seed: Seed = 0,
    lost: Annotated[
        float | None,
        typer.Option(
            min=0.0, max=3600.0, metavar="SECONDS", help="So long before palms would meet the person is lost from view."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results (default: out/session-1, -2, …).")] = None,
    physics: Annotated[
        bool, typer.Option("--physics", help="Drive the avatar by actuators, with contact forces.")
    ] = False,
    no_correction: Annotated[
        bool, typer.Option("--no-correction", help="Play the motion as the model gives it.")
    ] = False,
    place: Annotated[
        Path | None,
        typer.Option(metavar="FILE.toml", help="Keeps where a live person stands, for the next session."),
    ] = None,
    latency: Latency = 0.0,
    latencies: Latencies = None,
    rig: Annotated[
        str | None,
        typer.Option(
            help="A servo arm takes part: emulated, virtual (emulated in virtual time), or the serial port of a real "
            "one, which MOVES (with --arm)."
        ),
    ] = None,
    arm: Armed = False,
    which_arm: WhichArm = None,
    rig_file: cli_rig.ThatArm = None,
    limits: cli_rig.LimitsFile = None,
    lower: cli_rig.Lower = None,
    estop: cli_rig.Estop = None,
    calibration: cli_rig.Calibration = None,
    nobody_near: cli_rig.NobodyNear = False,
    slow: cli_rig.Slow = False,
    faults: cli_rig.Faults = None,
    headset: Headset = None,
    view: Annotated[bool, typer.Option("--view", help="Show it live on a page in the browser.")] = False,
    port: Port = None,
    no_open: NoOpen = False,
    https: Https = False,
    publish: Publish = None,
    publish_network: PublishNetwork = False,
    record_lsl: RecordLsl = None,
    camera: Camera = None,
    height: Height = None,
    fov: FieldOfView = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="No film and no pictures of the scene.")] = False,
    film_view: Annotated[
        str,
        typer.Option(
            metavar="VIEW",
            help="From where film and pictures are taken: wide, front, shoulder, close, or AZIMUTH,ELEVATION,DISTANCE "
            "in degrees and m, such as 90,-10,3.",
        ),
    ] = "wide",
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Play high fives: partner, tracker, model, contact correction, MuJoCo; then report, film and recording."""
    from highfive.hil.commands.arm_options import arm_options  # noqa: PLC0415
    from highfive.hil.commands.page_options import page_options  # noqa: PLC0415
    from highfive.hil.commands.session_lines import print_session  # noqa: PLC0415
    from highfive.hil.commands.session_outputs import published  # noqa: PLC0415
    from highfive.hil.commands.simulate import SimulateOptions, simulate, which_model  # noqa: PLC0415
    from highfive.hil.commands.simulate_options import WebcamOptions  # noqa: PLC0415
    from highfive.hil.runtime.folders import next_folder  # noqa: PLC0415

    options = SimulateOptions(
        trials=trials,
        emotions=tuple(emotion or ()),
        cells=tuple(cell or ()),
        style=None if style is None else _style(style),
        source=source,
        human=human,
        marker_set=marker_set,
        model=which_model(model),
        data=data,
        seed=seed,
        lost=lost,
        physics=physics,
        correct=not no_correction,
        pictures=not no_pictures,
        film_view=film_view,
        place=place,
        latency_ms=latency,
        latencies=latencies,
        arm=arm_options(rig, arm, rig_file, limits, lower, estop, calibration, nobody_near, slow, faults, which_arm),
        view=page_options(view, source, headset, port, no_open, https),
        headset=headset,
        webcam=WebcamOptions(height, fov, camera),
        publish=published(publish),
        publish_network=publish_network,
        record_lsl=tuple(record_lsl or ()),
        overwrite=overwrite,
    )
    folder = out or next_folder("session")
    with progress_bars() as bar:
        summary = simulate(options, folder, bar)
    if json:
        print_json(summary)
    else:
        print_session(summary, folder)
    if _failed(summary):
        raise typer.Exit(1)


@app.command()
def demo(
    out: Annotated[Path | None, typer.Option(help="Folder for the results (default: out/session-1, -2, …).")] = None,
    no_open: NoOpen = False,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """High fives in the browser at once; meanwhile a session is played: report, film and recording."""
    from highfive.hil.commands.demo import page_beside  # noqa: PLC0415
    from highfive.hil.runtime.folders import next_folder  # noqa: PLC0415

    folder = out or next_folder("session")
    page = STDERR.is_terminal and not (no_open or json)  # where nobody looks on it ends by itself
    with page_beside(folder, overwrite, page):
        # Imported for seconds, in which the page comes up.
        from highfive.hil.commands.session_lines import print_session  # noqa: PLC0415
        from highfive.hil.commands.simulate import simulate  # noqa: PLC0415
        from highfive.hil.commands.simulate_options import SimulateOptions  # noqa: PLC0415

        with progress_bars() as bar:
            summary = simulate(SimulateOptions(overwrite=overwrite), folder, bar)
        if json:
            print_json(summary)
        else:
            print_session(summary, folder)
    if _failed(summary):
        raise typer.Exit(1)


@app.command()
def view(
    recording: Annotated[
        Path | None,
        typer.Argument(help="A recording, or a folder that holds one (default: four high fives that come along)."),
    ] = None,
    port: Port = None,
    no_open: NoOpen = False,
    https: Https = False,
) -> None:
    """Show a recording on a page in the browser: from any side, step by step, in slow motion."""
    from highfive.hil.commands.simulate_options import PageOptions  # noqa: PLC0415
    from highfive.hil.commands.view import ViewOptions  # noqa: PLC0415
    from highfive.hil.commands.view import view as show  # noqa: PLC0415

    show(ViewOptions(recording, PageOptions(port, not no_open, https)))


@app.command()
def doctor(json: Json = False) -> None:
    """What works on this computer, and what to do about what does not."""
    from highfive.hil.commands.doctor import as_json, examine, print_findings  # noqa: PLC0415

    result = as_json(examine())
    print_result(result, json, print_findings)
    if not result["ready"]:
        raise typer.Exit(1)


def _failed(summary: dict[str, Any]) -> bool:
    """Whether a session ended early, is not recorded, was played again otherwise, or missed a hand within reach."""
    replayed = summary["replayed"]
    other = replayed is not None and replayed["same"] < replayed["ticks"]
    missed = any(not (row["met"] or row["out_of_reach"]) for row in summary["rows"])
    return bool(summary["interrupted"] or summary["unrecorded"] or other or missed)


def _style(text: str) -> dict[str, float]:
    """``angry=0.5,neutral=0.5`` as weights."""
    weights: dict[str, float] = {}
    for part in text.split(","):
        name, equals, value = part.partition("=")
        if not equals and ":" in name:
            raise HighFiveError(f"--style {text}: write {name.strip().replace(':', '=', 1)}")
        try:
            weight = float(value) if equals else 1.0
        except ValueError:
            weight = math.nan
        if not math.isfinite(weight):
            raise HighFiveError(f"--style {text}: {value!r} is no number; write it as angry=0.5,neutral=0.5")
        if name.strip() in weights:
            raise HighFiveError(f"--style {text}: {name.strip()} is there twice; give each emotion one weight")
        weights[name.strip()] = weight
    return weights


def main() -> None:
    """Entry point: one line for every error that a user can put right."""
    raise_swallowed_interrupts()
    with ended_as_interrupted():
        _run()


def _run() -> NoReturn:
    try:
        refuse_two_people(sys.argv[1:])
        code = app(standalone_mode=False) or 0
        if code == _INTERRUPTED:
            raise KeyboardInterrupt
        if sys.stdout is not None:
            sys.stdout.flush()  # here: what Python itself cannot write as it ends is no line for people
        sys.exit(code)
    except TyperException as error:
        if not (message := error.format_message()):  # the help has been shown instead
            sys.exit(2)
        ports = "highfive rig scan lists ports; " if message.startswith("Missing argument 'PORT'") else ""
        message = message.replace("Input should be", "it should be")
        _fail(f"{message} ({ports}see {_asked(error)} --help)")
    except HighFiveError as error:
        _fail(str(error))
    except OSError as error:  # a name that is too long, a disk that is gone
        if error.filename is not None:
            _fail(f"{error.filename}: {error.strerror}")
        if error.errno not in (errno.EPIPE, *_TAKES_NO_MORE):
            raise
        _drop_output()
        if error.errno == errno.EPIPE:  # whoever read it has enough
            sys.exit(1)
        _fail(f"{error.strerror}: make room, or send standard output elsewhere; what is written already stays")
    except (KeyboardInterrupt, Interrupted, typer.Abort) as error:
        _end_interrupted(str(error))
    except Exception as error:
        if comes_of_an_interrupt(error):
            _end_interrupted("")
        raise


def _asked(error: TyperException) -> str:
    """The command that was asked for something, as it is typed."""
    context = getattr(error, "ctx", None)
    if context is None:  # the words could not be taken apart: an option at their end has no value
        named, command = "highfive", typer.main.get_command(app)
        for word in sys.argv[1:]:
            if (command := getattr(command, "commands", {}).get(word)) is None:
                break
            named += f" {word}"
        return named
    root: str = context.find_root().command_path  # "python -m highfive.hil.cli.main" where it was called so
    return f"highfive{context.command_path.removeprefix(root)}"


def _drop_output() -> None:
    """What standard output has not taken is tried no more, also by Python as it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)


def _end_interrupted(how: str) -> NoReturn:
    STDERR.print(f"interrupted{how}", soft_wrap=True, markup=False)
    with suppress(OSError):  # of a full disk or a closed pipe nothing more is to be said
        sys.stdout.flush()
    os._exit(1)  # not by Python's own way down: interrupted while it compiles, JAX crashes on it


def _fail(message: str) -> NoReturn:
    STDERR.print(f"[bold red]error:[/] {escape(' '.join(message.split()))}", soft_wrap=True)
    sys.exit(2)


if __name__ == "__main__":
    main()

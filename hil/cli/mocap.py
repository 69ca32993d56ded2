"""The commands around motion capture: a live system played and listened to, recordings filled, people measured."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli import rig as cli_rig
from highfive.hil.cli.options import (
    MONTH_S,
    AnySet,
    ArmCommand,
    Armed,
    Https,
    Json,
    Overwrite,
    OverwriteFile,
    Person,
    Port,
    Seed,
    WhichArm,
)
from highfive.hil.runtime.console import print_json, print_result, progress_bars, say, say_aside

app = typer.Typer()
calibrate = typer.Typer(help="Fit what the project knows of a person or a place to a recording.", no_args_is_help=True)
app.add_typer(calibrate, name="calibrate")


@app.command()
def serve(
    protocol: Annotated[str, typer.Argument(help="vicon, qtm, natnet or lsl.")],
    file: Annotated[Path, typer.Argument(metavar="FILE.c3d", help="The recording to send.")],
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end, until Ctrl-C.")] = False,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port (default: the protocol's; 0: any).")] = None,
    host: Annotated[str, typer.Option(help="Address to listen at; 0.0.0.0 lets in the whole network.")] = "127.0.0.1",
    faults: Annotated[
        list[str] | None,
        typer.Option(help="What goes wrong: occlusion=RFIN+RMC5@2-2.3; may be given again."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(min=1.0, max=2000.0, help="Frames per second (default: the recording's).")
    ] = None,
    person: Annotated[
        str | None, typer.Option("--person", "--human", help="Send only the markers of this prefix.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, max=MONTH_S, help="End after so long.")] = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Replay a recording as a live motion capture system, with faults on demand (docs/mocap.md)."""
    from highfive.hil.commands.serve import ServeOptions, serve_recording  # noqa: PLC0415

    options = ServeOptions(
        protocol,
        file,
        loop,
        port,
        host,
        tuple(one for text in faults or () for one in text.split(",")),
        rate,
        person,
        seconds,
        seed,
    )
    result = serve_recording(options, say_aside if json else say)
    if json:
        print_json(result)


@app.command()
def stream(
    address: Annotated[
        str, typer.Argument(help="vicon://host, qtm://host, natnet://host, lsl://name or a C3D file (docs/mocap.md).")
    ],
    person: Person = None,
    seconds: Annotated[
        float | None, typer.Option(min=0.0, max=MONTH_S, help="End so long after the first frame.")
    ] = None,
    record: Annotated[Path | None, typer.Option(metavar="FILE.c3d", help="Keep everything that comes.")] = None,
    marker_set: AnySet = None,
    overwrite: OverwriteFile = False,
    json: Json = False,
) -> None:
    """Show a live motion capture system: rate, latency, gaps, each marker, the right arm; Ctrl-C ends it."""
    from highfive.hil.commands.stream.stream import StreamOptions, stream  # noqa: PLC0415

    result = stream(StreamOptions(address, person, seconds, record, marker_set, json, overwrite), say_aside)
    if json:
        print_json(result)
    if not result["frames"]:
        say_aside(f"no frame came from {result['source']}: {result['trouble'] or 'nothing was sent'}")
        raise typer.Exit(1)
    if result.get("recording_trouble"):
        raise typer.Exit(2)


@app.command()
def track(
    file: Annotated[Path, typer.Argument(metavar="FILE.c3d", help="The recording.")],
    person: Person = None,
    marker_set: AnySet = None,
    subject: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="The person's own set, from calibrate subject.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results (default: out/track-1, -2, …).")] = None,
    no_fit: Annotated[
        bool, typer.Option("--no-fit", help="Use the marker set as it is, not fitted to the person first.")
    ] = False,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Fill a recording's gaps, and write the right arm's angles and a report with figures (docs/mocap.md)."""
    from highfive.hil.commands.track import TrackOptions, print_track, track  # noqa: PLC0415

    with progress_bars() as bar:
        result = track(TrackOptions(file, person, marker_set, subject, out, not no_fit, overwrite), bar)
    print_result(result, json, print_track)


@calibrate.command("subject")
def calibrate_subject(
    file: Annotated[Path, typer.Argument(metavar="FILE.c3d", help="A recording of the person, still or moving.")],
    person: Person = None,
    marker_set: AnySet = None,
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="The person's own marker set.")] = Path("subject.toml"),
    overwrite: OverwriteFile = False,
    json: Json = False,
) -> None:
    """Fit segment lengths and places of markers to a person, and write her own marker set (docs/markers.md)."""
    from highfive.hil.commands.calibrate import CalibrateOptions, calibrate_subject, print_subject  # noqa: PLC0415

    with progress_bars() as bar:
        result = calibrate_subject(CalibrateOptions(file, person, marker_set, out, overwrite), bar)
    print_result(result, json, print_subject)


@calibrate.command("headset")
def calibrate_headset(
    source: Annotated[str, typer.Option(help="The motion capture system: vicon://host, qtm://host, …")],
    person: Person = None,
    marker_set: AnySet = None,
    seconds: Annotated[float, typer.Option(min=5.0, max=120.0, help="For how long the head is watched, s.")] = 20.0,
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="The registration, for simulate --headset.")] = Path(
        "headset.toml"
    ),
    port: Port = None,
    https: Https = False,
    overwrite: OverwriteFile = False,
    json: Json = False,
) -> None:
    """Register a headset beside a lab's motion capture system, from a head that nods and turns (docs/viewer.md)."""
    from highfive.hil.commands.calibrate_headset import (  # noqa: PLC0415
        HeadsetCalibration,
        calibrate_headset,
        print_headset,
    )
    from highfive.hil.commands.simulate_options import PageOptions  # noqa: PLC0415

    page = PageOptions(port, open_browser=False, https=https)
    options = HeadsetCalibration(source, person, marker_set, seconds, out, overwrite, page)
    with progress_bars() as bar:
        result = calibrate_headset(options, bar)
    print_result(result, json, print_headset)


_CalibratedPort = Annotated[
    str,
    typer.Argument(
        metavar="PORT",
        help="Serial port of the arm (highfive rig scan); virtual: a rehearsal, with an arm that differs from its "
        "drawing as --seed says.",
    ),
]
_CalibratedSource = Annotated[
    str | None, typer.Option(help="The motion capture system: vicon://host, qtm://host, …; none to rehearse.")
]
_Calibrated = Annotated[
    Path | None, typer.Option(metavar="FILE.toml", help="The arm's, as calibrate extrinsics wrote it.")
]


@calibrate.command("extrinsics", cls=ArmCommand)
def calibrate_extrinsics(
    port: _CalibratedPort,
    source: _CalibratedSource = None,
    plate: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="The plate's template (docs/calibration.md).")
    ] = None,
    arm: Armed = False,
    which_arm: WhichArm = None,
    rig_file: cli_rig.ThatArm = None,
    limits: cli_rig.LimitsFile = None,
    estop: cli_rig.Estop = None,
    poses: Annotated[int, typer.Option(help="Number of postures.")] = 30,
    note: Annotated[str, typer.Option(help="Kept in the file.")] = "",
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="The calibration, for --calibration.")] = Path(
        "arm.toml"
    ),
    overwrite: OverwriteFile = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Find where the arm stands in the room, and by what it differs from its drawing. THE ARM MOVES, slowly."""
    from highfive.hil.commands.arm_options import arm_options  # noqa: PLC0415
    from highfive.hil.commands.calibrate_extrinsics import (  # noqa: PLC0415
        ExtrinsicsOptions,
        calibrate_extrinsics,
        print_extrinsics,
    )

    which = arm_options(port, arm, rig_file, limits, None, estop, None, False, True, None, which_arm)
    assert which is not None
    options = ExtrinsicsOptions(which, source, plate, poses, seed, note, out, overwrite)
    with progress_bars() as bar:
        result = calibrate_extrinsics(options, bar)
    print_result(result, json, print_extrinsics)


@calibrate.command("servos", cls=ArmCommand)
def calibrate_servos(
    port: _CalibratedPort,
    source: _CalibratedSource = None,
    arm: Armed = False,
    which_arm: WhichArm = None,
    calibration: _Calibrated = None,
    rig_file: cli_rig.ThatArm = None,
    limits: cli_rig.LimitsFile = None,
    estop: cli_rig.Estop = None,
    pairs: Annotated[int, typer.Option(help="Postures, each taken from both sides.")] = 12,
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="The same with the servos in it.")] = Path("arm.toml"),
    overwrite: OverwriteFile = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Measure zeros, play, compliance and friction of an arm's servos; show what is new, ask, and write it
    (docs/calibration.md). THE ARM MOVES, slowly, where nobody is."""
    from highfive.hil.commands.arm_options import arm_options  # noqa: PLC0415
    from highfive.hil.commands.calibrate_servos import (  # noqa: PLC0415
        ServoOptions,
        calibrate_servos,
        print_servos,
        shown,
    )

    def agreed(lines: list[str]) -> bool:
        shown(lines)
        return bool(lines) and (yes or typer.confirm("Write these?", default=False, err=True))

    which = arm_options(port, arm, rig_file, limits, None, estop, calibration, False, True, None, which_arm)
    assert which is not None
    with progress_bars() as bar:
        result = calibrate_servos(ServoOptions(which, source, pairs, seed, out, overwrite), bar, agreed)
    print_result(result, json, print_servos)
    if result["changes"] and not result["written"]:
        raise typer.Exit(1)


@calibrate.command("latency", cls=ArmCommand)
def calibrate_latency(
    port: Annotated[str, typer.Argument(metavar="PORT", help="Serial port of the arm; virtual: emulated, not kept.")],
    source: Annotated[
        str | None, typer.Option(help="The motion capture system that sees the plate: how late it is, too.")
    ] = None,
    wand: Annotated[
        str | None, typer.Option(metavar="LABEL", help="A marker to be followed: the whole, end to end.")
    ] = None,
    arm: Armed = False,
    which_arm: WhichArm = None,
    calibration: _Calibrated = None,
    rig_file: cli_rig.ThatArm = None,
    limits: cli_rig.LimitsFile = None,
    estop: cli_rig.Estop = None,
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="The same with the lags in it.")] = Path("arm.toml"),
    overwrite: OverwriteFile = False,
    json: Json = False,
) -> None:
    """Measure how late each joint is, by chirps below every limit (docs/calibration.md). THE ARM MOVES, slowly."""
    from highfive.hil.commands.arm_options import arm_options  # noqa: PLC0415
    from highfive.hil.commands.calibrate_latency import (  # noqa: PLC0415
        LatencyOptions,
        calibrate_latency,
        print_latency,
    )

    which = arm_options(port, arm, rig_file, limits, None, estop, calibration, False, True, None, which_arm)
    assert which is not None
    with progress_bars() as bar:
        result = calibrate_latency(LatencyOptions(which, source, wand, out, overwrite), bar)
    print_result(result, json, print_latency)


@calibrate.command("room")
def calibrate_room(
    source: Annotated[str, typer.Option(help="The motion capture system: vicon://host, qtm://host, …")],
    markers: Annotated[
        str, typer.Option(metavar="A,B[,C]", help="Labels on the floor: below the avatar, ahead of it, to its left.")
    ],
    height: Annotated[
        float, typer.Option(min=0.0, max=2000.0, help="Of the markers' middles above the floor, mm.")
    ] = 0.0,
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="The placement, for --place.")] = Path("place.toml"),
    overwrite: OverwriteFile = False,
    json: Json = False,
) -> None:
    """Say where the avatar stands and faces by an L-frame, three markers or a wand on the floor (docs/mocap.md)."""
    from highfive.hil.commands.calibrate_room import RoomOptions, calibrate_room, print_room  # noqa: PLC0415

    names = tuple(name.strip() for name in markers.split(","))
    print_result(calibrate_room(RoomOptions(source, names, 1e-3 * height, out, overwrite)), json, print_room)


@calibrate.command("show")
def calibrate_show(
    files: Annotated[list[Path], typer.Argument(metavar="FILE.toml [OTHER.toml]", help="One of an arm, or two.")],
    arm: cli_rig.ArmName = cli_rig.DEFAULT_NAME,
    rig_file: cli_rig.ThatArm = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the room and each posture's residuals there.")
    ] = None,
    overwrite: OverwriteFile = False,
    json: Json = False,
) -> None:
    """Show what is calibrated of an arm, when and how well; of two, how they differ (exit code 1: they disagree)."""
    from highfive.hil.commands.calibrate_show import ShowOptions, calibrate_show, print_show  # noqa: PLC0415

    result = calibrate_show(ShowOptions(tuple(files), arm, rig_file, picture, overwrite))
    print_result(result, json, print_show)
    if result.get("difference", {}).get("disagreement"):
        raise typer.Exit(1)


@calibrate.command("event")
def calibrate_event(
    recording: Annotated[Path, typer.Argument(help="A recording, or a folder that holds one, with taps or claps.")],
    stream: Annotated[str, typer.Option(help="Whose latency is sought: person, arm, or lsl/NAME.")],
    reference: Annotated[str, typer.Option(help="The stream that is in time, likewise.")],
    channel: Annotated[
        str | None,
        typer.Option(help="Of the stream: a channel's label, a person's marker, a text (default: the clearest)."),
    ] = None,
    reference_channel: Annotated[str | None, typer.Option(help="The same of the reference.")] = None,
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="The latencies, for simulate --latencies.")] = Path(
        "latencies.toml"
    ),
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what the file has of this stream.")] = False,
    json: Json = False,
) -> None:
    """Measure how late one stream is, from taps or claps that another one sees too (docs/synchronisation.md)."""
    from highfive.hil.commands.calibrate_event import EventCalibration, calibrate_event, print_event  # noqa: PLC0415

    options = EventCalibration(recording, stream, reference, channel, reference_channel, out, overwrite)
    print_result(calibrate_event(options), json, print_event)

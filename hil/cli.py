"""The command line: ``highfive COMMAND``. Exit code 0: done; 1: ran and found a failure; 2: bad input, in one line."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.exceptions import TyperException

from hil.console import STDERR, counted, print_json, print_observations, print_scores, progress_bars
from model.errors import HighFiveError

app = typer.Typer(
    help="Raise your hand, and an avatar, or a servo arm, meets it, in the mood you chose.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

bench = typer.Typer(
    help="Measure how fast High Five is on this machine, and what each part of the model is worth.",
    no_args_is_help=True,
)
app.add_typer(bench, name="bench")

calibrate = typer.Typer(help="Fit what the project knows of a person or a place to a recording.", no_args_is_help=True)
app.add_typer(calibrate, name="calibrate")

Json = Annotated[bool, typer.Option("--json", help="One JSON object on standard output, nothing else.")]
Seed = Annotated[int, typer.Option(min=0, help="The same seed gives the same result.")]
Human = Annotated[str, typer.Option(help="Prefix of the person's markers.")]
Avatar = Annotated[str, typer.Option(help="Prefix of the markers of whom the avatar learns from.")]
HumanSet = Annotated[str | None, typer.Option(help="The person's marker set: a name or a TOML file.")]
AvatarSet = Annotated[str | None, typer.Option(help="The other's marker set: a name or a TOML file.")]

Person = Annotated[str | None, typer.Option(help="Prefix of the person's markers.")]
AnySet = Annotated[str | None, typer.Option(help="The marker set: a name or a TOML file.")]

_INTERRUPTED = 130
"""What Typer makes of Ctrl-C."""


class Interrupted(Exception):
    """Ctrl-C, and what is said behind the word: how to go on."""


@app.command()
def simulate(
    trials: Annotated[int | None, typer.Option(min=1, help="Number of high fives (default: emotions × cells).")] = None,
    emotion: Annotated[list[str] | None, typer.Option(help="Only this emotion; may be given again.")] = None,
    cell: Annotated[list[str] | None, typer.Option(help="Only this cell (A1 to C3); may be given again.")] = None,
    style: Annotated[str | None, typer.Option(help="Mixed style, such as angry=0.5,neutral=0.5.")] = None,
    source: Annotated[
        str | None,
        typer.Option(help="A real person instead: a C3D file, or an address such as vicon://host."),
    ] = None,
    human: Annotated[str | None, typer.Option(help="Prefix of that person's markers, such as A or human.")] = None,
    marker_set: Annotated[str | None, typer.Option(help="That person's marker set: a name or a TOML file.")] = None,
    model: Annotated[Path | None, typer.Option(help="Model file (default: the one that comes with High Five).")] = None,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="Folder for the results (default: out/session-1, -2, …).")] = None,
    physics: Annotated[
        bool, typer.Option("--physics", help="Drive the avatar by actuators, with contact forces.")
    ] = False,
    no_correction: Annotated[
        bool, typer.Option("--no-correction", help="Play the motion as the model gives it.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="No film and no pictures of the scene.")] = False,
    json: Json = False,
) -> None:
    """Play high fives: partner, tracker, model, contact correction, MuJoCo; then report, film and recording."""
    from hil.folders import next_folder  # noqa: PLC0415
    from hil.simulate import DEFAULT_MODEL, SimulateOptions, simulate  # noqa: PLC0415

    options = SimulateOptions(
        trials=trials,
        emotions=tuple(emotion or ()),
        cells=tuple(cell or ()),
        style=None if style is None else _style(style),
        source=source,
        human=human,
        marker_set=marker_set,
        model=model or DEFAULT_MODEL,
        seed=seed,
        physics=physics,
        correct=not no_correction,
        pictures=not no_pictures,
    )
    folder = out or next_folder("session")
    with progress_bars() as bar:
        summary = simulate(options, folder, bar)
    if json:
        print_json(summary)
    else:
        _tell(summary, folder)
    if summary["interrupted"] or any(not (row["met"] or row["out_of_reach"]) for row in summary["rows"]):
        raise typer.Exit(1)


@app.command()
def capture(
    out: Annotated[Path, typer.Option(help="Folder for the C3D files and trials.csv.")] = Path("captured"),
    emotion: Annotated[list[str] | None, typer.Option(help="Only this emotion; may be given again.")] = None,
    repetitions: Annotated[int, typer.Option(min=1, help="Trials for each emotion and cell.")] = 4,
    test_repetitions: Annotated[
        int | None, typer.Option(min=0, help="So many of them are marked as held out (default: the last of several).")
    ] = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Make the simulated two-actor data set: C3D files at 120 Hz and trials.csv."""
    from hil.sim.capture import capture  # noqa: PLC0415
    from hil.sim.emotions import EMOTIONS  # noqa: PLC0415

    with progress_bars() as bar:
        chosen = tuple(emotion or EMOTIONS)
        held_out = min(1, repetitions - 1) if test_repetitions is None else test_repetitions
        count = capture(out, chosen, repetitions, held_out, seed, lambda total: bar("trials", total))
    if json:
        print_json({"trials": count, "emotions": list(chosen), "seed": seed, "folder": str(out), "simulated": True})
    else:
        print(f"{count} simulated trials in {out}; train on them with: highfive train {out}")


@app.command()
def train(
    data: Annotated[Path, typer.Argument(help="Folder with C3D files of two people and trials.csv.")],
    out: Annotated[Path, typer.Option(help="The model's file.")] = Path("model.safetensors"),
    preset: Annotated[str, typer.Option(help="default, or paper for the sizes of Taubert et al. 2013.")] = "default",
    inducing: Annotated[int, typer.Option(min=2, help="Inducing inputs of each layer.")] = 200,
    human: Human = "human",
    avatar: Avatar = "avatar",
    human_set: HumanSet = None,
    avatar_set: AvatarSet = None,
    seed: Seed = 0,
    restarts: Annotated[int, typer.Option(min=1, help="Train from so many seeds and keep the best objective.")] = 1,
    iterations: Annotated[int | None, typer.Option(min=1, help="Steps of training (default: the preset's).")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the model's file if it is there.")] = False,
    json: Json = False,
) -> None:
    """Fit the model to recordings of two people; goes on where it was interrupted."""
    from hil.train import TrainOptions, after_interruption, summary, train  # noqa: PLC0415

    options = TrainOptions(
        data, out, preset, inducing, human, avatar, human_set, avatar_set, seed, overwrite, restarts, iterations
    )
    with progress_bars() as bar:
        try:
            result = train(options, bar)
        except KeyboardInterrupt:
            raise Interrupted(after_interruption(options)) from None
    if json:
        print_json(result)
    else:
        print("\n".join(summary(result)))


@app.command()
def evaluate(
    paths: Annotated[
        list[Path] | None, typer.Argument(metavar="[MODEL] [DATA]", help="Data folder; a model's file before it.")
    ] = None,
    windows: Annotated[Path | None, typer.Option(help="A windows file (.npz) instead of a data folder.")] = None,
    preset: Annotated[str, typer.Option(help="default, or paper: what is trained if no model is given.")] = "default",
    inducing: Annotated[int, typer.Option(min=2, help="Inducing inputs of each layer and of the sparse GP.")] = 200,
    seeds: Annotated[int, typer.Option(min=1, help="Trainings; the scores are medians.")] = 3,
    leave_out: Annotated[
        str | None, typer.Option(help="repetition or cell: each is held out in turn, whatever the table's split.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for a report with figures; trainings are kept there and used again.")
    ] = None,
    human: Human = "human",
    avatar: Avatar = "avatar",
    human_set: HumanSet = None,
    avatar_set: AvatarSet = None,
    json: Json = False,
) -> None:
    """Score the model beside mean pose, ridge regression, nearest neighbours and a plain sparse GP."""
    from hil.evaluate import MODELS, EvaluateOptions, evaluate  # noqa: PLC0415

    # What is not there is what its ending says, and whoever reads it says that it is missing.
    files, models, data = [], [], []
    for path in paths or []:
        folder = path.is_dir() or not (path.is_file() or path.suffix in (".npz", ".safetensors"))
        (data if folder else files if path.suffix == ".npz" else models).append(path)
    if len(data) > 1 or len(models) > 1 or len(files) + (windows is not None) > 1:
        raise HighFiveError("give one data folder or windows file, and at most one model")
    options = EvaluateOptions(
        data=data[0] if data else None,
        windows=windows or (files[0] if files else None),
        model=models[0] if models else None,
        preset=preset,
        inducing=inducing,
        seeds=seeds,
        human=human,
        avatar=avatar,
        human_set=human_set,
        avatar_set=avatar_set,
        leave_out=leave_out,
        out=out,
    )
    with progress_bars() as bar:
        try:
            result = evaluate(options, bar)
        except KeyboardInterrupt:
            raise Interrupted(f"; the same command goes on from {out / MODELS}" if out else "") from None
    if json:
        print_json(result)
    else:
        print_scores(result)
        if out is not None:
            print(f"Open {result['report']}")


@bench.command("model")
def bench_model(
    points: Annotated[int, typer.Option(min=200, help="Training points.")] = 5605,
    channels: Annotated[int, typer.Option(min=3, help="Joint angles of the avatar.")] = 159,
    inducing: Annotated[int, typer.Option(min=2, help="Inducing inputs of each layer.")] = 200,
    preset: Annotated[str, typer.Option(help="default or paper.")] = "default",
    peer_python: Annotated[
        Path | None, typer.Option(help="Interpreter with GPflow or GPy, if this one has neither.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="No training; only up to 2,000 points.")] = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Time objective and gradient, whole training and the online step on made-up motion, beside GPflow or GPy."""
    from hil.bench import BenchOptions, bench_model, print_bench  # noqa: PLC0415

    options = BenchOptions(points, channels, inducing, preset=preset, seed=seed)
    if peer_python is not None:
        options = replace(options, peer_python=peer_python)
    if quick:
        options = replace(options, sizes=(500, 1000, 2000), repeats=3, training=False)
    with progress_bars() as bar:
        result = bench_model(options, bar)
    if json:
        print_json(result)
    else:
        print_bench(result)


@bench.command("ablation")
def bench_ablation(
    data: Annotated[Path, typer.Argument(help="Data folder with held-out trials.")],
    inducing: Annotated[int, typer.Option(min=2, help="Inducing inputs of each layer.")] = 200,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Take each departure of the default preset from the paper back alone, and score on held-out trials."""
    from hil.ablation import ablate, print_ablation  # noqa: PLC0415

    with progress_bars() as bar:
        result = ablate(data, inducing, seed, bar)
    if json:
        print_json(result)
    else:
        print_ablation(result)


@bench.command("tracker")
def bench_tracker(
    peers_python: Annotated[
        Path | None, typer.Option(help="Interpreter with opensim and biorbd, if this one has neither.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Two arms, one high five, few faults; 12 s of the recording.")
    ] = False,
    json: Json = False,
) -> None:
    """Hide markers of simulated arms and of a real one, and find them, beside OpenSim, biorbd and plain filters."""
    from hil.bench_tracker import TrackerBenchOptions, bench_tracker, print_tracker_bench  # noqa: PLC0415

    options = TrackerBenchOptions()
    if quick:
        options = replace(options, seeds=2, seconds=6.0, high_fives=1, pairs=20, episodes=4, real_frames=1440)
    if peers_python is not None:
        options = replace(options, peers_python=peers_python)
    with progress_bars() as bar:
        result = bench_tracker(options, bar)
    if json:
        print_json(result)
    else:
        print_tracker_bench(result)


@bench.command("protocols")
def bench_protocols(
    file: Annotated[
        Path | None, typer.Option(metavar="FILE.c3d", help="What is sent (default: a simulated person).")
    ] = None,
    protocol: Annotated[list[str] | None, typer.Option(help="Only this protocol; may be given again.")] = None,
    person: Annotated[str | None, typer.Option(help="Prefix of the person who is followed.")] = None,
    seconds: Annotated[float, typer.Option(min=1.0, help="For each protocol, and again for its slow reader.")] = 60.0,
    json: Json = False,
) -> None:
    """Time frames from a server's wire to the tracked palm, and a slow reader, for each live protocol on loopback."""
    from hil.bench_protocols import ProtocolBenchOptions, bench_protocols, print_protocol_bench  # noqa: PLC0415
    from mocap_bridge.address import SCHEMES  # noqa: PLC0415

    options = ProtocolBenchOptions(file, tuple(protocol or SCHEMES), seconds, person)
    with progress_bars() as bar:
        result = bench_protocols(options, bar)
    if json:
        print_json(result)
    else:
        print_protocol_bench(result)


@app.command()
def observe(
    paths: Annotated[
        list[Path], typer.Argument(metavar="[MODEL] DATA", help="Data folder to learn from; a model's file before it.")
    ],
    people: Annotated[int, typer.Option(min=1, help="Simulated people, each answered in every style.")] = 36,
    morph: Annotated[str, typer.Option(help="Two styles to go between, in tenths.")] = "neutral,angry",
    human: Human = "human",
    avatar: Avatar = "avatar",
    human_set: HumanSet = None,
    avatar_set: AvatarSet = None,
    seed: Seed = 1,
    json: Json = False,
) -> None:
    """Let a machine observer, which learned from recordings, tell the emotion of generated and of corrected motion."""
    from hil.observe import ObserveOptions, observe  # noqa: PLC0415
    from hil.simulate import DEFAULT_MODEL  # noqa: PLC0415

    data = [path for path in paths if path.is_dir()]
    models = [path for path in paths if not path.is_dir()]
    if len(data) != 1 or len(models) > 1:
        raise HighFiveError("give one data folder, and at most one model before it")
    between = [name.strip() for name in morph.split(",")]
    if len(between) != 2:
        raise HighFiveError(f"--morph {morph}: expected two styles, as neutral,angry")
    options = ObserveOptions(
        data=data[0],
        model=models[0] if models else DEFAULT_MODEL,
        people=people,
        morph=(between[0], between[1]),
        seed=seed,
        human=human,
        avatar=avatar,
        human_set=human_set,
        avatar_set=avatar_set,
    )
    with progress_bars() as bar:
        result = observe(options, bar)
    if json:
        print_json(result)
    else:
        print_observations(result)


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
    rate: Annotated[float | None, typer.Option(help="Frames a second (default: the recording's).")] = None,
    person: Annotated[str | None, typer.Option(help="Send only the markers of this prefix.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="End after so long.")] = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Replay a recording as a live motion capture system, with faults on demand (docs/mocap.md)."""
    from hil.serve import ServeOptions, serve_recording  # noqa: PLC0415

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
    result = serve_recording(options, _say_aside if json else _say)
    if json:
        print_json(result)


@app.command()
def stream(
    address: Annotated[
        str, typer.Argument(help="vicon://host, qtm://host, natnet://host, lsl://name or a C3D file (docs/mocap.md).")
    ],
    person: Annotated[str | None, typer.Option(help="Prefix of the person's markers.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, help="End so long after the first frame.")] = None,
    record: Annotated[Path | None, typer.Option(metavar="FILE.c3d", help="Keep everything that comes.")] = None,
    marker_set: Annotated[str | None, typer.Option(help="The marker set: a name or a TOML file.")] = None,
    json: Json = False,
) -> None:
    """Show a live motion capture system: rate, latency, gaps, each marker, the right arm; Ctrl-C ends it."""
    from hil.stream import StreamOptions, stream  # noqa: PLC0415

    result = stream(StreamOptions(address, person, seconds, record, marker_set, quiet=json), _say_aside)
    if json:
        print_json(result)
    if not result["frames"]:
        _say_aside(f"no frame came from {result['source']}: {result['trouble'] or 'nothing was sent'}")
        raise typer.Exit(1)


@app.command()
def track(
    file: Annotated[Path, typer.Argument(metavar="FILE.c3d", help="The recording.")],
    person: Person = None,
    marker_set: AnySet = None,
    subject: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="The person's own set, from calibrate subject.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results (default: out/track-1, -2, …).")] = None,
    json: Json = False,
) -> None:
    """Fill a recording's gaps, and write the right arm's angles and a report with figures (docs/mocap.md)."""
    from hil.track import TrackOptions, print_track, track  # noqa: PLC0415

    with progress_bars() as bar:
        result = track(TrackOptions(file, person, marker_set, subject, out), bar)
    if json:
        print_json(result)
    else:
        print_track(result)


@calibrate.command("subject")
def calibrate_subject(
    file: Annotated[Path, typer.Argument(metavar="FILE.c3d", help="A recording of the person, still or moving.")],
    person: Person = None,
    marker_set: AnySet = None,
    out: Annotated[Path, typer.Option(metavar="FILE.toml", help="The person's own marker set.")] = Path("subject.toml"),
    json: Json = False,
) -> None:
    """Fit segment lengths and places of markers to a person, and write her own marker set (docs/markers.md)."""
    from hil.calibrate import CalibrateOptions, calibrate_subject, print_subject  # noqa: PLC0415

    result = calibrate_subject(CalibrateOptions(file, person, marker_set, out))
    if json:
        print_json(result)
    else:
        print_subject(result)


def _say(line: str) -> None:
    print(line, flush=True)


def _say_aside(line: str) -> None:
    STDERR.print(line, soft_wrap=True, markup=False)


def _style(text: str) -> dict[str, float]:
    """``angry=0.5,neutral=0.5`` as weights."""
    weights: dict[str, float] = {}
    for part in text.split(","):
        name, equals, value = part.partition("=")
        try:
            weights[name.strip()] = float(value) if equals else 1.0
        except ValueError:
            raise HighFiveError(f"--style {text}: {value!r} is no number; write it as angry=0.5,neutral=0.5") from None
    return weights


def _tell(summary: dict[str, Any], folder: Path) -> None:
    """The summary for people."""
    who = "simulated person" if summary["simulated"] else "recorded person"
    error, uncorrected = summary["contact_error_mm"], summary["uncorrected_error_mm"]
    print(f"{counted(summary['trials'], 'high five')} with a {who}, {counted(len(error['by_emotion']), 'emotion')}")
    print(f"  palm to palm at contact   median {error['median']:.2f} mm, worst {error['max']:.2f} mm")
    print(f"  before correction         median {uncorrected['median']:.1f} mm, worst {uncorrected['max']:.1f} mm")
    print(
        f"  one tick                  median {summary['tick_ms']['p50']:.2f} ms, p99 {summary['tick_ms']['p99']:.2f} ms"
    )
    for label, key in (
        ("out of reach", "out_of_reach"),
        ("no contact", "missed"),
        ("unwanted contacts", "unwanted_contacts"),
    ):
        if summary[key]:
            print(f"  {label + ':':<26}{summary[key]}")
    if summary["interrupted"]:
        print("  interrupted; the report covers the trials until then")
    print(f"Open {folder / 'report.html'}")


def main() -> None:
    """Entry point: one line for every error that a user can put right."""
    try:
        code = app(standalone_mode=False) or 0
        if code == _INTERRUPTED:
            raise KeyboardInterrupt
        sys.exit(code)
    except TyperException as error:
        if not (message := error.format_message()):  # the help has been shown instead
            sys.exit(2)
        _fail(f"{message} (see highfive --help)")
    except HighFiveError as error:
        _fail(str(error))
    except (KeyboardInterrupt, Interrupted, typer.Abort) as error:
        STDERR.print(f"interrupted{error}", soft_wrap=True, markup=False)
        sys.stdout.flush()
        os._exit(1)  # not by Python's own way down: interrupted while it compiles, JAX crashes on it


def _fail(message: str) -> NoReturn:
    STDERR.print(f"[bold red]error:[/] {_escape(' '.join(message.split()))}", soft_wrap=True)
    sys.exit(2)


def _escape(text: str) -> str:
    return text.replace("[", r"\[")


if __name__ == "__main__":
    main()

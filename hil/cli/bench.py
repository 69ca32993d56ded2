"""``highfive bench``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli.options import Cells, Json, OverwriteFile, Person, Seed
from highfive.hil.runtime.console import print_result, progress_bars

app = typer.Typer(
    help="Measure how fast High Five is on this machine, and what each part of the model is worth.",
    no_args_is_help=True,
)


@app.command("model")
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
    from highfive.hil.bench.speed import BenchOptions, bench_model, print_bench  # noqa: PLC0415

    options = BenchOptions(points, channels, inducing, preset=preset, seed=seed)
    if peer_python is not None:
        options = replace(options, peer_python=peer_python)
    if quick:
        options = replace(options, sizes=(500, 1000, 2000), repeats=3, training=False)
    with progress_bars() as bar:
        result = bench_model(options, bar)
    print_result(result, json, print_bench)


@app.command("ablation")
def bench_ablation(
    data: Annotated[Path, typer.Argument(help="Data folder with held-out trials.")],
    inducing: Annotated[int, typer.Option(min=2, help="Inducing inputs of each layer.")] = 200,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Take each departure of the default preset from the paper back alone, and score on held-out trials."""
    from highfive.hil.bench.ablation import ablate, print_ablation  # noqa: PLC0415

    with progress_bars() as bar:
        result = ablate(data, inducing, seed, bar)
    print_result(result, json, print_ablation)


@app.command("tracker")
def bench_tracker(
    real: Annotated[
        Path | None, typer.Option(metavar="FILE.c3d", help="A recording of a person, for the part on real people.")
    ] = None,
    person: Person = None,
    peers_python: Annotated[
        Path | None, typer.Option(help="Interpreter with opensim and biorbd, if this one has neither.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Two arms, one high five, few faults; 12 s of the recording.")
    ] = False,
    json: Json = False,
) -> None:
    """Hide markers of simulated arms and of a recorded one, and find them, beside OpenSim, biorbd and plain filters."""
    from highfive.hil.bench.tracker import TrackerBenchOptions, bench_tracker, print_tracker_bench  # noqa: PLC0415

    options = TrackerBenchOptions(real=real, person=person)
    if quick:
        options = replace(options, seeds=2, seconds=6.0, high_fives=1, pairs=20, episodes=4, real_frames=1440)
    if peers_python is not None:
        options = replace(options, peers_python=peers_python)
    with progress_bars() as bar:
        result = bench_tracker(options, bar)
    print_result(result, json, print_tracker_bench)


@app.command("protocols")
def bench_protocols(
    file: Annotated[
        Path | None, typer.Option(metavar="FILE.c3d", help="What is sent (default: a simulated person).")
    ] = None,
    protocol: Annotated[list[str] | None, typer.Option(help="Only this protocol; may be given again.")] = None,
    person: Person = None,
    seconds: Annotated[float, typer.Option(min=1.0, help="For each protocol, and again for its slow reader.")] = 60.0,
    json: Json = False,
) -> None:
    """Time frames from a server's wire to the tracked palm, and a slow reader, for each live protocol on loopback."""
    from highfive.hil.bench.protocols import ProtocolBenchOptions, bench_protocols, print_protocol_bench  # noqa: PLC0415
    from highfive.mocap_bridge.sources.registry import BUILT_IN  # noqa: PLC0415

    options = ProtocolBenchOptions(file, tuple(protocol or BUILT_IN), seconds, person)
    with progress_bars() as bar:
        result = bench_protocols(options, bar)
    print_result(result, json, print_protocol_bench)


@app.command("bus")
def bench_bus(
    seconds: Annotated[float, typer.Option(min=1.0, help="For each client.")] = 10.0,
    json: Json = False,
) -> None:
    """Time write and read cycles with seven emulated servos whose bytes take their time on the line."""
    from highfive.hil.bench.bus import BusBenchOptions, bench_bus, print_bus_bench  # noqa: PLC0415

    with progress_bars() as bar:
        result = bench_bus(BusBenchOptions(seconds), bar)
    print_result(result, json, print_bus_bench)


@app.command("contact")
def bench_contact(
    emotion: Annotated[list[str] | None, typer.Option(help="Only this emotion; may be given again.")] = None,
    cell: Cells = None,
    player: Annotated[list[str] | None, typer.Option(help="Only avatar, twin or rig; may be given again.")] = None,
    baseline: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="An earlier --json, to show what changed.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the map of what the arm could do, and did.")
    ] = None,
    foretold: Annotated[
        bool, typer.Option("--foretold", help="Tell the arm exactly where and when: what it then misses by is its own.")
    ] = False,
    overwrite: OverwriteFile = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Let avatar, twin and emulated rig meet the same hands, and tell how far off each palm is. Nothing real moves."""
    from highfive.hil.bench.contact import PLAYERS, ContactOptions, bench_contact, print_contact  # noqa: PLC0415
    from highfive.model import DEFAULT_MODEL  # noqa: PLC0415
    from highfive.model.hgpdm.store import load_model  # noqa: PLC0415

    whom = tuple(emotion or ()), tuple(cell or ()), tuple(player or PLAYERS)
    options = ContactOptions(*whom, seed, baseline, picture, foretold, overwrite)
    with progress_bars() as bar:
        result = bench_contact(options, load_model(DEFAULT_MODEL), bar)
    print_result(result, json, print_contact)


@app.command("locked")
def bench_locked(
    model: Annotated[Path | None, typer.Option(help="Model file (default: the one that comes with High Five).")] = None,
    json: Json = False,
) -> None:
    """Play high fives of people on whom nothing was ever chosen: how far is the played palm from the true one?"""
    from highfive.hil.bench.locked import bench_locked, print_locked  # noqa: PLC0415
    from highfive.model import DEFAULT_MODEL  # noqa: PLC0415

    with progress_bars() as bar:
        result = bench_locked(model or DEFAULT_MODEL, bar)
    print_result(result, json, print_locked)

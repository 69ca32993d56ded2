"""``highfive bench``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from highfive.hil.cli.options import MONTH_S, MOST_SEED, Cells, Inducing, Json, OverwriteFile, Person, Seed
from highfive.hil.commands import bench
from highfive.hil.runtime.console import Bar, print_result, progress_bars

app = typer.Typer(
    help="Measure how fast High Five is on this machine, and what each part of the model is worth.",
    no_args_is_help=True,
)

LONGEST_S = 86_400.0
"""Nobody measures for more than a day; what counts in session time may have a month."""


def _run(json: bool, measure: Callable[[Bar], bench.Measured]) -> None:
    """Measures, and prints what was found."""
    with progress_bars() as bar:
        found = measure(bar)
    print_result(found.figures, json, found.show)
    figures = found.figures
    rig_stops = figures.get("rig", {}).get("stops")  # of ``bench contact``
    if figures.get("broken") or figures.get("stopped") or rig_stops:  # a law was, and an arm, in a session or of many
        raise typer.Exit(1)


@app.command("model")
def bench_model(
    points: Annotated[int, typer.Option(min=200, max=200_000, help="Training points.")] = 5605,
    channels: Annotated[int, typer.Option(min=3, max=1000, help="Joint angles of the avatar.")] = 159,
    inducing: Inducing = 200,
    preset: Annotated[str, typer.Option(help="default or paper.")] = "default",
    peer_python: Annotated[
        Path | None, typer.Option(help="Interpreter with GPflow or GPy, if this one has neither.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="No training; only up to 2,000 points.")] = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Time objective and gradient, whole training and the online step on made-up motion, beside GPflow or GPy."""
    _run(json, lambda bar: bench.model(points, channels, inducing, preset, seed, peer_python, quick, bar))


@app.command("ablation")
def bench_ablation(
    data: Annotated[Path, typer.Argument(help="Data folder with held-out trials.")],
    inducing: Inducing = 200,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Take each departure of the default preset from the paper back alone, and score on held-out trials."""
    _run(json, lambda bar: bench.ablation(data, inducing, seed, bar))


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
    _run(json, lambda bar: bench.tracker(real, person, peers_python, quick, bar))


@app.command("protocols")
def bench_protocols(
    file: Annotated[
        Path | None, typer.Option(metavar="FILE.c3d", help="What is sent (default: a simulated person).")
    ] = None,
    protocol: Annotated[list[str] | None, typer.Option(help="Only this protocol; may be given again.")] = None,
    person: Person = None,
    seconds: Annotated[
        float, typer.Option(min=1.0, max=LONGEST_S, help="For each protocol, and again for its slow reader.")
    ] = 60.0,
    json: Json = False,
) -> None:
    """Time frames from a server's wire to the tracked palm, and a slow reader, for each live protocol on loopback."""
    _run(json, lambda bar: bench.protocols(file, protocol, seconds, person, bar))


@app.command("bus")
def bench_bus(
    seconds: Annotated[float, typer.Option(min=1.0, max=LONGEST_S, help="For each client.")] = 10.0,
    json: Json = False,
) -> None:
    """Time write and read cycles with seven emulated servos whose bytes take their time on the line."""
    _run(json, lambda bar: bench.bus(seconds, bar))


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
    virtual: Annotated[
        bool, typer.Option("--virtual", help="Let the rig play in virtual time: the same twice, whatever the machine.")
    ] = False,
    arm: Annotated[str, typer.Option(metavar="NAME", help="Which arm, or its folder (docs/arm.md).")] = "vx300s",
    locked: Annotated[bool, typer.Option("--locked", help="Meet the people of the locked set.")] = False,
    overwrite: OverwriteFile = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Let avatar, twin and emulated rig meet the same hands, and tell how far off each palm is. Nothing real moves."""
    _run(
        json,
        lambda bar: bench.contact(
            emotion, cell, player, baseline, picture, foretold, overwrite, virtual, arm, locked, seed, bar
        ),
    )


@app.command("faults")
def bench_faults(
    seeds: Annotated[int, typer.Option(min=1, max=100_000, help="Number of schedules.")] = 1000,
    first: Annotated[
        int, typer.Option(min=0, max=MOST_SEED, help="Seed of the first one: with --seeds 1 one is replayed.")
    ] = 0,
    json: Json = False,
) -> None:
    """Let things go wrong in high fives with the emulated rig, in virtual time, and hold the arm to its laws."""
    _run(json, lambda bar: bench.faults(seeds, first, bar))


@app.command("arms")
def bench_arms(
    arms: Annotated[int, typer.Option(min=1, max=10_000, help="Number of arms.")] = 50,
    first: Annotated[int, typer.Option(min=0, max=MOST_SEED, help="Seed of the first one.")] = 0,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Let arms whose masses, friction, zeros and delays are off meet hands, in virtual time: contact and laws."""
    _run(json, lambda bar: bench.arms(arms, first, seed, bar))


@app.command("session")
def bench_session(
    minutes: Annotated[float, typer.Option(min=0.1, max=LONGEST_S / 60.0, help="Of virtual time.")] = 10.0,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Play one high five after the other with the emulated rig in virtual time: missed cycles, laws, computing."""
    _run(json, lambda bar: bench.long_session(minutes, seed, bar))


@app.command("tick")
def bench_tick(
    seconds: Annotated[float, typer.Option(min=2.0, max=LONGEST_S, help="Of the paced part.")] = 20.0,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Time a tick: paced at 120 Hz through a live source, and its stages in a hot loop."""
    _run(json, lambda bar: bench.tick(seconds, seed, bar))


@app.command("recording")
def bench_recording(
    hours: Annotated[
        float, typer.Option(min=0.01, max=MONTH_S / 3600.0, help="Of a session, by the recording's own clock.")
    ] = 8.0,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Record a long session, and kill some: memory, megabytes an hour, seconds that are lost."""
    _run(json, lambda bar: bench.recording(hours, seed, bar))


@app.command("rates")
def bench_rates(
    rate: Annotated[
        list[float] | None, typer.Option(min=1.0, max=2000.0, help="Only this rate, Hz; may be given again.")
    ] = None,
    cell: Cells = None,
    twin: Annotated[bool, typer.Option("--twin", help="Let the twin of the arm meet them too.")] = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Let simulated people come in at 30 to 500 Hz, in virtual time: do palms meet as they do at 120 Hz?"""
    _run(json, lambda bar: bench.rates(rate, cell, twin, seed, bar))


@app.command("latency")
def bench_latency(
    latency: Annotated[
        list[float] | None, typer.Option(min=0.0, max=500.0, help="Only this one, ms; may be given again.")
    ] = None,
    cell: Cells = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Let simulated people come in late, in virtual time: palm to true palm, predicted over the latency and not."""
    _run(json, lambda bar: bench.latency(latency, cell, seed, bar))


@app.command("headset")
def bench_headset(
    cell: Cells = None,
    device: Annotated[
        list[str] | None, typer.Option(help='Only this one, such as "60 Hz, 35 ms"; may be given again.')
    ] = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Let simulated people wear a headset of published noise, rate and delay, in virtual time: palm to true palm."""
    _run(json, lambda bar: bench.headset(cell, device, seed, bar))


@app.command("sync")
def bench_sync(
    seconds: Annotated[
        float, typer.Option(min=30.0, max=LONGEST_S, help="Of virtual time, for each scenario.")
    ] = 300.0,
    long: Annotated[
        float, typer.Option(min=30.0, max=LONGEST_S, help="Seconds in which no clock may be taken for set.")
    ] = 10_000.0,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Let hosts drift, networks stall and clocks be set, in virtual time: how far off is each stream's time?"""
    _run(json, lambda bar: bench.sync(seconds, long, seed, bar))


@app.command("calibration")
def bench_calibration(
    arms: Annotated[int, typer.Option(min=1, max=10_000, help="Number of arms.")] = 16,
    first: Annotated[int, typer.Option(min=0, max=MOST_SEED, help="Seed of the first arm.")] = 0,
    json: Json = False,
) -> None:
    """Calibrate arms that are not as their files say: where is the plate at contact, and is a bump found?"""
    _run(json, lambda bar: bench.calibration(arms, first, bar))


@app.command("view")
def bench_view(
    seconds: Annotated[float, typer.Option(min=1.0, max=LONGEST_S, help="For so long poses are counted.")] = 60.0,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Look at the live page: poses that arrive, a tab that sleeps, what pages cost the tick, pictures a second."""
    _run(json, lambda bar: bench.view(seconds, seed, bar))


@app.command("publish")
def bench_publish(
    pairs: Annotated[int, typer.Option(min=1, max=1000, help="Pairs of high fives, published and not.")] = 8,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Let a program hear a session by LSL, VMC and Foxglove: what arrives, and what that costs a tick."""
    _run(json, lambda bar: bench.publish(pairs, seed, bar))


@app.command("webcam")
def bench_webcam(
    every: Annotated[int, typer.Option(min=1, max=4, help="Look at one picture in so many, of 15 a second.")] = 1,
    latency: Annotated[
        float, typer.Option(min=0.0, max=500.0, help="From a picture until its landmarks arrive, ms.")
    ] = 80.0,
    hold: Annotated[
        float, typer.Option(min=0.0, max=2.0, help="For so long the hand is held where it is to be met, s.")
    ] = 0.5,
    json: Json = False,
) -> None:
    """Play high fives with a rendered person as the webcam's nets saw her: touched on the screen, the wrist."""
    _run(json, lambda bar: bench.webcam(every, latency, hold, bar))


@app.command("studies")
def bench_studies(
    studies: Annotated[
        int, typer.Option(min=1, max=10_000, help="Of each kind: with an effect, of morphs, without one.")
    ] = 200,
    people: Annotated[int, typer.Option(min=2, max=99, help="In each.")] = 5,
    first: Annotated[int, typer.Option(min=0, max=MOST_SEED, help="Seed of the first one.")] = 0,
    json: Json = False,
) -> None:
    """Plan, run, break off, resume and analyse simulated studies: do the intervals hold what was put in?"""
    _run(json, lambda bar: bench.studies(studies, people, first, bar))


@app.command("fuzz")
def bench_fuzz(
    reader: Annotated[list[str] | None, typer.Option(help="Only this reader; may be given again.")] = None,
    inputs: Annotated[int, typer.Option(min=1, max=10_000_000, help="For each reader.")] = 1000,
    first: Annotated[
        int, typer.Option(min=0, max=MOST_SEED, help="Number of the first: with --inputs 1 one is read again.")
    ] = 0,
    jobs: Annotated[int, typer.Option(min=1, max=64, help="Processes.")] = 1,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Keep inputs here that did what none may.")] = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Give every reader damaged files and messages: a value or one line, never a traceback, a hang or an escape."""
    _run(json, lambda bar: bench.fuzz(reader, inputs, first, jobs, out, seed, bar))


@app.command("locked")
def bench_locked(
    model: Annotated[Path | None, typer.Option(help="Model file (default: the one that comes with High Five).")] = None,
    json: Json = False,
) -> None:
    """Play high fives of the locked set's people: how far is the played palm from the true one?"""
    _run(json, lambda bar: bench.locked(model, bar))


@app.command("start")
def bench_start(
    repeats: Annotated[int, typer.Option(min=1, max=99, help="Runs of each command.")] = 3,
    json: Json = False,
) -> None:
    """Time each command's help, the first frame and the first high five; memory, imports, installed megabytes."""
    _run(json, lambda bar: bench.start(repeats, bar))

"""``highfive bench``: each benchmark with what the command line gives it. No other module knows of benchmarks."""

# Every benchmark loads other things, some of them heavy: each is imported by who asks for it.
# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from highfive.hil.runtime.console import Bar


@dataclass(frozen=True)
class Measured:
    """What a benchmark found, and what prints it for people."""

    figures: dict[str, Any]
    show: Callable[[dict[str, Any]], None]


def model(
    points: int, channels: int, inducing: int, preset: str, seed: int, peer_python: Path | None, quick: bool, bar: Bar
) -> Measured:
    """Objective, training and online step; see :mod:`highfive.hil.bench.speed`."""
    from highfive.hil.bench.speed import BenchOptions, bench_model, print_bench

    options = BenchOptions(points, channels, inducing, preset=preset, seed=seed)
    if peer_python is not None:
        options = replace(options, peer_python=peer_python)
    if quick:
        options = replace(options, sizes=(500, 1000, 2000), repeats=3, training=False)
    return Measured(bench_model(options, bar), print_bench)


def ablation(data: Path, inducing: int, seed: int, bar: Bar) -> Measured:
    """What each part of the model is worth; see :mod:`highfive.hil.bench.ablation`."""
    from highfive.hil.bench.ablation import ablate, print_ablation

    return Measured(ablate(data, inducing, seed, bar), print_ablation)


def tracker(real: Path | None, person: str | None, peers_python: Path | None, quick: bool, bar: Bar) -> Measured:
    """Hidden markers; see :mod:`highfive.hil.bench.tracker`."""
    from highfive.hil.bench.tracker import TrackerBenchOptions, bench_tracker, print_tracker_bench

    options = TrackerBenchOptions(real=real, person=person)
    if quick:
        options = replace(options, seeds=2, seconds=6.0, high_fives=1, pairs=20, episodes=4, real_frames=1440)
    if peers_python is not None:
        options = replace(options, peers_python=peers_python)
    return Measured(bench_tracker(options, bar), print_tracker_bench)


def protocols(
    file: Path | None, protocol: Sequence[str] | None, seconds: float, person: str | None, bar: Bar
) -> Measured:
    """Live protocols on loopback; see :mod:`highfive.hil.bench.protocols`."""
    from highfive.hil.bench.protocols import ProtocolBenchOptions, bench_protocols, print_protocol_bench
    from highfive.mocap_bridge.sources.registry import BUILT_IN

    options = ProtocolBenchOptions(file, tuple(protocol or BUILT_IN), seconds, person)
    return Measured(bench_protocols(options, bar), print_protocol_bench)


def bus(seconds: float, bar: Bar) -> Measured:
    """Cycles of the servo bus; see :mod:`highfive.hil.bench.bus`."""
    from highfive.hil.bench.bus import BusBenchOptions, bench_bus, print_bus_bench

    return Measured(bench_bus(BusBenchOptions(seconds), bar), print_bus_bench)


def contact(
    emotions: Sequence[str] | None,
    cells: Sequence[str] | None,
    players: Sequence[str] | None,
    baseline: Path | None,
    picture: Path | None,
    foretold: bool,
    overwrite: bool,
    virtual: bool,
    arm: str,
    locked: bool,
    seed: int,
    bar: Bar,
) -> Measured:
    """How far off each palm is; see :mod:`highfive.hil.bench.contact`."""
    from highfive.hil.bench.contact import PLAYERS, ContactOptions, bench_contact, print_contact
    from highfive.model import DEFAULT_MODEL
    from highfive.model.hgpdm.store import load_model

    whom = tuple(emotions or ()), tuple(cells or ()), tuple(players or PLAYERS)
    options = ContactOptions(*whom, seed, baseline, picture, foretold, overwrite, virtual, arm, locked)
    return Measured(bench_contact(options, load_model(DEFAULT_MODEL), bar), print_contact)


def faults(seeds: int, first: int, bar: Bar) -> Measured:
    """Schedules of faults against laws; see :mod:`highfive.hil.bench.faults`."""
    from highfive.hil.bench.faults import FaultsOptions, bench_faults, print_faults

    return Measured(bench_faults(FaultsOptions(seeds, first), bar), print_faults)


def arms(count: int, first: int, seed: int, bar: Bar) -> Measured:
    """Arms that are not as their model says; see :mod:`highfive.hil.bench.arms`."""
    from highfive.hil.bench.arms import ArmsOptions, bench_arms, print_arms
    from highfive.model import DEFAULT_MODEL
    from highfive.model.hgpdm.store import load_model

    return Measured(bench_arms(ArmsOptions(count, first, seed), load_model(DEFAULT_MODEL), bar), print_arms)


def long_session(minutes: float, seed: int, bar: Bar) -> Measured:
    """A long session with the emulated rig; see :mod:`highfive.hil.bench.long_session`."""
    from highfive.hil.bench.long_session import LongSessionOptions, bench_long_session, print_long_session
    from highfive.model import DEFAULT_MODEL
    from highfive.model.hgpdm.store import load_model

    found = bench_long_session(LongSessionOptions(minutes, seed), load_model(DEFAULT_MODEL), bar)
    return Measured(found, print_long_session)


def tick(seconds: float, seed: int, bar: Bar) -> Measured:
    """What one tick takes; see :mod:`highfive.hil.bench.tick`."""
    from highfive.hil.bench.tick import TickOptions, bench_tick, print_tick

    return Measured(bench_tick(TickOptions(seconds=seconds, seed=seed), bar), print_tick)


def recording(hours: float, seed: int, bar: Bar) -> Measured:
    """A long recording, and killed ones; see :mod:`highfive.hil.bench.recording`."""
    from highfive.hil.bench.recording import RecordingOptions, bench_recording, print_recording

    return Measured(bench_recording(RecordingOptions(hours, seed), bar), print_recording)


def rates(rates_hz: list[float] | None, cells: list[str] | None, twin: bool, seed: int, bar: Bar) -> Measured:
    """Live systems of any rate; see :mod:`highfive.hil.bench.rates`."""
    from highfive.hil.bench.rates import RATES, RatesOptions, bench_rates, print_rates
    from highfive.hil.sim.people.grid import CELLS

    options = RatesOptions(tuple(rates_hz or RATES), tuple(cells or CELLS), seed, twin)
    return Measured(bench_rates(options, bar), print_rates)


def latency(latencies_ms: list[float] | None, cells: list[str] | None, seed: int, bar: Bar) -> Measured:
    """Input latency, compensated and not; see :mod:`highfive.hil.bench.latency`."""
    from highfive.hil.bench.latency import LATENCIES_MS, LatencyOptions, bench_latency, print_latency
    from highfive.hil.sim.people.grid import CELLS

    options = LatencyOptions(tuple(latencies_ms or LATENCIES_MS), tuple(cells or CELLS), seed)
    return Measured(bench_latency(options, bar), print_latency)


def headset(cells: list[str] | None, devices: list[str] | None, seed: int, bar: Bar) -> Measured:
    """People in a headset; see :mod:`highfive.hil.bench.headset`."""
    from highfive.hil.bench.headset import DEVICES, HeadsetOptions, bench_headset, print_headset
    from highfive.hil.sim.people.grid import CELLS

    options = HeadsetOptions(tuple(cells or CELLS), seed, tuple(devices or DEVICES))
    return Measured(bench_headset(options, bar), print_headset)


def sync(seconds: float, long_s: float, seed: int, bar: Bar) -> Measured:
    """Clocks of streams; see :mod:`highfive.hil.bench.sync`."""
    from highfive.hil.bench.sync import SyncOptions, bench_sync, print_sync

    return Measured(bench_sync(SyncOptions(seed, seconds, long_s), bar), print_sync)


def calibration(arms: int, first: int, bar: Bar) -> Measured:
    """Arms that are not as drawn, calibrated; see :mod:`highfive.hil.bench.calibration`."""
    from highfive.hil.bench.calibration import CalibrationBenchOptions, bench_calibration, print_calibration

    return Measured(bench_calibration(CalibrationBenchOptions(arms, first), bar), print_calibration)


def webcam(every: int, latency_ms: float, hold_s: float, bar: Bar) -> Measured:
    """A webcam; see :mod:`highfive.hil.bench.webcam`."""
    from highfive.hil.bench.webcam import WebcamBenchOptions, bench_webcam, print_webcam

    return Measured(bench_webcam(WebcamBenchOptions(every, latency_ms, hold_s), bar), print_webcam)


def view(seconds: float, seed: int, bar: Bar) -> Measured:
    """The live page; see :mod:`highfive.hil.bench.view`."""
    from highfive.hil.bench.view import ViewBenchOptions, bench_view, print_view

    return Measured(bench_view(ViewBenchOptions(seconds, seed), bar), print_view)


def publish(pairs: int, seed: int, bar: Bar) -> Measured:
    """A session that others hear; see :mod:`highfive.hil.bench.publish`."""
    from highfive.hil.bench.publish import PublishBenchOptions, bench_publish, print_publish

    return Measured(bench_publish(PublishBenchOptions(pairs, seed), bar), print_publish)


def studies(count: int, people: int, first: int, bar: Bar) -> Measured:
    """Simulated studies; see :mod:`highfive.hil.bench.studies`."""
    from highfive.hil.bench.studies import StudiesOptions, bench_studies, print_studies

    return Measured(bench_studies(StudiesOptions(count, people, first), bar), print_studies)


def fuzz(
    readers: Sequence[str] | None, inputs: int, first: int, jobs: int, out: Path | None, seed: int, bar: Bar
) -> Measured:
    """Damaged inputs for every reader; see :mod:`highfive.hil.bench.fuzz`."""
    from highfive.hil.bench.fuzz import FuzzOptions, bench_fuzz, print_fuzz

    return Measured(bench_fuzz(FuzzOptions(tuple(readers or ()), inputs, seed, first, jobs, out), bar), print_fuzz)


def locked(file: Path | None, bar: Bar) -> Measured:
    """People of the locked set; see :mod:`highfive.hil.bench.locked`."""
    from highfive.hil.bench.locked import bench_locked, print_locked
    from highfive.model import DEFAULT_MODEL

    return Measured(bench_locked(file or DEFAULT_MODEL, bar), print_locked)


def start(repeats: int, bar: Bar) -> Measured:
    """What starting costs; see :mod:`highfive.hil.bench.start`."""
    from highfive.hil.bench.start import StartOptions, bench_start, print_start

    return Measured(bench_start(StartOptions(repeats), bar), print_start)

"""How well the tracker finds hidden markers and joint angles, and how fast, beside published trackers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from highfive.hil.bench import tracking_baseline_runs as peer_runs
from highfive.hil.bench.plain_filters import POWERS, held, kalman
from highfive.hil.bench.tracker_cases import (
    ARM_COORDINATES,
    NOISE,
    RATE_HZ,
    Case,
    lifting,
    real_recording,
    simulated_arm,
    simulated_high_five,
)
from highfive.hil.bench.tracker_faults import count_of_episodes, robustness
from highfive.hil.runtime.threads import use_one_blas_thread
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.tracking.chain import make_chain, segment_order
from highfive.mocap_bridge.tracking.filter_settings import ALIKE
from highfive.mocap_bridge.tracking.first_pose import first_state
from highfive.mocap_bridge.tracking.following import followed
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

if TYPE_CHECKING:
    from highfive.hil.runtime.console import Bar

NOISE_FACTORS = (1e-10, 1e-9, 1e-8, 1e-7, 1e-6)
"""What is tried for biorbd; the first is its own default."""

SETTLED = 60
"""Frames that every method has to settle in."""

ADVICE = (
    "not installed, and left out: {}; pip install opensim biorbd in an environment of its own and --peers-python it"
)
_FILTERS = {2: "constant_velocity", 3: "constant_acceleration"}


@dataclass(frozen=True)
class TrackerBenchOptions:
    """What is measured; see ``highfive bench tracker --help``.

    Attributes:
        seeds: simulated arms.
        seconds: of each of them.
        high_fives: simulated high fives.
        pairs: of swapped labels; the paper's 16 markers make 120.
        episodes: of ghosts, and of missing markers.
        real: a recording of a person; None leaves this part out.
        person: prefix of its markers; None for the only one with a right arm.
        real_frames: how much of it; None for all.
        peers_python: an interpreter with opensim and biorbd.
    """

    seeds: int = 6
    seconds: float = 12.0
    high_fives: int = 12
    pairs: int = 120
    episodes: int = 20
    real: Path | None = None
    person: str | None = None
    real_frames: int | None = None
    peers_python: Path = peer_runs.HERE


def bench_tracker(options: TrackerBenchOptions, bar: Bar) -> dict[str, Any]:
    """Errors, mm and degrees, and times, ms; see docs/performance.md for what each is.

    Raises:
        HighFiveError: the recording is not usable, the peers' interpreter cannot be run, or a peer fails.
    """
    use_one_blas_thread()
    peers = peer_runs.installed(options.peers_python)
    # The recording comes first: should it not be usable, that is reported at once.
    real = [] if options.real is None else [real_recording(options.real, options.person, options.real_frames)]
    made = bar("cases", options.seeds + options.high_fives)

    def reported(case: Case) -> Case:
        made()
        return case

    frames = round(options.seconds * RATE_HZ)
    arms = [reported(simulated_arm(seed, frames)) for seed in range(options.seeds)]
    greetings = [reported(simulated_high_five(seed)) for seed in range(options.high_fives)]
    cases = {"simulated": arms, "simulated_high_five": greetings, "real": real}
    methods = _methods(peers, options.peers_python)
    count = sum(len(group) for group in cases.values())
    lost: dict[str, dict[str, float]] = {}
    took: dict[str, list[Array]] = {name: [] for name in peers}
    detail = {}
    advance = bar("lost markers", count * len(methods))
    for name, group in cases.items():
        if group:
            lost[name], detail[name] = _lost_markers(group, methods, took if name == "simulated" else None, advance)
    elapsed, own = _frame_times(cases["simulated"])
    result: dict[str, Any] = {
        "peers": peers,
        "lost_marker_rms_mm": lost,
        "lost_marker_detail": detail,
        **_joints(cases["simulated"], peers, options.peers_python, bar),
        "frame_ms": {**elapsed, **{name: _percentiles(took[name]) for name in peers}},
        "frame_cpu_ms": own,
        "cases": {
            name: {"recordings": len(group), "frames": sum(len(case.truth) for case in group)}
            for name, group in cases.items()
        },
    }
    missing = [name for name in peer_runs.PEERS if name not in peers]
    if missing:
        result["peers_advice"] = ADVICE.format(", ".join(missing))
    if not real:
        result["real_advice"] = "no recording, so nothing is said of real people: give one with --real FILE.c3d"
    advance = bar("faults", count_of_episodes(options.pairs, options.episodes))
    result["robustness"] = robustness(cases["simulated"][0].without_gaps(), options.pairs, options.episodes, advance)
    return result


Method = Callable[[Case], tuple[Array, Array | None]]
"""Gives positions (T, M, 3), m, of a case's markers, and the milliseconds of each frame (T,) if they were taken."""


def _methods(peers: dict[str, str], python: Path) -> dict[str, list[Method]]:
    """What is compared; where there are several ways to set a method up, all of them."""

    def peer(name: str, **settings: float) -> Method:
        def run(case: Case) -> tuple[Array, Array | None]:
            coordinates, took = peer_runs.follow(python, name, case, **settings)
            found = np.zeros_like(case.truth)
            found[:, case.marker_set.indices(case.peer.markers)] = case.peer.marker_positions(coordinates)
            return found, took

        return run

    def filtered(order: int, power: float) -> Method:
        return lambda case: (kalman(case.measured, case.seen, RATE_HZ, order, power, NOISE), None)

    methods: dict[str, list[Method]] = {
        "high_five": [lambda case: (_tracked(case, case.marker_set), None)],
        "high_five_calibrated": [lambda case: (_tracked(case, case.personal), None)],
    }
    if "opensim" in peers:
        methods["opensim"] = [peer("opensim")]
    if "biorbd" in peers:
        methods["biorbd"] = [peer("biorbd")]
        methods["biorbd_tuned"] = [peer("biorbd", noise=factor) for factor in NOISE_FACTORS]
    for order, powers in POWERS.items():
        methods[_FILTERS[order]] = [filtered(order, power) for power in powers]
    methods["hold"] = [lambda case: (held(case.measured, case.seen), None)]
    return methods


def _tracked(case: Case, marker_set: MarkerSet) -> Array:
    tracker = Tracker(marker_set, RATE_HZ)
    return np.array([tracker.update(frame).positions for frame in case.frames()])


def _lost_markers(
    cases: list[Case],
    methods: dict[str, list[Method]],
    took: dict[str, list[Array]] | None,
    advance: Callable[[], None],
) -> tuple[dict[str, float], dict[str, Any]]:
    """Root mean square distance, mm, of hidden markers from where they were; and where ours is worst."""
    rms, detail = {}, {}
    for name, ways in methods.items():
        errors: list[list[Array]] = [[] for _ in ways]
        for case in cases:
            for way, run in enumerate(ways):
                found, times = run(case)
                errors[way].append(1e3 * np.linalg.norm(found - case.truth, axis=-1))
                if took is not None and name in took and times is not None:
                    took[name].append(times[SETTLED:])
            advance()
        each = [_rms(np.concatenate([e[c.hidden] for e, c in zip(way, cases, strict=True)])) for way in errors]
        best = int(np.argmin(each))
        rms[name] = round(each[best], 2)
        if name.startswith("high_five"):
            detail[name] = _detail(cases, errors[best])
    return rms, detail


def _detail(cases: list[Case], errors: list[Array]) -> dict[str, Any]:
    """Ours, mm: quantiles over all hidden markers, each marker, the worst gap (of which case, from which frame)."""
    pooled = np.concatenate([error[case.hidden] for error, case in zip(errors, cases, strict=True)])
    names = cases[0].marker_set.names
    by_marker = {}
    for m, name in enumerate(names):
        values = np.concatenate([e[:, m][c.hidden[:, m]] for e, c in zip(errors, cases, strict=True)])
        if len(values):
            by_marker[name] = round(_rms(values), 2)
    worst = (0.0, 0, 0)
    for number, (error, case) in enumerate(zip(errors, cases, strict=True)):
        edges = np.diff(case.hidden.any(axis=1).astype(int), prepend=0, append=0)
        for start, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
            gap = slice(int(start), int(end))
            worst = max(worst, (_rms(error[gap][case.hidden[gap]]), number, int(start)))
    p50, p95 = np.percentile(pooled, [50, 95])
    return {
        "p50": round(float(p50), 2),
        "p95": round(float(p95), 2),
        "max": round(float(pooled.max()), 2),
        "markers": by_marker,
        "worst_gap": {"rms_mm": round(worst[0], 2), "case": worst[1], "frame": worst[2]},
    }


def _joints(cases: list[Case], peers: dict[str, str], python: Path, bar: Bar) -> dict[str, Any]:
    """Root mean square error of the simulated arm's seven joints without gaps, degrees."""
    advance = bar("joint angles", len(cases) * (1 + len(peers)))
    errors: dict[str, list[Array]] = {name: [] for name in ("high_five", *peers)}
    for case in cases:
        whole = case.without_gaps()
        if whole.coordinates is None:
            raise HighFiveError("the joint angles of this case are not known")
        for name, rows in errors.items():
            found = _own_joints(whole) if name == "high_five" else peer_runs.follow(python, name, whole)[0]
            away = np.degrees(found - whole.coordinates)[SETTLED:]
            rows.append((away + 180.0) % 360.0 - 180.0)
            advance()
    pooled = {name: np.concatenate(rows) for name, rows in errors.items()}
    return {
        "joint_rms_deg": {name: round(_rms(rows), 3) for name, rows in pooled.items()},
        "joint_rms_deg_by_joint": {
            name: {joint: round(_rms(rows[:, i]), 3) for i, joint in enumerate(ARM_COORDINATES)}
            for name, rows in pooled.items()
        },
    }


def _own_joints(case: Case) -> Array:
    """The seven joints (T, 7), rad, of the tracker's chain; the shoulder to the upright trunk, as the peers have it."""
    chain, order = make_chain(case.marker_set), segment_order(case.marker_set)
    state = first_state(chain, lifting(case.marker_set), case.measured[0], case.seen[0])
    if state is None:
        raise HighFiveError("the first frame shows too few markers to begin with")
    upper, fore, hand = (order.index(f"right_{joint}") for joint in ("shoulder", "elbow", "wrist"))
    frames = []
    nothing = np.zeros((0, 3))
    for points, seen in zip(case.measured, case.seen, strict=True):
        state, _, worked = followed(chain, state, points, seen, ALIKE, nothing, round(1e9 / RATE_HZ))
        if not worked:
            raise HighFiveError("the tracker's covariance was spoilt by rounding")
        frames.append(state.pose.frames[[upper, fore, hand]])
    turned = rotations.from_matrix(np.array(frames))
    shoulder = rotations.to_euler("yxz", turned[:, 0])
    elbow = rotations.to_euler("yxz", rotations.multiply(rotations.conjugate(turned[:, 0]), turned[:, 1]))
    wrist = rotations.to_euler("xyz", rotations.multiply(rotations.conjugate(turned[:, 1]), turned[:, 2]))
    return np.concatenate([shoulder, elbow[:, [0, 2]], wrist[:, :2]], axis=1)


def _frame_times(cases: list[Case]) -> tuple[dict[str, float], dict[str, float]]:
    """Milliseconds from a frame of the paper's set, with gaps, to the tracked arm: elapsed, and of the thread's own.

    On a busy machine only the thread's own clock says what the work takes.
    """
    marker_set = cases[0].marker_set
    elapsed, own = [], []
    for case in (cases[0], *cases):  # the first one compiles
        tracker, arm = Tracker(marker_set, RATE_HZ), HumanArmEstimator(marker_set)
        times = []
        for frame in case.frames():
            own_begun, begun = time.thread_time_ns(), time.perf_counter_ns()
            arm(tracker.update(frame))
            ended, own_ended = time.perf_counter_ns(), time.thread_time_ns()
            times.append((1e-6 * (ended - begun), 1e-6 * (own_ended - own_begun)))
        elapsed.append(np.array(times[SETTLED:])[:, 0])
        own.append(np.array(times[SETTLED:])[:, 1])
    return _percentiles(elapsed[1:]), _percentiles(own[1:])


def _percentiles(times: list[Array]) -> dict[str, float]:
    p50, p99 = np.percentile(np.concatenate(times), [50, 99])
    return {"p50": round(float(p50), 4), "p99": round(float(p99), 4)}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def print_tracker_bench(result: dict[str, Any]) -> None:
    """The figures for people."""
    titles = {
        "simulated": "simulated arm",
        "simulated_high_five": "simulated high fives",
        "real": "real recording",
    }
    print("hidden for 300 ms at a time, distance from the true marker, rms, mm")
    for name, values in result["lost_marker_rms_mm"].items():
        print(f"  {titles[name]}")
        for method, value in sorted(values.items(), key=lambda item: item[1]):
            print(f"    {method.replace('_', ' '):<24}{value:8.1f}")
    joints = ", ".join(f"{name.replace('_', ' ')} {value:.2f}°" for name, value in result["joint_rms_deg"].items())
    print(f"joint angles without gaps, rms: {joints}")
    frame = result["frame_ms"]
    print(f"one frame, tracker and arm: p50 {frame['p50']:.3f} ms, p99 {frame['p99']:.3f} ms")
    for name in result["peers"]:
        print(f"  {name} {result['peers'][name]}: p50 {frame[name]['p50']:.3f} ms, p99 {frame[name]['p99']:.3f} ms")
    print("palm: largest jump, and frames until it is back")
    for name, row in result["robustness"]["by_fault"].items():
        print(f"    {name.replace('_', ' '):<24}{row['palm_jump_mm']:8.1f} mm {row['recovery_frames']:4d}")
    for key in ("peers_advice", "real_advice"):
        if key in result:
            print(result[key])

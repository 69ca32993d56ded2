"""How far off the synchronisation server is where the truth is known: other clocks, delays, clocks that are set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from highfive.hil.bench.sync_hosts import BEGAN_NS, EPOCH_NS, MS, WIRED, WIRELESS, Heard, Host, Network, S, heard
from highfive.hil.bench.sync_merged import ALONE, BOTH, followed
from highfive.hil.runtime.console import Bar
from highfive.hil.session.kinds import VECTORS
from highfive.hil.session.stream import Stream
from highfive.hil.session.sync_events import Happened, SyncEvent
from highfive.hil.session.synchroniser import Synchroniser
from highfive.hil.sim.people.capture import CLEAN
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.trials.partners import simulated_partner
from highfive.mocap_bridge.sources.ping_clock import PingClock
from highfive.mocap_bridge.sources.stamp_clock import StampClock
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

RIGHT_MS = 1.0
"""A step is found once the time of the stream is, and stays, so near the truth."""
STEPS = tuple((40.3 + 40.0 * k, 10.0 * (-1.0) ** k) for k in range(9))
"""When a clock is set, s, and by how much, ms: there and back."""
FOLLOWS_S = 5.0
"""A reset is of a step that was at most so long before."""
FIRST_S = 30.0
"""Of a stream, in which its line still has less to rest on than later."""
ASKED_HZ = 68.0
"""Of a renderer."""
BEHIND_MS = 30.0
"""By so much a moment lies back for which all streams have samples on both sides."""


@dataclass(frozen=True)
class SyncOptions:
    """What is run."""

    seed: int = 0
    seconds: float = 300.0
    long_s: float = 10_000.0


def bench_sync(options: SyncOptions, bar: Bar) -> dict[str, Any]:
    """For each scenario: error and bound of a stream's time, ms; how often it began anew; s until steps are found.

    The error is that of a frame's time beyond the least delay, which no clock sees from one side, of every frame from
    the first on. Three streams at one time: distance of each one's wrist from the true one, mm. Two systems on one
    person: distances of markers and tracked palm.

    Raises:
        HighFiveError: too short for anything to be found.
    """
    if options.seconds < 30.0 or options.long_s < 30.0:
        raise HighFiveError(f"{min(options.seconds, options.long_s):g} s are too short; expected 30 or more")

    def rng(part: int) -> np.random.Generator:
        return np.random.default_rng([options.seed, part])

    cases = (
        ("wired", Host(), WIRED, options.seconds),
        ("wireless", Host(), WIRELESS, options.seconds),
        ("second_host", Host(90.0, -80.0), WIRELESS, options.seconds),
        ("steps", Host(steps=STEPS), WIRELESS, 40.0 * (len(STEPS) + 1)),
        ("long", Host(), WIRELESS, options.long_s),
    )
    found: dict[str, Any] = {}
    done = bar("scenarios", len(cases) + 3)
    for part, (name, host, network, seconds) in enumerate(cases):
        found[name] = _one_way(host, network, heard(host, network, seconds, rng(part)))
        done()
    found["peer"] = _peer(options.seconds, rng(5))
    done()
    found["three_streams"] = _three_streams(options.seconds, options.seed, rng(6))
    done()
    found["two_systems"] = _two_systems(options.seed)
    done()
    return found


def _one_way(host: Host, network: Network, came: Heard) -> dict[str, Any]:
    """A stream that is known by its arrivals alone."""
    events = list[SyncEvent]()
    stream = Synchroniser(events.append).open("host", VECTORS, StampClock())
    nothing = np.zeros(1)
    errors, bounds, times = list[float](), list[float](), list[float]()
    least_ns, before = round(MS * network.least_ms), 0
    frames = zip(came.true.tolist(), came.stamps.tolist(), came.arrivals.tolist(), strict=True)
    for count, (true, stamp, arrival) in enumerate(frames):
        stream.add(stamp, nothing, arrival)
        time = stream.newest_ns or 0
        if time != before and count:
            errors.append((time - true - least_ns) / MS)
            bounds.append(min(stream.bound_ns, S) / MS)
            times.append((true - BEGAN_NS) / S)
        before = time
    resets = [(event.time_ns - BEGAN_NS) / S for event in events if event.happened is Happened.RESYNCHRONISED]
    wrong, missed = unmatched([when for when, _ in host.steps], resets)
    early = np.array(times) < FIRST_S
    return {
        **_of_errors(np.array(errors), np.array(bounds)),
        "first_half_minute": _of_errors(np.array(errors)[early], np.array(bounds)[early]),
        "resets": len(resets),
        "wrong_resets": wrong,
        "missed_steps": missed,
        "found_step_s": _found(host.steps, np.array(times), np.array(errors)),
        "seconds": round(times[-1] + 1.0 / host.rate_hz),
    }


def unmatched(steps: Sequence[float], resets: Sequence[float]) -> tuple[int, int]:
    """Resets that no step called for, and steps that no reset followed within :data:`FOLLOWS_S`; times in order, s."""
    left = list(resets)
    missed = 0
    for step in steps:
        mine = next((reset for reset in left if 0.0 <= reset - step <= FOLLOWS_S), None)
        if mine is None:
            missed += 1
        else:
            left.remove(mine)
    return len(left), missed


def _found(steps: tuple[tuple[float, float], ...], times: Array, errors: Array) -> float | None:
    """The longest that it took until the time was right again after a step, and stayed so until the next one, s."""
    longest, begins = None, [when for when, _ in steps]
    for when, until in pairwise([*begins, np.inf]):
        wrong = times[(times >= when) & (times < until) & (np.abs(errors) > RIGHT_MS)]
        longest = max(longest or 0.0, float(wrong.max() - when) if len(wrong) else 0.0)
    return None if longest is None else round(longest, 3)


def _peer(seconds: float, rng: np.random.Generator) -> dict[str, Any]:
    """A page that is asked eight times each two seconds, 64 ms apart, over a wireless network."""
    clock, errors, bounds = PingClock(), list[float](), list[float]()
    asked = (np.arange(0.0, seconds, 2.0)[:, None] + 0.064 * np.arange(8)).ravel()
    ways = 1e-3 * (WIRELESS.least_ms + rng.gamma(2.0, WIRELESS.gamma_ms, (2, len(asked))))
    ways += 1e-3 * np.where(rng.random(ways.shape) < WIRELESS.tail, 5.0 * rng.pareto(1.5, ways.shape), 0.0)
    for at, there, back in zip(asked, *ways, strict=True):
        true = BEGAN_NS + round(S * (at + there))
        stamp = EPOCH_NS + round(S * (at + there) * (1.0 + 50e-6))
        clock.update(BEGAN_NS + round(S * at), stamp, true + round(S * back))
        errors.append((clock.local(stamp) - true) / MS)
        bounds.append(min(clock.bound_ns(stamp), S) / MS)
    return {
        **_of_errors(np.array(errors), np.array(bounds)),
        "resets": clock.resets,
        "wrong_resets": clock.resets,
        "missed_steps": 0,
        "found_step_s": None,
        "seconds": round(seconds),
    }


def _of_errors(errors: Array, bounds: Array) -> dict[str, Any]:
    return {
        "error_ms": _spread(np.abs(errors), 4),
        "bound_ms": _spread(bounds, 3),
        "within_bound": round(float(np.mean(np.abs(errors) <= bounds)), 4),
    }


def _spread(values: Array, digits: int) -> dict[str, float]:
    p50, p95 = np.percentile(values, [50, 95]).tolist()
    return {"p50": round(p50, digits), "p95": round(p95, digits), "max": round(float(values.max()), digits)}


def _three_streams(seconds: float, seed: int, rng: np.random.Generator) -> dict[str, Any]:
    """Systems of 120, 90 and 60 Hz see one wrist; all are asked for one time at a renderer's rate.

    Each one's least delay is known, as a system says it or an event shows it.
    """
    truth = Wrist(seed)
    events = list[SyncEvent]()
    server, networks = Synchroniser(events.append), (WIRED, WIRELESS, WIRELESS)
    hosts = (Host(120.0, 50.0), Host(90.0, -80.0), Host(60.0, 20.0))
    streams = [server.open(f"{host.rate_hz:g} Hz", VECTORS, StampClock()) for host in hosts]
    sent = list[tuple[int, int, Stream[Array], Array, int, int]]()
    for host, network, stream in zip(hosts, networks, streams, strict=True):
        came = heard(host, network, seconds, rng)
        points, known = truth(1e-9 * (came.true - BEGAN_NS)), round(MS * network.least_ms)
        rows = zip(came.arrivals.tolist(), came.stamps.tolist(), points, came.true.tolist(), strict=True)
        sent += [(arrival, stamp, stream, point, known, true) for arrival, stamp, point, true in rows]
    sent.sort(key=lambda row: row[0])
    behind = {"now": 0, f"{BEHIND_MS:g} ms ago": round(MS * BEHIND_MS)}
    errors: dict[str, list[float]] = {name: [] for name in behind}
    off_ms = list[float]()
    invalid, row = 0, 0
    for at in np.arange(5.0, seconds, 1.0 / ASKED_HZ):
        now = BEGAN_NS + round(S * at)
        while row < len(sent) and sent[row][0] <= now:
            arrival, stamp, stream, point, known, made = sent[row]
            stream.add(stamp, point, arrival, latency_ns=known)
            off_ms.append(abs((stream.newest_ns or 0) - made) / MS)
            row += 1
        for name, back_ns in behind.items():
            moment = server.at(now - back_ns)
            true = truth(1e-9 * (now - back_ns - BEGAN_NS))
            for stream in streams:
                one = moment.of(stream)
                invalid += not one.valid
                if one.valid:
                    errors[name].append(1e3 * float(np.linalg.norm(one.value - true)))
    asked = sum(map(len, errors.values())) + invalid
    resets = sum(event.happened is Happened.RESYNCHRONISED for event in events)
    return {
        "error_ms": _spread(np.array(off_ms), 4),
        "resets": resets,
        "found_step_s": None,
        "wrist_error_mm": {name: _spread(np.array(values), 3) for name, values in errors.items()},
        "not_valid": round(invalid / asked, 5),
        "seconds": round(seconds),
    }


def _two_systems(seed: int) -> dict[str, Any]:
    """One person in each emotion before two systems that are merged, and before one that sees everything."""
    persons = [
        simulated_partner(emotion, "B2", 0, np.random.default_rng([seed, number]), CLEAN)
        for number, emotion in enumerate(EMOTIONS)
    ]
    found: dict[str, Any] = {}
    for name, address in (("merged", BOTH), ("one_system", ALONE)):
        runs = [followed(person, address, seed) for person in persons]
        figures = {
            "marker_error_mm": _spread(np.concatenate([run.markers_mm for run in runs]), 3),
            "palm_error_mm": _spread(np.concatenate([run.palm_mm for run in runs]), 3),
            "error_ms": _spread(np.concatenate([run.off_ms for run in runs]), 4),
            "resets": sum(run.resets for run in runs),
        }
        found[name] = figures
    both = {name: found["merged"][name] for name in ("error_ms", "resets")}
    return {**both, "found_step_s": None, **found}


class Wrist:
    """Where the wrist of a simulated person is, m, at times (N,), s: high fives, there and back, without a pause."""

    def __init__(self, seed: int) -> None:
        """Of one person from a seed."""
        person = simulated_partner("happy", "B2", 0, np.random.default_rng(seed), CLEAN)
        markers = [person.recording.names.index(name) for name in person.marker_set.arm.wrist]
        path = person.recording.points[:, markers].mean(axis=1)
        self._lasts = (len(path) - 1) / person.recording.rate_hz
        self._spline = CubicSpline(np.arange(len(path)) / person.recording.rate_hz, path)

    def __call__(self, seconds: Any) -> Array:
        """(N, 3) m."""
        turn = np.mod(seconds, 2.0 * self._lasts)
        return self._spline(np.minimum(turn, 2.0 * self._lasts - turn))


def _early(row: dict[str, Any]) -> str:
    return f"{100.0 * row['first_half_minute']['within_bound']:6.2f} %" if "first_half_minute" in row else "-"


def print_sync(result: dict[str, Any]) -> None:
    """The figures, for people."""
    print(
        "scenario        error p50 / p95 / max, ms    bound p50    within    anew (wrongly)    missed  step found    "
        "within, first 30 s"
    )
    for name, row in result.items():
        if name in ("three_streams", "two_systems"):
            continue
        error = " / ".join(f"{value:7.3f}" for value in row["error_ms"].values())
        step = "-" if row["found_step_s"] is None else f"{row['found_step_s']:.2f} s"
        anew = f"{row['resets']:>4} ({row['wrong_resets']})"
        print(
            f"{name:<12} {error}    {row['bound_ms']['p50']:6.3f} ms   {100.0 * row['within_bound']:6.2f} %  "
            f"{anew:<16}  {row['missed_steps']:>4}    {step:<10}    {_early(row)}"
        )
    for when, error in result["three_streams"]["wrist_error_mm"].items():
        shown = " / ".join(f"{value:.2f}" for value in error.values())
        print(f"three streams at one time, {when}: wrist {shown} mm from the true one (p50 / p95 / max)")
    for name in ("merged", "one_system"):
        row = result["two_systems"][name]
        shown = (row["marker_error_mm"], row["palm_error_mm"])
        marker, palm = (" / ".join(f"{value:.2f}" for value in one.values()) for one in shown)
        print(f"one person, {name.replace('_', ' ')}: markers {marker} mm, palm {palm} mm from the true ones")

"""What a long recording takes, and what is lost of one whose process is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.recorded_tick import RecordedTick, recorded_tick
from highfive.hil.recording.recorder import SessionRecorder, TrialHead
from highfive.hil.recording.recording import read_recording
from highfive.hil.runtime.console import Bar
from highfive.hil.session.session import PERIOD_NS, Session
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.trials.trial import run_trial
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model

KILLS = 5
"""Recordings whose process is killed, a quarter of a second later each."""

_RUN_S, _LATER_S = 3.0, 0.25
_MB = 1e6
_CHILD = "from highfive.hil.bench.recording import write_at_its_pace; import sys; write_at_its_pace(sys.argv[1])"


@dataclass(frozen=True)
class RecordingOptions:
    """So many hours of a session, by the recording's own clock, of the simulated person of a seed."""

    hours: float = 8.0
    seed: int = 0


def bench_recording(options: RecordingOptions, bar: Bar) -> dict[str, Any]:
    """Memory and disk of a long recording, and what a ``kill -9`` takes of one at its pace.

    The high five of one simulated person is recorded again and again, as fast as it goes, to no disk.

    Returns:
        ``hours``; ``memory_mb``, by how much the process has grown in them; ``mb_per_hour`` of the file;
        ``tick_ms``, what recording one takes; ``lost_s``, of :data:`KILLS` that were killed the largest time between
        the last tick that was given away and the last one that can be read.

    Raises:
        HighFiveError: no time is asked for.
    """
    if not options.hours > 0.0:
        raise HighFiveError(f"{options.hours:g} hours; ask for more than none")
    head, ticks = _high_five(options.seed)
    rounds = max(1, round(options.hours * 3.6e12 / (len(ticks) * PERIOD_NS)))
    recorder = SessionRecorder(Path(os.devnull), SessionSettings(options.seed, "bench", rounds))
    advance = bar("high fives", rounds)
    _record(recorder, head, ticks, 0)
    before, begun = _memory_mb(), time.process_time()
    for number in range(1, rounds):
        _record(recorder, head, ticks, number)
        advance()
    took = time.process_time() - begun
    advance()
    return {
        "hours": options.hours,
        "memory_mb": round(_memory_mb() - before, 1),
        "mb_per_hour": round(recorder.written / _MB / (rounds * len(ticks) * PERIOD_NS / 3.6e12), 1),
        "tick_ms": round(1e3 * took / max(1, (rounds - 1) * len(ticks)), 3),
        "lost_s": round(max(_lost(number, bar("kills", KILLS)) for number in range(KILLS)), 3),
    }


def write_at_its_pace(path: str) -> None:
    """Records a session at 120 Hz until it is killed; says the time of each tick, ns, once it was given away."""
    head, ticks = _high_five(0)
    recorder = BackgroundRecorder(SessionRecorder(Path(path), SessionSettings(0, "bench", 1)), paced=True)
    recorder.begin_trial(head)
    begun = time.monotonic_ns()
    for number, tick in enumerate(_for_ever(ticks)):
        left = begun + number * PERIOD_NS - time.monotonic_ns()
        time.sleep(max(0.0, 1e-9 * left))
        recorder.record_tick(tick)
        print(tick.at_ns, flush=True)


def print_recording(result: dict[str, Any]) -> None:
    """The figures, for people."""
    print(f"{result['hours']:g} hours: {result['mb_per_hour']:.0f} MB an hour, {result['tick_ms']:.2f} ms a tick")
    print(f"the process grew by {result['memory_mb']:.0f} MB")
    print(f"killed: at most {result['lost_s']:.2f} s are lost")


def _lost(number: int, advance: Any) -> float:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "killed.mcap"
        with subprocess.Popen([sys.executable, "-c", _CHILD, str(path)], stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            first = last = int(child.stdout.readline())
            while last - first < 1e9 * (_RUN_S + number * _LATER_S):
                last = int(child.stdout.readline())
            child.send_signal(signal.SIGKILL)
            rest = child.stdout.read().split()
        last = int(rest[-1]) if rest else last
        ticks = read_recording(path).channels["/tick"]
    advance()
    return 1e-9 * (last - int(ticks[-1].data["at_ns"]))


def _high_five(seed: int) -> tuple[TrialHead, list[RecordedTick]]:
    partner: Partner = simulated_partners(1, ("neutral",), ("B2",), seed)[0]
    scene = build_scene()
    session = Session(load_model(DEFAULT_MODEL), {"neutral": 1.0}, partner.marker_set, scene)
    ticks: list[RecordedTick] = []
    run_trial(
        0, partner, session, KinematicPlayOut(scene),
        keep=lambda begins, tick, state, ms: ticks.append(recorded_tick(begins, tick, state.pose, ms)),
    )  # fmt: skip
    return TrialHead(0, partner, "neutral", {"neutral": 1.0}), ticks


def _record(recorder: SessionRecorder, head: TrialHead, ticks: list[RecordedTick], number: int) -> None:
    recorder.begin_trial(replace(head, number=number))
    for tick in ticks:
        recorder.record_tick(tick)


def _for_ever(ticks: list[RecordedTick]) -> Iterator[RecordedTick]:
    number = 0
    while True:
        for tick in ticks:
            yield replace(tick, at_ns=number * PERIOD_NS)
            number += 1


def _memory_mb() -> float:
    """What this process holds in memory."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / _MB

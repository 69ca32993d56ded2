"""A long session with the emulated rig in virtual time: cycles that were missed, laws, and what computing it took."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from itertools import cycle
from typing import Any

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.arm_trial import ArmTrial, arm_summary, played_until_stopped
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.fault_laws import judge_body, judge_commands
from highfive.hil.bench.laws import Laws
from highfive.hil.bench.retarget import reference_trajectories
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trained import HGPDM

SHORTEST_MIN = 0.1
SHORTEST_S = 5.0
"""A high five with the way back takes no less."""

LOOKED_ON_NS = 500_000_000
"""After each high five, for the body to stand."""

_FIGURES = ("trials", "cycles", "missed_cycles", "unanswered", "period_jitter_ms", "error_mm")


@dataclass(frozen=True)
class LongSessionOptions:
    """What is played.

    Attributes:
        minutes: of virtual time, from when the arm is ready; the high five that is on is played to its end.
        seed: of the people, who come again and again.
    """

    minutes: float = 10.0
    seed: int = 0


def bench_long_session(options: LongSessionOptions, model: HGPDM, bar: Bar) -> dict[str, Any]:
    """Plays one high five after the other with one arm.

    Returns:
        ``minutes`` of virtual time and ``computing_min`` of the processor; ``trials``, ``cycles``, ``missed_cycles``,
        ``unanswered``, ``period_jitter_ms`` and ``error_mm`` of :func:`highfive.hil.arm.arm_trial.arm_summary`;
        ``worst`` and ``broken`` as of :func:`highfive.hil.bench.faults.bench_faults`; ``stopped``: why it ended early,
        '' if it did not.

    Raises:
        HighFiveError: the time is too short.
    """
    if not options.minutes >= SHORTEST_MIN:
        raise HighFiveError(f"a session of {options.minutes:g} minutes; ask for {SHORTEST_MIN:g} at least")
    cells = CELLS[: max(1, math.ceil(60.0 * options.minutes / (SHORTEST_S * len(EMOTIONS))))]  # no more than are met
    references = reference_trajectories(model, tuple(EMOTIONS), cells, options.seed, bar)
    rig, limits, planner, laws = load_rig(), load_limits(), default_planner(), Laws()
    trials: list[ArmTrial] = []
    advance = bar("seconds", round(60.0 * options.minutes))
    began = time.process_time()
    with VirtualClock(options.seed) as clock:
        box = BlackBox(bus := make_bus(emulator_options(ArmOptions())), rig)
        with virtual_arm(VirtualRig(clock, bus, box.look), retarget=planner) as loop:
            start, shown = clock.now(), 0
            end = start + round(60e9 * options.minutes)
            for reference in cycle(references):
                trial = played_until_stopped(reference, loop)
                clock.wait_until(clock.now() + LOOKED_ON_NS)
                judge_body(laws, box, limits)
                box.clear()
                if trial is not None:
                    judge_commands(laws, trial, limits, planner.arm)
                    trials.append(trial)
                seconds = min(round(1e-9 * (clock.now() - start)), round(60.0 * options.minutes))
                for _ in range(seconds - shown):
                    advance()
                shown = seconds
                if loop.trouble or clock.now() >= end:
                    break
            minutes, stopped = (clock.now() - start) / 60e9, loop.trouble
    computing = time.process_time() - began
    summary = arm_summary(trials, planner.settings.lag)
    return {
        "minutes": round(minutes, 2),
        "computing_min": round(computing / 60.0, 2),
        **{name: summary[name] for name in _FIGURES},
        "worst": {law: round(value, 4) for law, value in sorted(laws.worst.items())},
        "broken": [{"law": law, "value": value} for law, value in laws.broken],
        "stopped": stopped,
    }


def print_long_session(result: dict[str, Any]) -> None:
    """The figures, for people."""
    print(f"{result['minutes']:g} minutes with the emulated rig, computed in {result['computing_min']:g}")
    stopped = f", stopped: {result['stopped']}" if result["stopped"] else ""
    error, jitter = result["error_mm"], result["period_jitter_ms"]
    print(f"  high fives             {result['trials']}{stopped}; plate to palm {error['median']} / {error['max']} mm")
    missed, cut = result["missed_cycles"], result["unanswered"]
    print(f"  cycles of the bus      {result['cycles']}, {missed} missed, {cut} not whole")
    print(f"  off their period, ms   {jitter['p50']:g} / {jitter['p99']:g} / {jitter['max']:g} (p50 / p99 / worst)")
    for law, value in result["worst"].items():
        print(f"  {law:<52}{value:>10.4g}")
    for one in result["broken"]:
        print(f"  BROKEN: {one['law']}: {one['value']:.4g}")

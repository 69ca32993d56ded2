"""A long session with the emulated rig in virtual time: cycles that were missed, laws, and what computing it took."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np

from highfive.hil.arm.arm_figures import ArmFigures, arm_figures, arm_summary
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.arm_trial import MISSED, percentiles, played_until_stopped
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.fault_laws import judge_body, judge_commands
from highfive.hil.bench.laws import Laws
from highfive.hil.bench.motion_laws import judge_body_motion
from highfive.hil.bench.retarget import reference_trajectories
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.drivers.bus.arm_host import ArmHost
from highfive.hil.drivers.bus.cycle_ring import Cycle, Mode
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.session.session import RATE_HZ
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trained import HGPDM

SHORTEST_MIN = 0.1
SHORTEST_S = 5.0
"""A high five with the way back takes no less."""

LOOKED_ON_NS = 500_000_000
"""After each high five, for the body to stand."""

_COUNTED_NS = 2_000_000_000  # between two looks at the ring, which holds a minute
_PERIOD_NS = 1e9 / RATE_HZ


class DriverCycles:
    """Every cycle of a driver from its first to its last, in a high five, on the way back or between two."""

    def __init__(self, arm: ArmHost) -> None:
        """Of ``arm``; :meth:`count` is to be called more often than the ring is full."""
        self._arm = arm
        self._last: Cycle | None = None
        self._gaps: list[tuple[float, bool]] = []  # ns, and whether the arm was driven, or only held
        self.cycles = self.lost = self.unanswered = 0

    def count(self) -> None:
        """Those that are new."""
        last = self._last
        for one in self._arm.cycles(0 if last is None else last.number + 1):
            self.cycles += 1
            self.unanswered += not one.state.answered.all()
            if last is not None:
                self.lost += one.number - last.number - 1
                self._gaps.append((one.begun_ns - last.begun_ns, Mode.DRIVING in (last.mode, one.mode)))
            last = one
        self._last = last

    def figures(self, begun: int) -> dict[str, Any]:
        """What :func:`bench_long_session` says of cycles; ``begun`` high fives, of which each may pause once."""
        gaps = np.array([gap for gap, _ in self._gaps])
        driven = np.array([driven for _, driven in self._gaps], dtype=bool)
        wide = gaps > MISSED * _PERIOD_NS
        pauses = gaps[wide & ~driven]
        missed = int((wide & driven).sum()) + max(0, len(pauses) - begun) + self.lost
        return {
            "cycles": self.cycles,
            "missed_cycles": missed,
            "unanswered": self.unanswered,
            "pauses": {"count": len(pauses), "max_ms": round(1e-6 * float(pauses.max(initial=0.0)), 1)},
            "period_jitter_ms": percentiles(1e-6 * np.abs(gaps[~wide] - _PERIOD_NS)),
        }


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
        ``minutes`` of virtual time and ``computing_min`` of the processor; ``trials`` and ``error_mm`` of
        :func:`highfive.hil.arm.arm_figures.arm_summary`; of all cycles of the driver, from its first to its last:
        ``cycles``, ``missed_cycles``, ``unanswered``, ``period_jitter_ms``; ``pauses``, ``count`` and ``max_ms``:
        before a high five everything is read back from an arm that holds, in one long cycle, which is not missed;
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
    trials: list[ArmFigures] = []
    advance = bar("seconds", round(60.0 * options.minutes))
    began = time.process_time()
    with VirtualClock(options.seed) as clock:
        box = BlackBox(bus := make_bus(emulator_options(ArmOptions())), rig)
        virtual = VirtualRig(clock, bus, box.look)
        with virtual_arm(virtual, retarget=planner) as loop:
            assert virtual.arm is not None
            counted, begun = DriverCycles(virtual.arm), 0
            clock.start("counting", lambda: _counting(clock, counted))
            start, shown = clock.now(), 0
            end = start + round(60e9 * options.minutes)
            for reference in cycle(references):
                begun += 1
                trial = played_until_stopped(reference, loop)
                clock.wait_until(clock.now() + LOOKED_ON_NS)
                judge_body(laws, box, limits)
                if trial is not None:
                    judge_commands(laws, trial, limits, planner.arm)
                    judge_body_motion(laws, trial, box, limits, planner.arm, box.times[-1])
                    trials.append(arm_figures(len(trials), trial, planner, limits))
                box.clear()
                seconds = min(round(1e-9 * (clock.now() - start)), round(60.0 * options.minutes))
                for _ in range(seconds - shown):
                    advance()
                shown = seconds
                if loop.trouble or clock.now() >= end:
                    break
            minutes, stopped = (clock.now() - start) / 60e9, loop.trouble
        counted.count()
    computing = time.process_time() - began
    summary = arm_summary(trials, planner)
    return {
        "minutes": round(minutes, 2),
        "computing_min": round(computing / 60.0, 2),
        "trials": summary["trials"],
        "error_mm": summary["error_mm"],
        **counted.figures(begun),
        "worst": {law: round(value, 4) for law, value in sorted(laws.worst.items())},
        "broken": [{"law": law, "value": value} for law, value in laws.broken],
        "stopped": stopped,
    }


def _counting(clock: VirtualClock, counted: DriverCycles) -> None:
    while True:
        clock.wait_until(clock.now() + _COUNTED_NS)
        counted.count()


def print_long_session(result: dict[str, Any]) -> None:
    """The figures, for people."""
    print(f"{result['minutes']:g} minutes with the emulated rig, computed in {result['computing_min']:g}")
    stopped = f", stopped: {result['stopped']}" if result["stopped"] else ""
    error, jitter = result["error_mm"], result["period_jitter_ms"]
    print(f"  high fives             {result['trials']}{stopped}; plate to palm {error['median']} / {error['max']} mm")
    missed, cut = result["missed_cycles"], result["unanswered"]
    print(f"  cycles of the bus      {result['cycles']}, {missed} missed, {cut} not whole")
    pauses = result["pauses"]
    print(f"  all read back          {pauses['count']} times between cycles, {pauses['max_ms']:g} ms at most")
    print(f"  off their period, ms   {jitter['p50']:g} / {jitter['p99']:g} / {jitter['max']:g} (p50 / p99 / worst)")
    for law, value in result["worst"].items():
        print(f"  {law:<52}{value:>10.4g}")
    for one in result["broken"]:
        print(f"  BROKEN: {one['law']}: {one['value']:.4g}")

"""Schedules of faults, each from a seed, against the laws that the arm keeps (deterministic simulation)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from highfive.hil.bench.fault_run import FaultJob, run_schedule
from highfive.hil.bench.fault_schedule import DEATHS, drawn
from highfive.hil.bench.fault_times import ESTOP, HOLD, LAST_GOAL, UNSEEN, WATCHDOG
from highfive.hil.bench.laws import judged_in, largest
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.trials.partners import simulated_partners
from highfive.model.errors import HighFiveError

PARTNERS = (("neutral", "happy", "angry", "sad"), ("A2", "B1", "C1", "C2"))
"""Emotions and cells of whom the schedules meet; in the last two the arm comes near a head."""

PEOPLE_SEED = 0


@dataclass(frozen=True)
class FaultsOptions:
    """What is run.

    Attributes:
        seeds: number of schedules.
        first: seed of the first one; to replay one, its seed, and ``seeds`` 1.
    """

    seeds: int = 1000
    first: int = 0


def bench_faults(options: FaultsOptions, bar: Bar) -> dict[str, Any]:
    """Runs the schedules.

    Returns:
        ``schedules``; ``broken``: ``law``, ``seed``, ``value``, ``schedule`` and what was ``said``; ``worst``: law →
        value; ``judged``: law → number of schedules in which it was. The worst of some laws by themselves, None where
        none of them was judged: ``estop_ms``, from an emergency stop to the last goal; ``watchdog_ms``, from the death
        of host, driver or both to the servos' own stop; ``last_goal_ms``, from such a death to the last goal;
        ``hold_ms``, from when nobody leads the arm to the last goal, or to the hold.

    Raises:
        HighFiveError: no schedule is asked for.
    """
    if options.seeds < 1:
        raise HighFiveError(f"{options.seeds} schedules; ask for at least one")
    emotions, cells = PARTNERS
    count = len(emotions) * len(cells)
    partners = simulated_partners(count, emotions, cells, PEOPLE_SEED, lambda total: bar("people", total))
    schedules = [drawn(options.first + number, count) for number in range(options.seeds)]
    jobs = [FaultJob(schedule, partners[schedule.trial]) for schedule in schedules]
    broken: list[dict[str, Any]] = []
    worst: list[dict[str, float]] = []
    for job, (laws, said) in zip(
        jobs, parallel_map(run_schedule, jobs, lambda total: bar("schedules", total)), strict=True
    ):
        worst.append(laws.worst)
        broken += [
            {"law": law, "seed": job.schedule.seed, "value": value, "schedule": str(job.schedule), "said": list(said)}
            for law, value in laws.broken
        ]
    found = {law: round(value, 4) for law, value in sorted(largest(worst).items())}

    def worst_of(*laws: str) -> float | None:
        return max((found[law] for law in laws if law in found), default=None)

    return {
        "schedules": len(jobs),
        "broken": broken,
        "worst": found,
        "judged": dict(sorted(judged_in(worst).items())),
        "estop_ms": worst_of(ESTOP),
        "watchdog_ms": worst_of(*(WATCHDOG.format(kind) for kind in DEATHS)),
        "last_goal_ms": worst_of(*(LAST_GOAL.format(kind) for kind in DEATHS)),
        "hold_ms": worst_of(HOLD, UNSEEN),
    }


def print_faults(result: dict[str, Any]) -> None:
    """The laws and their worst values, for people."""
    print(f"{result['schedules']} schedules of faults, {len(result['broken'])} laws broken")
    for law, value in result["worst"].items():
        print(f"  {law:<52}{value:>10.4g}   judged in {result['judged'][law]}")
    for one in result["broken"]:
        print(f"  BROKEN: {one['law']}: {one['value']:.4g} ({one['schedule']}; said: {'; '.join(one['said']) or '-'})")
    if result["broken"]:
        print(f"replay one with: highfive bench faults --seeds 1 --first {result['broken'][0]['seed']}")

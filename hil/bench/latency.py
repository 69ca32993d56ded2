"""What input latency costs, and what is left of that where the person is predicted over it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from highfive.hil.bench.live_people import LiveJob, System, check_cells, figures, people, play, shown_pair
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.model.errors import HighFiveError

LATENCIES_MS = (0.0, 10.0, 20.0, 40.0)


@dataclass(frozen=True)
class LatencyOptions:
    """What is played: every emotion at these cells, with each latency, once reported by the system and once not."""

    latencies_ms: tuple[float, ...] = LATENCIES_MS
    cells: tuple[str, ...] = CELLS
    seed: int = 0


def bench_latency(options: LatencyOptions, bar: Bar) -> dict[str, Any]:
    """For each input latency ``with`` compensation and ``without``: what the person would feel, at 120 Hz.

    Raises:
        HighFiveError: a latency is negative, or an unknown cell.
    """
    for latency in options.latencies_ms:
        if not 0.0 <= latency <= 500.0:
            raise HighFiveError(f"a latency of {latency:g} ms; expected 0 to 500")
    check_cells(options.cells)
    persons = people(tuple(EMOTIONS), options.cells, options.seed, bar)
    cases = [(latency, reported) for latency in options.latencies_ms for reported in (True, False)]
    jobs = [
        LiveJob(person, System(latency_ms=latency, reported_ms=latency if reported else 0.0), options.seed + number)
        for latency, reported in cases
        for number, person in enumerate(persons)
    ]
    felt = list(parallel_map(play, jobs, lambda total: bar("high fives", total)))
    count, found = len(persons), dict[str, Any]()
    for number, (latency, reported) in enumerate(cases):
        row = figures(felt[number * count : (number + 1) * count])
        found.setdefault(f"{latency:g}", {})["with" if reported else "without"] = row
    return found


def print_latency(result: dict[str, Any]) -> None:
    """The figures, for people."""
    print("input latency    palm to true palm, compensated    speed off    not compensated      speed off")
    for latency, row in result.items():
        cells = [
            f"{shown_pair(one['contact_error_mm'], 'mm', 2)} ({one['touched']} of {one['trials']})   {_speed(one)}"
            for one in (row["with"], row["without"])
        ]
        print(f"{latency:>10} ms    {cells[0]:<46}{cells[1]}")
    print("speed off: the palm's as tracked and predicted, of its own, root mean square over single ticks")


def _speed(row: dict[str, Any]) -> str:
    return "     -" if row["palm_speed_rms"] is None else f"{100.0 * row['palm_speed_rms']:4.1f} %"

"""Live systems of 30 to 500 Hz: do palms meet as they do at 120 Hz?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from highfive.hil.bench.contact import contact_figures
from highfive.hil.bench.live_people import LiveFelt, LiveJob, System, check_cells, figures, people, play, shown_pair
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import parallel_map
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.model.errors import HighFiveError

RATES = (30.0, 50.0, 60.0, 90.0, 100.0, 120.0, 200.0, 240.0, 500.0)
USUAL = 120.0
"""Hz, of training and of most systems: what the others are compared with, person by person."""

LEAST_MS, DELAY_MS, DROP, DRIFT_PPM = 1.0, 0.5, 0.01, 100.0
"""Least delay, mean of the exponential one on top, share of lost frames, and by how much its clock is fast."""


@dataclass(frozen=True)
class RatesOptions:
    """What is played: every emotion at these cells, at each rate; and whether the twin of the arm plays too."""

    rates: tuple[float, ...] = RATES
    cells: tuple[str, ...] = CELLS
    seed: int = 0
    twin: bool = False


def bench_rates(options: RatesOptions, bar: Bar) -> dict[str, Any]:
    """For each rate: palm to true palm at first touch, when that was beside the person's own, and the palm's speed.

    Delays, lost frames and a drifting clock are on at all rates; what is shown is judged at the time at which it is.

    Raises:
        HighFiveError: a rate is not positive, or an unknown cell.
    """
    for rate in options.rates:
        if not 0.0 < rate <= 2000.0:
            raise HighFiveError(f"a rate of {rate:g} Hz; expected more than 0 and at most 2000")
    check_cells(options.cells)
    persons = people(tuple(EMOTIONS), options.cells, options.seed, bar)
    jobs = [
        LiveJob(
            person,
            System(rate, latency_ms=LEAST_MS, delay_ms=DELAY_MS, drop=DROP, drift_ppm=DRIFT_PPM),
            options.seed + number,
            options.twin,
        )
        for rate in options.rates
        for number, person in enumerate(persons)
    ]
    felt = list(parallel_map(play, jobs, lambda total: bar("high fives", total)))
    count = len(persons)
    rows = [felt[i * count : (i + 1) * count] for i in range(len(options.rates))]
    usual = rows[options.rates.index(USUAL)] if USUAL in options.rates else None
    return {
        f"{rate:g}": figures(row) | ({} if usual is None else {"paired": _paired(row, usual)}) | _of_twin(row)
        for rate, row in zip(options.rates, rows, strict=True)
    }


def _paired(felt: Sequence[LiveFelt], usual: Sequence[LiveFelt]) -> dict[str, float | None]:
    """Median of what the same people are met worse than at the usual rate. The spread between people is not in it,
    which makes a median of 36 of them uncertain by a tenth."""
    both = [(one, other) for one, other in zip(felt, usual, strict=True) if one.touched and other.touched]
    if not both:
        return {"contact_error_mm": None, "time_error_ms": None}
    errors = [one.error - other.error for one, other in both]
    times = [abs(one.time_error) - abs(other.time_error) for one, other in both]
    return {
        "contact_error_mm": round(1e3 * float(np.median(errors)), 2),
        "time_error_ms": round(1e3 * float(np.median(times)), 1),
    }


def _of_twin(felt: Sequence[LiveFelt]) -> dict[str, Any]:
    """As ``bench contact`` gives them, and why the twin was stopped; nothing where it did not play."""
    played = [one.arm for one in felt if one.arm is not None]
    if not played:
        return {}
    return {"twin": contact_figures([met for met, _ in played]) | {"stopped": [why for _, why in played if why]}}


def print_rates(result: dict[str, Any]) -> None:
    """The figures, for people."""
    print("rate    touched    palm to true palm    time of contact     palm speed, and in a tick     beside 120 Hz")
    for rate, row in result.items():
        speed, single = (
            "   -" if row[name] is None else f"{100.0 * row[name]:4.1f} %"
            for name in ("palm_speed_error", "palm_speed_rms")
        )
        print(
            f"{rate:>4} Hz  {row['touched']:>3} of {row['trials']:<3}  {shown_pair(row['contact_error_mm'], 'mm', 2)}"
            f"      {shown_pair(row['time_error_ms'], 'ms', 1)}    {speed} / {single}{_shown_paired(row)}"
        )
    for rate, row in result.items():
        if twin := row.get("twin"):
            print(
                f"{rate:>4} Hz  twin: plate to tracked palm {shown_pair(twin['error_mm'], 'mm', 2)}, "
                f"{twin['time_error_median_ms']} ms, {len(twin['missed'])} missed, {len(twin['unreachable'])} not "
                f"possible, {len(twin['stopped'])} stopped"
            )


def _shown_paired(row: dict[str, Any]) -> str:
    """How much worse than at the usual rate, for people; '' where that was not played."""
    paired = row.get("paired")
    if paired is None or paired["contact_error_mm"] is None:
        return ""
    return f"    {paired['contact_error_mm']:+.2f} mm, {paired['time_error_ms']:+.1f} ms"

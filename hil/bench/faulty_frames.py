"""A recording's frames as a motion capture system in trouble would send them, in virtual time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from highfive.hil.bench.fault_schedule import FaultSchedule
from highfive.hil.runtime.clock import Clock
from highfive.mocap_bridge.frames import MarkerFrame


def faulty_frames(
    frames: Sequence[MarkerFrame], due_ns: Sequence[int], schedule: FaultSchedule, clock: Clock
) -> Iterator[MarkerFrame]:
    """The frames from now on, each at its time, with what the schedule has happen to them.

    Args:
        frames: of a recording.
        due_ns: when each comes, ns from now.
        schedule: times count from now.
        clock: that they come by.
    """
    begun, rng = clock.now(), np.random.default_rng((schedule.seed, 1))
    pairs = {it: rng.choice(len(frames[0].names), 2, replace=False) for it in schedule.happenings}
    for frame, due in zip(frames, due_ns, strict=True):
        time_s, stamp = 1e-9 * due, frame.source_time_ns
        positions, valid, lost, late_ns = frame.positions, frame.valid, False, due
        for it in schedule.happenings:
            if it.kind == "clock jump" and time_s >= it.at_s:
                stamp += round(1e9 * it.amount)
            if not it.at_s <= time_s < it.at_s + it.lasts_s:
                continue
            if it.kind == "stall":
                lost = True
            elif it.kind == "burst":
                late_ns = max(late_ns, round(1e9 * (it.at_s + it.lasts_s)))
            elif it.kind == "occlusion":
                valid = np.zeros_like(valid)
            elif it.kind == "drop":
                lost = lost or rng.random() < it.amount
            elif it.kind == "swap":
                positions, valid = _exchanged(positions, pairs[it]), _exchanged(valid, pairs[it])
            elif it.kind == "ghost":
                positions = positions.copy()
                positions[pairs[it][0]] += rng.normal(0.0, it.amount, 3)
        if lost:
            continue
        clock.wait_until(begun + late_ns)
        yield replace(
            frame, positions=positions, valid=valid, source_time_ns=max(stamp, 0), arrival_time_ns=clock.now()
        )


def _exchanged(rows: np.ndarray, pair: np.ndarray) -> np.ndarray:
    found = rows.copy()
    found[pair] = rows[pair[::-1]]
    return found

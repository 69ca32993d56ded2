"""How long the emulated rig takes to stop, at every phase of the driver's cycle; exact, in virtual time."""

import numpy as np
import pytest

from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.bench.safety_times import (
    Happening,
    dead_servo_ms,
    hold_ms,
    kill_both,
    kill_host,
    pull,
    stall_host,
    stopped_by,
)
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.drivers.bus.cycle_ring import Mode

PHASES = np.arange(12) / 12
AT_HAND = 40
"""Ticks before the palms meet: the arm is on its way then."""


@pytest.mark.parametrize(
    ("happening", "changed_ms", "stood_ms", "mode", "trips"),
    [
        # The driver's next look is half a ms away at most, and the hold takes one cycle.
        (pull, 20.0, 120.0, Mode.STOPPED, 0),
        # A host that is silent for 50 ms is held where the arm is; one that is gone is found out in the same time.
        (stall_host, 100.0, 180.0, Mode.HOLDING, 0),
        (kill_host, 100.0, 180.0, None, None),
        # Nobody is left but the servos' own watchdogs: 80 ms.
        (kill_both, 100.0, 180.0, None, 8),
    ],
)
def test_who_falls_silent_or_pulls_stops_the_arm_in_time_at_every_phase(
    happening: Happening, changed_ms: float, stood_ms: float, mode: Mode | None, trips: int | None
) -> None:
    found = [stopped_by(happening, phase) for phase in PHASES]
    assert max(one.changed_ms for one in found) <= changed_ms, found
    assert max(one.stood_ms for one in found) <= stood_ms, found
    assert mode is None or {one.mode for one in found} == {mode}
    assert trips is None or {one.trips for one in found} == {trips}


def test_a_dead_servo_is_found_out_in_time_at_every_phase(reference: ReferenceTrajectory) -> None:
    tick = reference.due - AT_HAND
    times = [dead_servo_ms(reference, default_planner(), tick, phase) for phase in PHASES[::3]]
    assert max(times) <= 50.0, times


def test_an_arm_whose_person_is_not_measured_any_more_is_held_in_time_at_every_phase(
    reference: ReferenceTrajectory,
) -> None:
    tick = reference.due - AT_HAND
    times = [hold_ms(reference, default_planner(), tick, phase) for phase in PHASES[::3]]
    assert min(times) > 50.0 and max(times) <= 100.0, times

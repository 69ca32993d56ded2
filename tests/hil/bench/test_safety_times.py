"""How long the emulated rig takes to stop, at every phase of the driver's cycle; exact, in virtual time.

Each sweep is run whole where it is marked slow, and with a few cases, spread over it, everywhere else.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
import pytest
from forked import forked

from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.bench.safety_times import (
    ENGAGING,
    Begun,
    Happening,
    Stopped,
    high_five_at,
    kill_both,
    kill_host,
    pull,
    stall_host,
    stopped_by,
)
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.drivers.bus.cycle_ring import Mode
from highfive.hil.drivers.bus.rig import load_rig

PHASES = np.arange(12) / 12
SERVOS = tuple(load_rig().servos)

FIRST, AT_HAND, NEAR_CONTACT = 1, 40, 3
"""The tick in which the arm has just begun to follow; and ticks before the palms meet: the arm is on its way, and all
but there."""

ESTOP_MS, SILENT_MS, DEAD_SERVO_MS, HOLD_MS = 20.0, 100.0, 50.0, 100.0
STANDS_MS = 240.0
"""The body stands before the look at it ends."""

STAYS = 4 * 2 * np.pi / 4096
"""rad: four counts of a servo; so little a limp arm sags by, or one that is just held, and nothing makes it jump."""

# The driver's next look is half a ms away at most, and the hold takes one cycle. A host that is silent for 50 ms is
# held where the arm is; one that is gone is found out in the same time. Where both are gone nobody is left but the
# servos' own watchdogs: 80 ms. A servo is dead that has not answered for 42 ms, which the next tick finds out.
BOUNDS = {pull: ESTOP_MS, stall_host: SILENT_MS, kill_host: SILENT_MS, kill_both: SILENT_MS}


def tell(what: str, times: Sequence[float]) -> float:
    """The worst, which is also said."""
    print(f"{what}: {min(times):.1f} to {max(times):.1f} ms, {len(times)} cases")
    return max(times)


@pytest.mark.slow
@pytest.mark.parametrize("phases", [PHASES[1::3], pytest.param(PHASES, marks=pytest.mark.slow)], ids=["some", "all"])
@pytest.mark.parametrize(
    ("happening", "stood_ms", "mode", "trips"),
    [
        (pull, 120.0, Mode.STOPPED, 0),
        (stall_host, 180.0, Mode.HOLDING, 0),
        (kill_host, 180.0, None, None),
        (kill_both, 180.0, None, len(SERVOS)),
    ],
)
def test_who_falls_silent_or_pulls_stops_the_arm_in_time_at_every_phase(
    happening: Happening, stood_ms: float, mode: Mode | None, trips: int | None, phases: Sequence[float]
) -> None:
    found = [stopped_by(happening, phase) for phase in phases]
    assert 0.0 < tell(happening.__name__, [one.changed_ms for one in found]) <= BOUNDS[happening], found
    assert max(one.stood_ms for one in found) <= stood_ms, found
    assert mode is None or {one.mode for one in found} == {mode}
    assert trips is None or {one.trips for one in found} == {trips}


def stopped(begun: Begun, happening: Happening, phase: float) -> Stopped:
    """In a copy, with which the memory of the emergency stop is shared."""
    assert begun.virtual.arm is not None
    try:
        return forked(partial(begun.stopped, happening, phase))
    finally:
        begun.virtual.arm.estop.let_go()


def stop_in_time(begun: Begun, happening: Happening, tick: int, phases: Sequence[float]) -> None:
    """The bounds, in that tick at those phases."""
    found = [stopped(begun, happening, phase) for phase in phases]
    # A driver whose host dies while it switches servos on does so to the end, and they hold; watchdogs that trip after
    # that make goals of where the joints stand.
    own = tick == ENGAGING and happening is kill_host
    times = [one.commanded_ms if own else one.changed_ms for one in found]
    if tick == ENGAGING:
        assert max(one.moved for one in found) <= STAYS, found
        lives = happening in (pull, stall_host)  # the driver does, and holds or stops the arm by itself
        assert {one.trips for one in found} == ({0} if lives else {0, len(SERVOS)}), found
        assert happening is not kill_both or max(times) > 60.0, "by the servos' own watchdogs"
    assert tell(f"{happening.__name__} in tick {tick}", times) <= BOUNDS[happening], found
    assert tell("  the body stands", [one.stood_ms for one in found]) <= STANDS_MS, found


def ticks(reference: ReferenceTrajectory) -> tuple[int, ...]:
    """Engaging, just following, on the way, and near contact."""
    return ENGAGING, FIRST, reference.due - AT_HAND, reference.due - NEAR_CONTACT


@pytest.mark.slow
def test_it_stops_the_arm_in_time_in_a_high_five_too(reference: ReferenceTrajectory) -> None:
    for number, tick in enumerate(ticks(reference)):
        # Of the instants of switching on one in which the arm is limp, and one in which it is held.
        phases = PHASES[2::6] if tick == ENGAGING else PHASES[2 + 3 * number :: 12]
        with high_five_at(reference, default_planner(), tick) as begun:
            for happening in BOUNDS:
                stop_in_time(begun, happening, tick, phases)


@pytest.mark.slow(20)
def test_it_stops_the_arm_in_time_in_every_tick_at_every_phase(reference: ReferenceTrajectory) -> None:
    for tick in ticks(reference):
        with high_five_at(reference, default_planner(), tick) as begun:
            for happening in BOUNDS:
                stop_in_time(begun, happening, tick, PHASES)


@pytest.mark.slow
def test_each_dead_servo_is_found_out_in_time(reference: ReferenceTrajectory) -> None:
    phases = np.arange(len(SERVOS)) / len(SERVOS)
    with high_five_at(reference, default_planner(), reference.due // 2) as begun:
        times = [forked(partial(begun.dead_servo_ms, *case)) for case in zip(phases, SERVOS, strict=True)]
    assert tell("dead servo", times) <= DEAD_SERVO_MS, times


@pytest.mark.slow(20)
def test_each_dead_servo_is_found_out_in_time_at_every_phase(reference: ReferenceTrajectory) -> None:
    with high_five_at(reference, default_planner(), reference.due - AT_HAND) as begun:
        for servo in SERVOS:
            times = [forked(partial(begun.dead_servo_ms, phase, servo)) for phase in PHASES]
            assert tell(f"dead servo {servo}", times) <= DEAD_SERVO_MS, times


def hold_in_time(tick: int, phases: Sequence[float], reference: ReferenceTrajectory) -> None:
    """The bounds, of who was last measured at those phases before that tick."""
    with high_five_at(reference, default_planner(), tick - 1) as begun:
        times = [forked(partial(begun.hold_ms, phase)) for phase in phases]
    assert tell(f"person not measured in tick {tick}", times) <= HOLD_MS and min(times) > 50.0, times


@pytest.mark.slow
def test_an_arm_whose_person_is_not_measured_any_more_is_held_in_time(reference: ReferenceTrajectory) -> None:
    for number, tick in enumerate(ticks(reference)[1:]):
        hold_in_time(tick, PHASES[1 + 4 * number :: 12], reference)


@pytest.mark.slow(10)
def test_it_is_held_in_time_in_every_tick_at_every_phase(reference: ReferenceTrajectory) -> None:
    for tick in ticks(reference)[1:]:
        hold_in_time(tick, PHASES, reference)

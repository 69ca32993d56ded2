"""How long the emulated rig takes to stop, at every phase of the driver's cycle; exact, in virtual time.

Each sweep is run whole where it is marked slow, and with a few cases, spread over it, everywhere else.
"""

from collections.abc import Sequence

import numpy as np
import pytest

from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.bench.safety_times import (
    ENGAGING,
    Happening,
    Stopped,
    dead_servo_ms,
    hold_ms,
    kill_both,
    kill_host,
    pull,
    stall_host,
    stopped_by,
    stopped_in_high_five,
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
# servos' own watchdogs: 80 ms.
BOUNDS = {pull: ESTOP_MS, stall_host: SILENT_MS, kill_host: SILENT_MS, kill_both: SILENT_MS}


def tell(what: str, times: Sequence[float]) -> float:
    """The worst, which is also said."""
    print(f"{what}: {min(times):.1f} to {max(times):.1f} ms, {len(times)} cases")
    return max(times)


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


def stop_in_time(happening: Happening, tick: int, phases: Sequence[float], reference: ReferenceTrajectory) -> None:
    """The bounds, in that tick at those phases."""
    found: list[Stopped] = [
        stopped_in_high_five(happening, reference, default_planner(), tick, phase) for phase in phases
    ]
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


@pytest.mark.parametrize("happening", [pull, kill_host, kill_both])
def test_it_stops_the_arm_in_time_in_a_high_five_too(happening: Happening, reference: ReferenceTrajectory) -> None:
    for number, tick in enumerate(ticks(reference)):
        # Of the instants of switching on one in which the arm is limp, and one in which it is held.
        phases = PHASES[2::6] if tick == ENGAGING else PHASES[2 + 3 * number :: 12]
        stop_in_time(happening, tick, phases, reference)


@pytest.mark.slow(50)
@pytest.mark.parametrize("happening", BOUNDS)
def test_it_stops_the_arm_in_time_in_every_tick_at_every_phase(
    happening: Happening, reference: ReferenceTrajectory
) -> None:
    for tick in ticks(reference):
        stop_in_time(happening, tick, PHASES, reference)


def test_each_dead_servo_is_found_out_in_time(reference: ReferenceTrajectory) -> None:
    tick, retarget = reference.due // 2, default_planner()
    phases = np.arange(len(SERVOS)) / len(SERVOS)
    times = [dead_servo_ms(reference, retarget, tick, *case) for case in zip(phases, SERVOS, strict=True)]
    assert tell("dead servo", times) <= DEAD_SERVO_MS, times


@pytest.mark.slow(60)
def test_each_dead_servo_is_found_out_in_time_at_every_phase(reference: ReferenceTrajectory) -> None:
    tick, retarget = reference.due - AT_HAND, default_planner()
    for servo in SERVOS:
        times = [dead_servo_ms(reference, retarget, tick, phase, servo) for phase in PHASES]
        assert tell(f"dead servo {servo}", times) <= DEAD_SERVO_MS, times


def hold_in_time(tick: int, phases: Sequence[float], reference: ReferenceTrajectory) -> None:
    """The bounds, in that tick at those phases."""
    times = [hold_ms(reference, default_planner(), tick, phase) for phase in phases]
    assert tell(f"person not measured in tick {tick}", times) <= HOLD_MS and min(times) > 50.0, times


def test_an_arm_whose_person_is_not_measured_any_more_is_held_in_time(reference: ReferenceTrajectory) -> None:
    for number, tick in enumerate(ticks(reference)[1:]):
        hold_in_time(tick, PHASES[1 + 4 * number :: 12], reference)


@pytest.mark.slow(30)
def test_it_is_held_in_time_in_every_tick_at_every_phase(reference: ReferenceTrajectory) -> None:
    for tick in ticks(reference)[1:]:
        hold_in_time(tick, PHASES, reference)

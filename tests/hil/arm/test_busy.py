"""A computer that is too busy is told from every other reason to stop."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.arm.busy import LATE_NS, too_busy
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.safety.faults import deadline, silent_servo, watch_from
from highfive.hil.safety.limits_file import load_limits

LIMITS = load_limits()
WELL = cast(ArmTrial, SimpleNamespace(ticks=(), cycles=()))


def cycles(late_ns: int) -> list[Cycle]:
    return cast(list[Cycle], [cast(Any, SimpleNamespace(due_ns=0, begun_ns=late_ns))])


def test_a_pause_between_two_high_fives_is_one_of_a_busy_computer() -> None:
    watch = watch_from(0)
    paused = deadline(LIMITS.timing, replace(watch, gap_s=0.259))
    late = deadline(LIMITS.timing, replace(watch, late=99))
    assert paused.startswith("the loop paused for 259 ms")
    for why in (paused, late, f"something; {paused}"):
        for trial in (None, WELL):
            assert too_busy(trial, (), why).startswith("the computer was too busy")
    for why in ("", "the emergency stop was pulled", "elbow moves by 0.3 rad"):
        assert too_busy(WELL, cycles(2 * LATE_NS), why) == ""


def test_silent_servos_are_the_computers_fault_only_if_the_bus_was_late() -> None:
    why = silent_servo(LIMITS.servo, watch_from(0), 10**9)
    assert too_busy(WELL, cycles(2 * LATE_NS), why).startswith("the computer was too busy")
    assert too_busy(WELL, cycles(0), why) == ""

"""A computer that is too busy is distinguished from every other reason to stop."""

from types import SimpleNamespace
from typing import Any, cast

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.arm.busy import LATE_NS, too_busy
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.safety.rules import Rule

WELL = cast(ArmTrial, SimpleNamespace(ticks=(), cycles=(), back=SimpleNamespace(cycles=())))


def cycles(late_ns: int) -> list[Cycle]:
    return cast(list[Cycle], [cast(Any, SimpleNamespace(due_ns=0, begun_ns=late_ns))])


def test_a_pause_between_two_high_fives_is_one_of_a_busy_computer() -> None:
    for stopped_by in ({Rule.DEADLINE}, {Rule.VOLTAGE, Rule.DEADLINE}):
        for trial in (None, WELL):
            assert too_busy(trial, (), stopped_by).startswith("the computer was too busy")
    for stopped_by in (set(), {Rule.ESTOP}, {Rule.START_UP}):
        assert too_busy(WELL, cycles(2 * LATE_NS), stopped_by) == ""


def test_silent_servos_are_the_computers_fault_only_if_the_bus_was_late() -> None:
    assert too_busy(WELL, cycles(2 * LATE_NS), {Rule.SILENT_SERVO}).startswith("the computer was too busy")
    assert too_busy(WELL, cycles(0), {Rule.SILENT_SERVO}) == ""


def test_emulated_servos_with_which_nothing_is_to_go_wrong_are_silent_for_want_of_the_processor() -> None:
    assert too_busy(WELL, cycles(0), {Rule.SILENT_SERVO}, never_silent=True).startswith("the computer was too busy")
    assert too_busy(WELL, cycles(0), {Rule.VOLTAGE}, never_silent=True) == ""


def test_a_driver_that_was_killed_is_no_busy_computer() -> None:
    for stopped_by in ({Rule.DEADLINE}, {Rule.SILENT_SERVO}):
        assert too_busy(WELL, cycles(2 * LATE_NS), stopped_by)
        assert too_busy(WELL, cycles(2 * LATE_NS), stopped_by, gone=True) == ""

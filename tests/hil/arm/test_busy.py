"""A computer that is too busy is distinguished from every other reason to stop."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.arm.busy import LATE_NS, too_busy
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.safety.rules import Rule

WELL = cast(ArmTrial, SimpleNamespace(ticks=(), cycles=(), back=SimpleNamespace(cycles=())))


def cycles(late_ns: int, *, tripped: bool = False) -> list[Cycle]:
    state = SimpleNamespace(tripped=np.array([False, tripped]))
    return cast(list[Cycle], [cast(Any, SimpleNamespace(due_ns=0, begun_ns=late_ns, state=state))])


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


def test_watchdogs_that_stopped_the_servos_heard_nothing_from_a_busy_computer() -> None:
    assert too_busy(WELL, cycles(0, tripped=True), never_silent=True).startswith("the computer was too busy")
    assert too_busy(WELL, cycles(2 * LATE_NS, tripped=True)).startswith("the computer was too busy")
    assert too_busy(WELL, cycles(0, tripped=True)) == ""
    after_a_pause = [*(120 * cycles(0)), *cycles(0, tripped=True)]
    assert too_busy(WELL, after_a_pause, never_silent=True).startswith("the computer was too busy")


def test_what_happened_in_a_pause_before_is_not_why_it_was_stopped() -> None:
    """While registers are read back between two high fives nobody asks the joints, and the first tick says so."""
    report = SimpleNamespace(acted=frozenset({Rule.SILENT_SERVO, Rule.START_UP}))
    trial = cast(ArmTrial, SimpleNamespace(ticks=(SimpleNamespace(report=report),), cycles=(), back=WELL.back))
    assert too_busy(trial, cycles(2 * LATE_NS, tripped=True), {Rule.ESTOP}, never_silent=True) == ""


def test_a_driver_that_was_killed_is_no_busy_computer() -> None:
    for stopped_by in ({Rule.DEADLINE}, {Rule.SILENT_SERVO}):
        assert too_busy(WELL, cycles(2 * LATE_NS), stopped_by)
        assert too_busy(WELL, cycles(2 * LATE_NS), stopped_by, gone=True) == ""

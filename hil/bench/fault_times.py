"""How soon an arm stops that was stopped, or that nobody leads any more: laws for sessions under faults."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.fault_schedule import BUS, DEATHS, STOPS
from highfive.hil.bench.laws import Laws
from highfive.hil.bench.session_phases import Occurrence
from highfive.hil.safety.states import State

ESTOP_MS, HELD_MS, WATCHDOG_MS = 20.0, 100.0, 100.0
"""From an emergency stop to the last goal; from when nobody leads the arm any more to the last goal, or to the hold;
from a program's death to the servos' own stop."""

ESTOP = "emergency stop to the last goal, ms"
HOLD, UNSEEN = "nobody leads the arm to the last goal, ms", "the person is not measured to the hold, ms"
LAST_GOAL, WATCHDOG = "{} to the last goal, ms", "{} to the servos' own stop, ms"

DRIVERLESS = ("driver stall", "machine stall")
"""Kinds of happenings in which nobody cycles the bus."""

_HELD_NS = round(1e6 * HELD_MS)


def judge_times(
    laws: Laws,
    occurred: Sequence[Occurrence],
    box: BlackBox,
    trial: ArmTrial | None,
    pulled_ns: int | None,
) -> None:
    """When the last goal went out, and when servos stopped by themselves.

    A driver that stands still itself stops nothing: then time counts from when it goes on.

    Args:
        laws: added to.
        occurred: what went wrong.
        box: what the servos were commanded.
        trial: what the arm did; None where it did not follow.
        pulled_ns: when the emergency stop was pulled; None where it was not.
    """
    if not box.times:
        return
    driverless = [it for it in occurred if it.happening.kind in DRIVERLESS]
    if pulled_ns is not None and pulled_ns < box.times[-1]:
        since = _driven_again(pulled_ns, round(1e6 * ESTOP_MS), driverless)
        laws.judge(ESTOP, box.commanded_after_ms(since, holds=1 + _holds_after(pulled_ns, occurred)), ESTOP_MS)
    for it in occurred:
        kind = it.happening.kind
        if kind in DEATHS and it.at_ns < box.times[-1]:
            since = _driven_again(it.at_ns, _HELD_NS, driverless)
            holds = 1 + _holds_after(it.at_ns, occurred)
            laws.judge(LAST_GOAL.format(kind), box.commanded_after_ms(since, holds=holds), HELD_MS)
            if (stopped := box.stopped_after_ms(since)) is not None:
                laws.judge(WATCHDOG.format(kind), stopped, WATCHDOG_MS)
        if it.until_ns - it.at_ns > _HELD_NS:
            if kind in ("host stall", "machine stall"):
                _judge_host(laws, it, occurred, box)
            elif kind in ("stall", "burst", "occlusion") and trial is not None:
                _judge_person(laws, it, trial)


def _judge_host(laws: Laws, it: Occurrence, occurred: Sequence[Occurrence], box: BlackBox) -> None:
    """The host stands still: the driver has to hold. Other standstills of the host may follow each other."""
    others = [one for one in occurred if one is not it and one.happening.kind in DRIVERLESS]
    since = _driven_again(it.at_ns, _HELD_NS, others)
    if since < it.until_ns:
        holds = 1 + _holds_after(it.at_ns, [one for one in occurred if one is not it])
        laws.judge(HOLD, box.commanded_after_ms(since, it.until_ns - 1, holds), HELD_MS)


def _holds_after(since_ns: int, occurred: Sequence[Occurrence]) -> int:
    """What comes to pass later has an arm held once more that is held already: who leads it dies, a driver goes on that
    stood still, a bus answers again, the stop is pulled."""
    kinds = (*BUS, *DEATHS, *STOPS, *DRIVERLESS)
    return sum(it.happening.kind in kinds and it.until_ns > since_ns for it in occurred)


def _judge_person(laws: Laws, it: Occurrence, trial: ArmTrial) -> None:
    """The person is not measured: the host has to hold, as long as it ticks."""
    until = it.until_ns
    times = np.array([tick.report.time_ns for tick in trial.ticks])
    tracking = np.array([tick.report.state is State.TRACKING for tick in trial.ticks])
    during = (times > it.at_ns) & (times < until)
    if (during & (times > it.at_ns + _HELD_NS)).any() and tracking[during].any():
        laws.judge(UNSEEN, 1e-6 * float(times[during & tracking].max() - it.at_ns), HELD_MS)


def _driven_again(since_ns: int, within_ns: int, standstills: Sequence[Occurrence]) -> int:
    """``since_ns``, or when the driver went on last that stood still then, or began to ``within_ns`` after."""
    found = since_ns
    for one in sorted(standstills, key=lambda it: it.at_ns):
        if one.at_ns < found + within_ns and one.until_ns > found:
            found = one.until_ns
    return found

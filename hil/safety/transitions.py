"""What happened in a tick, and what begins with the state that it leads to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from highfive.hil.safety import retract
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.motion import Motion, at_rest
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.states import HALTED, Event, State, after
from highfive.hil.safety.values import EnvelopeState, Inputs


def happened(limits: Limits, now: EnvelopeState, inputs: Inputs, faulty: bool, age_s: float) -> Event | None:
    """The first of :class:`highfive.hil.safety.states.Event` that happened, if it leads anywhere.

    Args:
        limits: all of them.
        now: what was carried on.
        inputs: of the tick.
        faulty: a rule requests a controlled stop.
        age_s: s, of the person, or of what is requested, whichever is older.
    """
    if inputs.estop_ns is not None:
        event = Event.ESTOP
    elif inputs.acknowledge and now.state in (State.STOPPED, State.ESTOPPED):
        event = Event.ACKNOWLEDGE
    elif faulty and now.state is not State.STOPPING:  # a fault that lasts does not keep it from standing still
        event = Event.FAULT
    else:
        event = without_fault(limits, now, inputs, age_s)
    return event if after(now.state, event) is not now.state else None


def without_fault(limits: Limits, now: EnvelopeState, inputs: Inputs, age_s: float) -> Event | None:
    """What happened, if nothing is wrong."""
    # The next tick would be too late to hold in time.
    next_s = age_s + limits.timing.period_s
    fresh, reference, event = next_s <= limits.stale.hold_s, now.motion, None
    match now.state:
        case State.UNCHECKED if start_up(now, inputs):
            event = Event.CHECKED
        case State.READY if inputs.run and fresh:
            event = Event.START
        case State.TRACKING | State.HOLDING if not inputs.run:
            event = Event.END
        case State.TRACKING | State.HOLDING if not fresh:
            event = Event.LOST if next_s > limits.stale.retract_s else Event.STALE
        case State.HOLDING:
            event = Event.FRESH
        case State.RETRACTING if inputs.run and fresh:
            event = Event.FRESH
        case State.RETRACTING if reference is not None and retract.rests(limits, reference, now.way_point):
            event = Event.RETRACTED
        case State.STOPPING if reference is None or not reference.velocities.any():
            event = Event.STILL
        case _:
            pass
    return event


def start_up(now: EnvelopeState, inputs: Inputs) -> bool:
    """The start-up check found nothing, was made since the arm has been unchecked, and the joints have answered.

    A check from before a stop does not count after it.
    """
    check, arm = inputs.check, inputs.arm
    if check is None or arm is None:
        return False
    return check.time_ns >= now.since_ns and not check.mismatches and bool(arm.answered.all())


def entered(
    limits: Limits, now: EnvelopeState, event: Event | None, inputs: Inputs, reasons: dict[Rule, str], now_ns: int
) -> EnvelopeState:
    """The envelope in the state that the event leads to."""
    state, reference = after(now.state, event), now.motion
    if event is None:
        return now
    halted = now.state in HALTED  # whatever stopped it before stays the reason
    now = replace(now, state=state, since_ns=now_ns)
    match event:
        case Event.CHECKED if inputs.arm is not None:
            now = replace(now, motion=at_rest(inputs.arm.positions))
        case Event.ESTOP:
            why, by = pulled(limits, inputs, now_ns), frozenset({Rule.ESTOP})
            why, by = (f"{now.reason}; then {why}", now.stopped_by | by) if halted and now.reason else (why, by)
            now = replace(now, reason=why, stopped_by=by)
            now = replace(now, motion=frozen(limits, reference, inputs))
        case Event.FAULT:
            now = replace(now, reason="; ".join(reasons.values()), stopped_by=frozenset(reasons))
        case Event.ACKNOWLEDGE:
            now = replace(now, reason="", stopped_by=frozenset())
        case Event.LOST | Event.END if reference is not None:
            now = replace(now, way_point=retract.nearest(limits, reference.positions))
        case Event.RETRACTED if reference is not None:
            now = replace(now, motion=at_rest(reference.positions))
        case _:
            pass
    return now


def pulled(limits: Limits, inputs: Inputs, now_ns: int) -> str:
    """Why the arm was stopped at once, and how long that took."""
    delay = max(0.0, 1e-9 * (now_ns - (inputs.estop_ns or now_ns)))  # it may have been pulled while this tick planned
    late = f", later than {1e3 * limits.timing.estop_s:.0f} ms" if delay > limits.timing.estop_s else ""
    return f"emergency stop, seen by the session {1e3 * delay:.1f} ms after it was pulled{late}"


def frozen(limits: Limits, reference: Motion | None, inputs: Inputs) -> Motion | None:
    """The joints commanded to stay where they are, not where they were going.

    Where they do not answer they stay where they were commanded to be. So that a wrong reading moves nothing far,
    nowhere is further from there than what a joint may stray.
    """
    if reference is None or inputs.arm is None:
        return None if reference is None else at_rest(reference.positions)
    stray = np.clip(inputs.arm.positions - reference.positions, -limits.servo.following, limits.servo.following)
    return at_rest(reference.positions + np.where(inputs.arm.answered, stray, 0.0))

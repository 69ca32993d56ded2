"""The safety envelope: what stands between where the arm is requested to be and what is sent to it.

:func:`step` is called once per tick. It keeps no state of its own, reads no clock and sends nothing. Whoever calls it
sends the command that comes back, and nothing else, and records the report. Nothing is added after it: what goals lead
by, because loaded joints stand off them, comes in as a request and is held to the rules like everything else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.hil.drivers.values import JointCommand
from highfive.hil.safety import faults, feed_forward, motion, people, wire
from highfive.hil.safety.feed_forward import FeedForward
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.motion import Motion
from highfive.hil.safety.people import Human, Points, Remembered
from highfive.hil.safety.retract import retracting
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.states import MOVING, Event, State
from highfive.hil.safety.transitions import entered, happened
from highfive.hil.safety.values import EnvelopeState, Inputs, Report
from highfive.model.geometry.rotations import Array

Kinematics = Callable[[Array], tuple[Array, Array]]
"""Joint positions (J,), rad, to the points of the arm that may meet the person: places (P, 3), m, in the world frame,
and Jacobians (P, 3, J), m/rad. The first is the palm plate's centre. What it returns must not be written to again."""

LATE_TICK = 1.5
"""Periods that a joint moves in one tick at most: after a late tick the arm is late, not fast."""

NEVER_S = 1e9
"""Age of a person who was never seen, s."""

BY_EVENT = {Event.STALE: Rule.STALE_HOLD, Event.LOST: Rule.STALE_RETRACT, Event.ESTOP: Rule.ESTOP}
"""Rules that act by an event."""


def step(
    limits: Limits, kinematics: Kinematics, before: EnvelopeState, inputs: Inputs, now_ns: int
) -> tuple[EnvelopeState, JointCommand | None, Report]:
    """One tick: what to carry on, what to send (None: nothing), and what happened.

    Args:
        limits: all of them.
        kinematics: of the arm that is moved.
        before: what came back from the tick before, or :func:`highfive.hil.safety.values.standing`.
        inputs: what is known now.
        now_ns: monotonic clock, ns.
    """
    requested = inputs.requested
    inputs, reasons = finite(inputs, len(limits.joints))
    reference = None if before.motion is None else before.motion.positions
    watch = faults.watched(limits, before.watch, inputs.arm, reference, now_ns)
    points = goals = None
    if before.motion is not None:
        # A step turns the arm by what its speed was, nearly: halfway lies what it moves points by, to third order.
        half = 0.5 * limits.timing.period_s * before.motion.velocities
        points = placed(kinematics, before.motion.positions, half, inputs)
        goals = placed(kinematics, before.motion.positions + before.feed_forward.offsets, half, inputs)
    if before.motion is not None and (points is None or goals is None):
        reasons, points, goals = {Rule.NOT_FINITE: "the kinematics of the arm are not finite"}, None, None
    reasons |= faults.faults(limits, watch, inputs.arm, inputs.health, now_ns)

    requested_ns = before.requested_ns if inputs.requested is None else now_ns
    seen_s = NEVER_S if inputs.human is None else 1e-9 * inputs.human.measured_ns
    age_s = max(seen_s, 1e-9 * (now_ns - requested_ns))
    event = happened(limits, before, inputs, bool(reasons), age_s)
    now = entered(limits, before, event, inputs, reasons, now_ns)
    acted = set(reasons)
    acted |= {BY_EVENT[event]} if event is not None and event in BY_EVENT else set()
    acted |= {Rule.START_UP} if now.state is State.UNCHECKED else set()

    human, seen = known(limits, inputs.human), now.seen
    if points is not None and human is not None:
        seen = people.remembered(limits.contact, seen, human, points, now_ns)
    fraction, closing, then, way_point, offset = 1.0, None, now.motion, now.way_point, now.feed_forward
    if then is not None and now.state is not State.ESTOPPED:
        dt = min(max(watch.gap_s, 0.0), LATE_TICK * limits.timing.period_s)
        velocities, target, kept = np.zeros_like(then.positions), then.target, np.zeros_like(then.positions)
        if now.state in MOVING:
            velocities, target, way_point, clamped = led(limits, now, then, inputs.requested, dt)
            kept, closing, slowing = monitored(limits, now.state, seen, human, points, velocities, dt)
            kept = motion.fraction_within(limits, then, kept, dt) * kept
            acted |= clamped | slowing
        bounds = feed_forward.bounds(limits, offset, then.positions + kept * dt, dt)
        rates = feed_forward.next_rates(limits, offset, inputs.feed_forward, then, kept, bounds, dt)
        sent, leading = on_the_wire(limits, seen, human, goals, kept, rates, bounds, dt)
        closing = max((c for c in (closing, sent.closing_speed) if c is not None), default=None)
        within = min(motion.fraction_within(limits, then, sent.reference, dt), joint_fraction(limits, sent))
        fraction = motion.kept_fraction(velocities, within * sent.reference)
        acted |= leading
        then = motion.moved(then, within * sent.reference, target, dt)
        offset = feed_forward.moved(limits, offset, within * sent.offset, then.positions, dt)
    now = EnvelopeState(
        now.state, now.since_ns, now.reason, then, watch, seen, requested_ns, offset, way_point, now.stopped_by
    )

    gap = None
    if points is not None and goals is not None and human is not None:
        gap = min(people.gap_to_hand(human, points), people.gap_to_hand(human, goals))
    command, limited = commanded(limits, then, offset, gap)
    report = Report(
        time_ns=now_ns,
        state=now.state,
        event=event,
        reason=now.reason or unchecked(now, inputs, reasons),
        requested=requested,
        reference=None if then is None else then.positions,
        sent=command,
        acted=frozenset(acted | limited),
        fraction=fraction,
        closing_speed=closing,
        gap=gap,
    )
    return now, command, report


def finite(inputs: Inputs, joints: int) -> tuple[Inputs, dict[Rule, str]]:
    """The inputs without those that hold something that is no number; and what that was."""
    reasons = {}
    for field, name, array, shape in numbers(inputs, joints):
        if reason := faults.not_finite(name, array, shape):
            inputs, reasons = replace(inputs, **{field: None}), {Rule.NOT_FINITE: reason}
    return inputs, reasons


def numbers(inputs: Inputs, joints: int) -> Iterator[tuple[str, str, NDArray[Any], tuple[int, ...]]]:
    """All arrays of the inputs: in which of their fields, what it is, the array, and the shape it has to have."""
    requested, arm, health, human = inputs.requested, inputs.arm, inputs.health, inputs.human
    joint, vector = (joints,), (3,)
    if requested is not None:
        yield "requested", "requested positions", requested, joint
    if inputs.feed_forward is not None:
        yield "feed_forward", "what goals shall lead by", inputs.feed_forward, joint
    if arm is not None:
        yield "arm", "the servos' positions", arm.positions, joint
        yield "arm", "the servos' velocities", arm.velocities, joint
        yield "arm", "the servos' currents", arm.currents, joint
        yield "arm", "the servos' errors", arm.errors, joint
        yield "arm", "the servos' answers", arm.answered, joint
        yield "arm", "the servos' watchdogs", arm.tripped, joint
        yield "arm", "the distances of paired servos", arm.apart, joint
    if health is not None:
        yield "health", "the servos' temperatures", health.temperatures, joint
        yield "health", "the servos' voltages", health.voltages, joint
    if human is not None:
        yield "human", "the person's head", human.head, vector
        if human.palm is not None:
            yield "human", "the person's palm", human.palm, vector
        if human.palm_velocity is not None:
            yield "human", "the velocity of the person's palm", human.palm_velocity, vector
        deviations = np.array([human.head_seen.deviation, human.palm_seen.deviation])
        yield "human", "how sure head and palm are", deviations, (2,)


def placed(kinematics: Kinematics, positions: Array, half: Array, inputs: Inputs) -> Points | None:
    """Where the arm's points are if the joints are at ``positions`` (J,), rad, how they move where these have moved on
    by ``half`` (J,), rad, of a step, and where they are.

    None where that is no number.
    """
    places, jacobians = kinematics(positions)[0], kinematics(positions + half)[1]
    measured = places if inputs.arm is None else kinematics(inputs.arm.positions)[0]
    if not (faults.all_finite(places) and faults.all_finite(jacobians) and faults.all_finite(measured)):
        return None
    return Points(places, jacobians, measured)


def known(limits: Limits, human: Human | None) -> Human | None:
    """The person, unless that was measured too long ago to say where they are; without the hand if that was."""
    longest = round(1e9 * limits.stale.retract_s)
    if human is None or max(human.age_ns, human.head_seen.age_ns) > longest:
        return None
    return human if human.palm_seen.age_ns <= longest else replace(human, palm=None, palm_velocity=None)


def led(
    limits: Limits, now: EnvelopeState, reference: Motion, requested: Array | None, dt: float
) -> tuple[Array, Array | None, int, set[Rule]]:
    """What the state asks for: velocities (J,), rad/s, within the limits of the joints.

    Returns:
        the velocities, what is requested within the limits of position, the way point, and the rules that acted.
    """
    velocities, within, way_point = motion.braked(limits, reference, dt), None, now.way_point
    acted: set[Rule] = set()
    if now.state is State.TRACKING and requested is not None:
        within, outside = motion.target_position(limits, requested)
        velocities, slower = motion.towards(limits, reference, within, dt)
        acted = outside | slower
    elif now.state is State.RETRACTING:
        velocities, way_point = retracting(limits, reference, way_point, dt)
    velocities, clamped = motion.within_limits(limits, reference, velocities, dt)
    return velocities, within, way_point, acted | clamped


def monitored(
    limits: Limits,
    state: State,
    seen: Remembered,
    human: Human | None,
    points: Points | None,
    velocities: Array,
    dt: float,
) -> tuple[Array, float | None, set[Rule]]:
    """What of the velocities (J,), rad/s, the person allows; see :func:`highfive.hil.safety.people.monitor_separation`.

    Where the arm's points are not known it stands. A stop is only made quicker for a person whose place is known.
    """
    if points is None:
        return np.zeros_like(velocities), None, set()
    if human is None and state is not State.RETRACTING:
        return velocities, None, set()
    return people.monitor_separation(limits, seen, human, points, velocities, dt)


def on_the_wire(
    limits: Limits,
    seen: Remembered,
    human: Human | None,
    goals: Points | None,
    kept: Array,
    rates: Array,
    bounds: tuple[Array, Array],
    dt: float,
) -> tuple[wire.Rates, set[Rule]]:
    """Rates (J,), rad/s, with which the goals, too, keep the rules for the person; see :mod:`highfive.hil.safety.wire`.

    Where the arm's points are not known the goals stand.
    """
    if goals is None:
        return wire.Rates(np.zeros_like(kept), np.zeros_like(rates), None), set()
    return wire.within_rules(limits, seen, human, goals, kept, rates, bounds, dt)


def joint_fraction(limits: Limits, rates: wire.Rates) -> float:
    """How much of the rates may be kept so that no joint's goal is faster than its speed limit."""
    return min(1.0, 1.0 / max(float((np.abs(rates.reference + rates.offset) / limits.speed).max()), 1e-12))


def commanded(
    limits: Limits, reference: Motion | None, offset: FeedForward, gap: float | None
) -> tuple[JointCommand | None, set[Rule]]:
    """What is sent: goals that lead the reference by the ``offset``, with little current unless the hand is known to be
    further away than ``near`` (``gap``, m)."""
    if reference is None:
        return None, set()
    goals = reference.positions + offset.offsets
    if gap is not None and gap > limits.contact.near:
        return JointCommand(goals, limits.current), set()
    return JointCommand(goals, limits.contact_current), {Rule.CURRENT}


def unchecked(now: EnvelopeState, inputs: Inputs, reasons: dict[Rule, str]) -> str:
    """Why the arm does not start."""
    if now.state is not State.UNCHECKED:
        return ""
    check = inputs.check
    if check is None or check.time_ns < now.since_ns:
        return "the servos have to be checked"
    return "; ".join((*check.mismatches, *reasons.values()))

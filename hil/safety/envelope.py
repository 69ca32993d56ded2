"""The safety envelope: what stands between where the arm is wanted and what is sent to it.

:func:`step` is called once a tick. It keeps no state of its own, reads no clock and sends nothing. Whoever calls it
sends the command that comes back, and nothing else, and records the report.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.drivers.values import JointCommand
from hil.safety import faults, motion, people
from hil.safety.limits import JOINTS, Limits
from hil.safety.motion import Motion
from hil.safety.people import Human, Points, Remembered
from hil.safety.retract import retracting
from hil.safety.rules import Rule
from hil.safety.states import MOVING, Event, State
from hil.safety.transitions import entered, happened
from hil.safety.values import Inputs, Report, Standing
from model.rotations import Array

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
    limits: Limits, kinematics: Kinematics, before: Standing, inputs: Inputs, now_ns: int
) -> tuple[Standing, JointCommand | None, Report]:
    """One tick: what to carry on, what to send (None: nothing), and what happened.

    Args:
        limits: all of them.
        kinematics: of the arm that is moved.
        before: what came back from the tick before, or :func:`hil.safety.values.standing`.
        inputs: what is known now.
        now_ns: monotonic clock, ns.
    """
    asked = inputs.wanted
    inputs, reasons = finite(inputs)
    told = None if before.motion is None else before.motion.positions
    watch = faults.watched(limits, before.watch, inputs.arm, told, now_ns)
    points = None if told is None else placed(kinematics, told, inputs)
    if told is not None and points is None:
        reasons = {Rule.NOT_FINITE: "the kinematics of the arm are not finite"}
    reasons |= faults.faults(limits, watch, inputs.arm, inputs.health, now_ns)

    wanted_ns = before.wanted_ns if inputs.wanted is None else now_ns
    age_s = max(NEVER_S if inputs.human is None else 1e-9 * inputs.human.age_ns, 1e-9 * (now_ns - wanted_ns))
    event = happened(limits, before, inputs, bool(reasons), age_s)
    now = entered(limits, before, event, inputs, reasons, now_ns)
    acted = set(reasons)
    acted |= {BY_EVENT[event]} if event is not None and event in BY_EVENT else set()
    acted |= {Rule.START_UP} if now.state is State.UNCHECKED else set()

    human, seen = known(limits, inputs.human), now.seen
    if points is not None and human is not None:
        seen = people.remembered(limits.contact, seen, human, points, now_ns)
    share, closing, then, way_point = 1.0, None, now.motion, now.way_point
    if then is not None and now.state in MOVING:
        dt = min(max(watch.gap_s, 0.0), LATE_TICK * limits.timing.period_s)
        velocities, wanted, way_point, clamped = led(limits, now, then, inputs.wanted, dt)
        kept, closing, slowing = spared(limits, now.state, seen, human, points, velocities, dt)
        kept = motion.share_within(limits, then, kept, dt) * kept
        share = kept_share(velocities, kept)
        acted |= clamped | slowing
        then = motion.moved(then, kept, wanted, dt)
    now = Standing(now.state, now.since_ns, now.reason, then, watch, seen, wanted_ns, way_point)

    gap = None if points is None or human is None else people.gap_to_hand(human, points)
    command, limited = commanded(limits, then, gap)
    report = Report(
        time_ns=now_ns,
        state=now.state,
        event=event,
        reason=now.reason or unchecked(now, inputs, reasons),
        asked=asked,
        sent=command,
        acted=frozenset(acted | limited),
        share=share,
        closing_speed=closing,
        gap=gap,
    )
    return now, command, report


def finite(inputs: Inputs) -> tuple[Inputs, dict[Rule, str]]:
    """The inputs without those that hold something that is no number; and what that was."""
    reasons = {}
    for field, name, array, shape in numbers(inputs):
        if reason := faults.not_finite(name, array, shape):
            inputs, reasons = replace(inputs, **{field: None}), {Rule.NOT_FINITE: reason}
    return inputs, reasons


def numbers(inputs: Inputs) -> Iterator[tuple[str, str, NDArray[Any], tuple[int, ...]]]:
    """All arrays of the inputs: in which of their fields, what it is, the array, and the shape it has to have."""
    wanted, arm, health, human = inputs.wanted, inputs.arm, inputs.health, inputs.human
    joints, vector = (len(JOINTS),), (3,)
    if wanted is not None:
        yield "wanted", "wanted positions", wanted, joints
    if arm is not None:
        yield "arm", "the servos' positions", arm.positions, joints
        yield "arm", "the servos' velocities", arm.velocities, joints
        yield "arm", "the servos' currents", arm.currents, joints
        yield "arm", "the servos' errors", arm.errors, joints
        yield "arm", "the servos' answers", arm.answered, joints
        yield "arm", "the servos' watchdogs", arm.tripped, joints
        yield "arm", "the distances of paired servos", arm.apart, joints
    if health is not None:
        yield "health", "the servos' temperatures", health.temperatures, joints
        yield "health", "the servos' voltages", health.voltages, joints
    if human is not None:
        yield "human", "the person's head", human.head, vector
        if human.palm is not None:
            yield "human", "the person's palm", human.palm, vector
        if human.palm_velocity is not None:
            yield "human", "the velocity of the person's palm", human.palm_velocity, vector


def placed(kinematics: Kinematics, told: Array, inputs: Inputs) -> Points | None:
    """Where the arm's points are if the joints are where they were ``told`` (J,), rad, to be, and where they are.

    None where that is no number.
    """
    places, jacobians = kinematics(told)
    measured = places if inputs.arm is None else kinematics(inputs.arm.positions)[0]
    if not (faults.all_finite(places) and faults.all_finite(jacobians) and faults.all_finite(measured)):
        return None
    return Points(places, jacobians, measured)


def known(limits: Limits, human: Human | None) -> Human | None:
    """The person, unless that was too long ago to say where they are."""
    return human if human is not None and 1e-9 * human.age_ns <= limits.stale.retract_s else None


def led(
    limits: Limits, now: Standing, told: Motion, wanted: Array | None, dt: float
) -> tuple[Array, Array | None, int, set[Rule]]:
    """What the state asks for: velocities (J,), rad/s, within the limits of the joints.

    Returns:
        the velocities, where the joints are wanted within their limits, the way point, and the rules that acted.
    """
    velocities, within, way_point, acted = motion.braked(limits, told, dt), None, now.way_point, set()
    if now.state is State.TRACKING and wanted is not None:
        within, outside = motion.position_wanted(limits, wanted)
        velocities, slower = motion.towards(limits, told, within, dt)
        acted = outside | slower
    elif now.state is State.RETRACTING:
        velocities, way_point = retracting(limits, told, way_point, dt)
    velocities, clamped = motion.within_limits(limits, told, velocities, dt)
    return velocities, within, way_point, acted | clamped


def kept_share(asked: Array, kept: Array) -> float:
    """How much of the speed (J,), rad/s, that was asked for is left; 1 where none was."""
    before = float(np.linalg.norm(asked))
    return min(1.0, float(np.linalg.norm(kept)) / before) if before > 0.0 else 1.0


def spared(
    limits: Limits,
    state: State,
    seen: Remembered,
    human: Human | None,
    points: Points | None,
    velocities: Array,
    dt: float,
) -> tuple[Array, float | None, set[Rule]]:
    """What of the velocities (J,), rad/s, the person allows; see :func:`hil.safety.people.slowed`.

    Where the arm's points are not known it stands. A stop is only made quicker for a person whose place is known.
    """
    if points is None:
        return np.zeros_like(velocities), None, set()
    if human is None and state is not State.RETRACTING:
        return velocities, None, set()
    return people.slowed(limits, seen, human, points, velocities, dt)


def commanded(limits: Limits, told: Motion | None, gap: float | None) -> tuple[JointCommand | None, set[Rule]]:
    """What may be sent: little current unless the hand is known to be further away than ``near`` (``gap``, m)."""
    if told is None:
        return None, set()
    if gap is not None and gap > limits.contact.near:
        return JointCommand(told.positions, limits.current), set()
    return JointCommand(told.positions, limits.contact_current), {Rule.CURRENT}


def unchecked(now: Standing, inputs: Inputs, reasons: dict[Rule, str]) -> str:
    """Why the arm does not start."""
    if now.state is not State.UNCHECKED:
        return ""
    check = inputs.check
    if check is None or check.time_ns < now.since_ns:
        return "the servos have to be checked"
    return "; ".join((*check.mismatches, *reasons.values()))

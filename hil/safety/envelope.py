"""The safety envelope: what stands between where the arm is wanted and what is sent to it.

:func:`step` is called once a tick. It keeps no state of its own, reads no clock and sends nothing. Whoever calls it
sends the command that comes back, and nothing else, and records the report.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hil.drivers.values import JointCommand
from hil.safety import faults, motion, people
from hil.safety.limits import JOINTS, Limits
from hil.safety.motion import Motion
from hil.safety.people import Human, Points
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
    now, points = looked(limits, kinematics, before, inputs, now_ns)
    if points is not None and not _finite(points):
        points, reasons = None, {Rule.NOT_FINITE: "the kinematics of the arm are not finite"}
    told = None if now.motion is None else now.motion.positions
    reasons |= faults.faults(limits, now.watch, inputs.arm, told, inputs.health, now_ns)

    age_s = max(NEVER_S if inputs.human is None else 1e-9 * inputs.human.age_ns, 1e-9 * (now_ns - now.wanted_ns))
    event = happened(limits, now, inputs, bool(reasons), age_s)
    now = entered(limits, now, event, inputs, reasons, now_ns)
    acted = set(reasons)
    acted |= {BY_EVENT[event]} if event is not None and event in BY_EVENT else set()
    acted |= {Rule.START_UP} if now.state is State.UNCHECKED else set()

    human = known(limits, inputs.human)
    if points is not None and human is not None:
        now = replace(now, seen=people.remembered(limits.contact, now.seen, human, points, now_ns))
    share, closing = 1.0, None
    if now.motion is not None and now.state in MOVING:
        dt = min(max(now.watch.gap_s, 0.0), LATE_TICK * limits.timing.period_s)
        now, velocities, wanted, clamped = led(limits, now, now.motion, inputs.wanted, dt)
        share, closing, slowing = spared(limits, now, human, points, velocities, dt)
        acted |= clamped | slowing
        if now.motion is not None:
            now = replace(now, motion=motion.moved(now.motion, share * velocities, wanted, dt))

    gap = None if points is None or human is None else people.gap_to_hand(human, points)
    command, limited = commanded(limits, now.motion, gap)
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
    joints, reasons = (len(JOINTS),), {}
    wanted, arm, health, human = inputs.wanted, inputs.arm, inputs.health, inputs.human
    named: dict[str, list[tuple[str, Array, tuple[int, ...]]]] = {"wanted": [], "arm": [], "health": [], "human": []}
    if wanted is not None:
        named["wanted"] = [("wanted positions", wanted, joints)]
    if arm is not None:
        named["arm"] = [
            (f"the servos' {name}", getattr(arm, name), joints)
            for name in ("positions", "velocities", "currents", "errors", "answered")
        ]
    if health is not None:
        named["health"] = [
            (f"the servos' {name}", getattr(health, name), joints) for name in ("temperatures", "voltages")
        ]
    if human is not None:
        named["human"] = [
            (f"the person's {name}", array, (3,))
            for name, array in (("head", human.head), ("palm", human.palm), ("palm velocity", human.palm_velocity))
            if array is not None
        ]
    for name, arrays in named.items():
        if reason := faults.not_finite(arrays):
            inputs, reasons = replace(inputs, **{name: None}), {Rule.NOT_FINITE: reason}
    return inputs, reasons


def looked(
    limits: Limits, kinematics: Kinematics, before: Standing, inputs: Inputs, now_ns: int
) -> tuple[Standing, Points | None]:
    """What is carried on after a look at the clock and the arm; and where the arm's points are."""
    watch = faults.ticked(limits.timing, before.watch, now_ns)
    told = None if before.motion is None else before.motion.positions
    if inputs.arm is not None:
        watch = faults.looked(limits.servo, watch, inputs.arm, told, now_ns)
    now = replace(before, watch=watch, wanted_ns=before.wanted_ns if inputs.wanted is None else now_ns)
    if told is None:
        return now, None
    places, jacobians = kinematics(told)
    measured = places if inputs.arm is None else kinematics(inputs.arm.positions)[0]
    return now, Points(places, jacobians, measured)


def known(limits: Limits, human: Human | None) -> Human | None:
    """The person, unless that was too long ago to say where they are."""
    return human if human is not None and 1e-9 * human.age_ns <= limits.stale.retract_s else None


def led(
    limits: Limits, now: Standing, told: Motion, wanted: Array | None, dt: float
) -> tuple[Standing, Array, Array | None, set[Rule]]:
    """What the state asks for: velocities (J,), rad/s, within the limits of the joints.

    Returns:
        what is carried on, the velocities, where the joints are wanted within their limits, and the rules that acted.
    """
    velocities, within, acted = np.zeros(len(JOINTS)), None, set()
    if now.state is State.TRACKING and wanted is not None:
        within, outside = motion.position_wanted(limits, wanted)
        velocities, slower = motion.towards(limits, told, within, dt)
        acted = outside | slower
    elif now.state is State.RETRACTING:
        velocities, way_point = retracting(limits, told, now.way_point, dt)
        now = replace(now, way_point=way_point)
    velocities, clamped = motion.within_limits(limits, told, velocities, dt)
    return now, velocities, within, acted | clamped


def spared(
    limits: Limits, now: Standing, human: Human | None, points: Points | None, velocities: Array, dt: float
) -> tuple[float, float | None, set[Rule]]:
    """How much of the velocities (J,), rad/s, the person allows; see :func:`hil.safety.people.slowed`.

    Where the arm's points are not known it stands. A stop is only made quicker for a person whose place is known.
    """
    if points is None:
        return 0.0, None, set()
    if human is None and now.state is not State.RETRACTING:
        return 1.0, None, set()
    return people.slowed(limits, now.seen, human, points, velocities, dt)


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


def _finite(points: Points) -> bool:
    return all(np.isfinite(array).all() for array in (points.told, points.jacobians, points.measured))

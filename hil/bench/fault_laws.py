"""Laws that an arm keeps whatever goes wrong, judged by what its servos were commanded and where its body was."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.arm.loop import ArmTick
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.bench.black_box import STANDS, BlackBox
from highfive.hil.bench.laws import COUNT, PERSON_FIRST, ROUNDING, Laws
from highfive.hil.bench.motion_laws import judge_wire_motion, plates_as_known
from highfive.hil.drivers.bus.cycle_ring import Mode
from highfive.hil.drivers.values import JointCommand
from highfive.hil.safety.envelope import LATE_TICK
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.speeds import closing_speed, face_speed
from highfive.hil.safety.states import HALTED, State
from highfive.model.geometry.rotations import Array

_FEWEST = 3  # ticks
RELEASED, LAY = "torque off in a sound servo, rad from where the arm lay", 0.05
"""The law, and rad: as near to where a limp arm lay it does not fall."""

WAY_BACK = "reference: speed on the way back, rad/s"
_BEHIND, _MAKING_UP = 1.1, 4  # periods from which on a driver falls behind; steps in which it catches up after that
_SETTLED = 150  # rows of the box, ms, at its end in which the body stands


def judge_commands(laws: Laws, trial: ArmTrial, limits: Limits, arm: ServoArm) -> None:
    """Positions, speeds and accelerations that were commanded, near the person and anywhere.

    Args:
        laws: added to.
        trial: what the arm did; the way back is judged, too.
        limits: of the envelope.
        arm: the arm's kinematics.
    """
    trial = trial.with_back
    _judge_positions(laws, trial, limits)
    laws.judge("wire: speed, of what is allowed", _fastest_step(trial, limits), 1.0)
    judge_wire_motion(laws, trial, limits, arm)
    _judge_references(laws, trial, limits, arm)


def _judge_positions(laws: Laws, trial: ArmTrial, limits: Limits) -> None:
    """Within limits, or where the arm stood beyond them as it began; a goal to stay is where a servo said it was, in
    its own cycle or the one before."""
    beyond = -np.inf
    began = trial.cycles[0].state.positions
    stood = began
    for cycle in trial.cycles:
        if cycle.sent is not None:
            goals, own = cycle.sent.positions, began if cycle.mode is Mode.DRIVING else stood
            said = own if cycle.mode is Mode.DRIVING else cycle.state.positions
            high = np.maximum(limits.highest, np.maximum(own, said))
            low = np.minimum(limits.lowest, np.minimum(own, said))
            beyond = max(beyond, float(np.maximum(goals - high, low - goals).max()))
        stood = cycle.state.positions
    if np.isfinite(beyond):
        laws.judge("wire: position beyond its limit, rad", beyond, COUNT)


def _fastest_step(trial: ArmTrial, limits: Limits) -> float:
    """Largest step from one command to the next, of what is allowed in the time between them.

    A cycle that repeats a command is none of its own; the next step is then no larger than one of a late tick, unless
    the driver stood still: then goals make up for that time in the next steps (docs/safety.md), which count from the
    last goal before. What is allowed is what the envelope allows: the speed of the reference, and that at which goals
    may begin to lead it.
    """
    found, before, since_s, last_s, making_up = 0.0, None, 0.0, 0.0, 0
    late, rate = LATE_TICK * limits.timing.period_s, limits.speed + limits.feed_forward.speed
    newest: JointCommand | None = None
    for cycle in trial.cycles:
        if cycle.sent is None or cycle.mode is not Mode.DRIVING:
            before = newest = None
            continue
        now_s = 1e-9 * cycle.begun_ns
        if now_s - last_s > _BEHIND * limits.timing.period_s:
            making_up = _MAKING_UP
        if before is None or newest is None:
            before, since_s, making_up = cycle.sent, now_s, 0
        elif (cycle.sent.positions != newest.positions).any():
            seconds = now_s - since_s if making_up else min(now_s - since_s, late)
            step = np.abs(cycle.sent.positions - before.positions)
            found = max(found, float((step / (rate * seconds + 2.0 * COUNT)).max()))
            making_up = max(0, making_up - 1)
            if not making_up:
                before, since_s = cycle.sent, now_s
        newest, last_s = cycle.sent, now_s
    return found


def _judge_references(laws: Laws, trial: ArmTrial, limits: Limits, arm: ServoArm) -> None:
    """Where the joints were to be, without what goals lead it by, and without the rounding of the servos' counts."""
    follow = [
        (tick, reference)
        for tick in trial.ticks
        if (reference := tick.report.reference) is not None and tick.report.state not in HALTED
    ]
    if len(follow) < _FEWEST:
        return
    ticks, references = [it for it, _ in follow], np.array([it for _, it in follow])
    times, period = 1e-9 * np.array([it.report.time_ns for it in ticks]), limits.timing.period_s
    steps = np.clip(np.diff(times), 0.5 * period, LATE_TICK * period)  # what a tick moves by after a pause
    velocities = np.diff(references, axis=0) / steps[:, None]
    laws.judge("reference: speed, of what is allowed", float((np.abs(velocities) / limits.speed).max()), ROUNDING)
    first = np.array([bool(it.report.acted & PERSON_FIRST) or it.report.fraction < 1.0 for it in ticks])
    whole = np.diff(times) > 0.5 * period  # of two ticks in a hurry neither tells a velocity
    _judge_way_back(laws, ticks, np.abs(velocities), whole, limits)
    judged = whole[1:] & whole[:-1] & ~first[2:] & ~first[1:-1]
    change = np.abs(np.diff(velocities, axis=0)) / steps[1:, None] / limits.acceleration
    laws.judge("reference: acceleration, of what is allowed", float(change[judged].max(initial=0.0)), ROUNDING)
    none = np.full(3, np.nan)
    heads = np.array([none if it.goal.head is None else it.goal.head for it in ticks])
    palms = [it.goal.person for it in ticks]
    hands = np.array([none if it is None else it.position for it in palms])
    speeds = np.array([none if it is None else it.velocity for it in palms])
    points = np.array([arm.points(pose)[0] for pose in references])
    bodies = plates_as_known(trial, arm, times)
    closing = closing_speed(times, points[:, 0], hands, limits.contact, bodies, speeds)
    laws.judge_near("reference: closing speed near the hand, m/s", closing, limits.contact.speed * ROUNDING)
    face = face_speed(times, points, heads, limits.face)
    laws.judge_near("reference: speed near the head, m/s", face, limits.face.speed * ROUNDING)


def _judge_way_back(
    laws: Laws, ticks: Sequence[ArmTick], speeds: Array, whole: NDArray[np.bool_], limits: Limits
) -> None:
    """Slowly: who comes in faster, to begin with, only slows down.

    ``speeds`` (T - 1, J), rad/s, between ticks, of those that are ``whole`` (T - 1,).
    """
    back = np.array([it.report.state is State.RETRACTING for it in ticks])
    judged = back[2:] & back[1:-1] & whole[1:] & whole[:-1]
    faster = speeds[1:] * (speeds[1:] > speeds[:-1]) * judged[:, None]
    if judged.any():
        laws.judge(WAY_BACK, float(faster.max(initial=0.0)), limits.motion.retract * ROUNDING)


def judge_body(laws: Laws, box: BlackBox, limits: Limits) -> None:
    """Goal currents, what servos draw, where the body was, that nobody lets it fall, and whether it stands in the end.

    A joint that its servos have let down by themselves, by a fault of the bus, moves as it falls.
    """
    powered, sound = np.array(box.powered), np.array(box.sound)
    current = np.array([it.current for it in limits.joints])
    allowed = np.array(box.allowed)[powered.all(axis=1)]
    if len(allowed):
        laws.judge("goal current, of what is allowed", float((allowed / current).max()), 1.0 + 1e-3)
    drawn = np.array(box.currents)
    laws.judge("body: current, of what is allowed", float((drawn / current).max()), 1.0 + 1e-3)
    positions, velocities = np.array(box.positions), np.abs(np.array(box.velocities))
    low, high = np.array(limits.ceilings.mechanical).T
    beyond = np.maximum(positions - high, low - positions)
    laws.judge("body: position beyond its stop, rad", float(beyond.max()), 0.05)
    on = np.flatnonzero(powered.any(axis=1))
    if not len(on):  # it lies limp as it fell when the plant was switched on
        return
    moving = (velocities / limits.speed)[on[0] :][sound[on[0] :]]
    laws.judge("body: speed, of what is allowed", float(moving.max(initial=0.0)), 1.25)
    # As the servos are switched on they may be let go of again, over a mismatch: where it lay, the arm does not fall.
    away = np.abs(positions - positions[on[0]]).max(axis=1)[np.array(box.released).any(axis=1)]
    laws.judge(RELEASED, float(away.max(initial=0.0)), LAY)
    if sound[-_SETTLED:].all():
        laws.judge("body: speed in the end, rad/s", float(velocities[-_SETTLED:].max()), STANDS)

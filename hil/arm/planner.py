"""Retargeting: the avatar's palm, and where and when the palms will meet, to joint positions of the servo arm.

Every tick a plan of the next moments is improved, not made anew (model predictive control, warm-started): joint
accelerations at N knots that reach up to the expected contact and a little beyond. The place and time of contact count
as much as the forecast is sure of them, the avatar's style less: the plate follows a copy of the avatar's palm path,
scaled about the place of contact, so that its speed profile and its direction of approach are the avatar's. Limits,
distances and the largest speed relative to the person's hand are costs in the plan, and what the first step of the plan
still breaks is cut off (:func:`highfive.hil.arm.planning_limits.next_state`). The arm follows its commands late: the
plan runs ahead of time by that lag.

State in, state out: the same inputs give the same outputs.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from highfive.hil.arm import optimal_control
from highfive.hil.arm.optimal_control import Planned
from highfive.hil.arm.planner_settings import PlanSettings, RetargetSettings
from highfive.hil.arm.planner_values import (
    CONTACT_KNOT,
    KNOTS,
    ArmStep,
    ConstraintRelaxation,
    ExpectedContact,
    PalmGoal,
    RetargetState,
)
from highfive.hil.arm.planning_task import Task
from highfive.hil.arm_model import dynamics
from highfive.hil.arm_model.servo_arm import ServoArm, solve
from highfive.hil.sim.profiles import minimum_jerk
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array

READY_WEIGHT = 0.5
"""1/rad²: how much the ready posture counts while nobody is waited for."""
CLEAR = 0.1
"""m, from the zone around a face: nearer than this no plate waits, further than twice this it waits where it will."""
FULLY = 0.2
"""m a radian: ``facing`` of an arm that can turn its plate as it likes."""


LAG_BY_DATA, LAG_MEASURED = "the servos' data", "measured by calibrate latency"
"""Where the lag is from by which is planned ahead."""


class Retarget:
    """The arm, its ready posture and the settings: what does not change from tick to tick."""

    def __init__(
        self, arm: ServoArm, ready: Array, settings: RetargetSettings | None = None, plan: PlanSettings | None = None,
        *, lag_from: str = LAG_BY_DATA,
    ) -> None:  # fmt: skip
        """Compiles what has to be compiled; ``lag_from`` says where the lag in ``settings`` is from."""
        self.arm, self.ready, self.lag_from = arm, np.array(ready, float), lag_from
        self.settings = settings or RetargetSettings()
        self.plan = plan or PlanSettings()
        self._plan = self.plan.compiled()
        ready_plate = arm.plate_at(self.ready)
        self._ready_normal = ready_plate.normal
        self._low, self._high = arm.packed.low, arm.packed.high
        s = self.settings
        self._face = np.array([s.yielding * s.face_speed, s.face_radius, s.yielding * s.face_braking])
        self._sag = np.array(self.settings.sag) if self.settings.sag else None
        self._places, self._postures = b"", (np.empty((0, len(self.ready))), np.empty(0))
        self._nobody = PalmPose(ready_plate.position, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.zeros(3))
        # What a tick and the judgement of a high five call: with torque on, nobody may wait until it is compiled.
        arm.points(self.ready)
        arm.gravity(self.ready)
        solve(arm, ready_plate.position, ready_plate.normal, self.ready)
        dynamics.quickest(arm.packed, self.ready, self.ready)
        self.step(self.start(), PalmGoal(self._nobody))

    def start(self, joints: Array | None = None) -> RetargetState:
        """The state of an arm at rest, by default in its ready posture."""
        where = self.ready if joints is None else np.clip(joints, self.arm.packed.low, self.arm.packed.high)
        still = np.zeros(len(where))
        return RetargetState(np.array(where, float), still, np.zeros((KNOTS, len(where))), np.array(where, float))

    def moved(self, state: RetargetState, joints: Array, speeds: Array) -> RetargetState:
        """The state of an arm that was led elsewhere: joints (J,), rad, and speeds (J,), rad/s."""
        packed = self.arm.packed
        return replace(state, joints=np.clip(joints, packed.low, packed.high), speeds=speeds)

    def step(self, state: RetargetState, goal: PalmGoal, seconds: float | None = None) -> tuple[RetargetState, ArmStep]:
        """One tick. Whatever the goal says, the command is finite and inside every limit.

        Args:
            state: after the last tick.
            goal: of this one.
            seconds: since the last tick, s: the joints go on by so much; by default ``settings.tick``.
        """
        s = self.settings
        dt = s.tick if seconds is None else seconds
        goal = goal if _sane(goal) else PalmGoal(self._nobody)
        unsaid = 0.0 if goal.contact is not None else state.unsaid + dt
        goal = self._carried_on(state, goal, dt)
        state = self._entered(state, goal)
        task = self._task(state, goal)
        accelerations = _shifted(state, dt, task.seconds)
        plan = optimal_control.planned(
            self.arm.packed, task, state.joints, state.speeds, accelerations, state.guess, dt, s.rounds
        )
        accelerations = plan.accelerations if math.isfinite(plan.cost) else np.zeros_like(accelerations)
        command = (
            plan.joints if self._sag is None else np.clip(plan.joints + plan.torques * self._sag, self._low, self._high)
        )
        step = ArmStep(command, plan.joints, plan.speeds, plan.torques, max(task.time, 0.0), plan.miss, plan.active)
        late, together, relaxation = self._accounted(state, goal, task, plan, dt)
        state = RetargetState(
            plan.joints, plan.speeds, accelerations, plan.guess, task.seconds, state.scale, state.given, late, together,
            relaxation, goal.contact, unsaid,
        )  # fmt: skip
        return state, step

    def _carried_on(self, state: RetargetState, goal: PalmGoal, dt: float) -> PalmGoal:
        """The goal; a contact no longer spoken of is believed in for a while, a late one until it was met."""
        person, s, said = goal.person, self.settings, state.said
        if goal.contact is not None:
            return goal
        if said is not None and state.late == 0.0 and state.unsaid < s.memory and said.time > dt:
            covariance = said.covariance + (s.forgetting * dt) ** 2 * np.eye(3)
            return replace(goal, contact=replace(said, time=said.time - dt, covariance=covariance))
        over = state.late == 0.0 or state.late > s.longest_delay or state.together > s.touch
        if person is None or over or not self._waits(state, person):
            return goal
        return replace(goal, contact=ExpectedContact(person.position, np.zeros((3, 3)), -person.normal, 0.0))

    def _waits(self, state: RetargetState, person: PalmPose) -> bool:
        """The hand is still there to be met: it hardly moves, near the plate."""
        away = float(np.linalg.norm(self.arm.plate_at(state.joints).position - person.position))
        return away < self.settings.near and float(np.linalg.norm(person.velocity)) < self.settings.waiting

    def _entered(self, state: RetargetState, goal: PalmGoal) -> RetargetState:
        """Begins or ends a high five."""
        if goal.contact is None:
            return state if state.scale is None else replace(state, scale=None, late=0.0, together=0.0)
        if state.scale is not None:
            return state
        ours = np.linalg.norm(self.arm.plate_at(state.joints).position - goal.contact.point)
        theirs = np.linalg.norm(goal.palm.position - goal.contact.point)
        scale = float(np.clip(ours / max(theirs, 1e-3), 0.1, 1.0))
        given = max(goal.contact.time, self.settings.tick)
        relaxation = ConstraintRelaxation(scale)
        begun = replace(state, scale=scale, given=given, relaxation=relaxation)
        return replace(begun, guess=state.joints, late=0.0, together=0.0)

    def _task(self, state: RetargetState, goal: PalmGoal) -> Task:
        s, contact, person = self.settings, goal.contact, goal.person
        head = _NO_HEAD if goal.head is None else np.array([*goal.head, s.head_radius])
        hand, hand_velocity, cap = _NOWHERE, _NOWHERE, math.inf
        if person is not None:
            hand, hand_velocity = person.position + s.lag * person.velocity, person.velocity
            cap = s.yielding * s.contact_speed
        if contact is None:
            rest, counts = self._awaiting(goal)
            return Task(
                math.inf, _NOWHERE, self._ready_normal, _UNSURE, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, _NOWHERE,
                _NOWHERE, 1.0, hand, hand_velocity, _NOWHERE, cap, rest, counts, head, self._face,
                10.0 * s.effort, s.calm, 0.05, self._plan,
            )  # fmt: skip
        time = contact.time - s.lag
        closing, braked = self._meeting_speed(goal)
        normal, firm = self._normal(contact)
        scale = 1.0 if state.scale is None else state.scale
        press = s.most_press if state.late > 0.0 else min(s.press * closing, s.most_press)
        freedom = self._hurry(state, contact) ** 4
        return Task(
            time, contact.point, normal, contact.covariance, s.sharpness, firm,
            closing, s.settle + s.beforehand * (1.0 - 1.0 / freedom), s.standoff, press, state.late > 0.0,
            scale * (goal.palm.position - contact.point), scale * goal.palm.velocity, s.loose * freedom,
            hand, hand_velocity, braked, cap,
            self.ready, 1e-3, head, self._face, s.effort, s.calm,
            min(max(time / CONTACT_KNOT, s.shortest_knot), s.longest_knot), self._plan,
        )  # fmt: skip

    def _awaiting(self, goal: PalmGoal) -> tuple[Array, float]:
        """The posture in which to wait, (J,) rad, and how much it counts.

        It is nearest, in joints, to those that meet the hypotheses, each as likely as it is; short of a face, the ready
        posture has the more of it the nearer the plate would be.
        """
        s, hypotheses = self.settings, goal.hypotheses
        if hypotheses is None:
            return self.ready, READY_WEIGHT
        joints, known = self._meeting(hypotheses.points)
        weights = hypotheses.weights * known
        if weights.sum() <= 0.0:
            return self.ready, READY_WEIGHT
        rest = weights @ joints / weights.sum()
        if goal.head is not None:
            away = float(np.linalg.norm(self.arm.plate_at(rest).position - goal.head)) - s.face_radius
            rest = self.ready + min(max(away / CLEAR - 1.0, 0.0), 1.0) * (rest - self.ready)
        return rest, s.waits

    def _meeting(self, points: Array) -> tuple[Array, Array]:
        """Postures (K, J), rad, in which the plate waits before points (K, 3), m, and which of them it reaches (K,)."""
        key = points.tobytes()
        if key != self._places:
            before = points - self.settings.back * _AHEAD - np.array([0.0, 0.0, self.settings.below])
            found = [solve(self.arm, point, _AHEAD, self.ready) for point in before]
            joints = np.array([posture for posture, _ in found])
            self._postures = joints, np.array([miss < self.settings.back for _, miss in found])
            self._places = key
        return self._postures

    def _hurry(self, state: RetargetState, contact: ExpectedContact) -> float:
        """How many times faster than leisurely the plate has to be; at least 1."""
        s = self.settings
        distance = float(np.linalg.norm(self.arm.plate_at(state.joints).position - contact.point))
        return max(1.0, distance / max(contact.time - s.lag - s.settle, 0.05) / s.leisurely)

    def _normal(self, contact: ExpectedContact) -> tuple[Array, float]:
        """Where the plate shall face (3,), and how much that counts."""
        s = self.settings
        fraction = float(minimum_jerk(1.0 - contact.time / s.facing))
        normal = (1.0 - fraction) * self._ready_normal + fraction * contact.normal
        normal /= max(math.sqrt(normal @ normal), 0.1)
        able = (self.arm.folder.facing / FULLY) ** 2
        return normal, able / (s.turned + s.turning * contact.time) ** 2

    def _meeting_speed(self, goal: PalmGoal) -> tuple[float, Array]:
        """m/s, at which the plate closes on the hand along its normal, and the hand's velocity (3,) then."""
        assert goal.contact is not None
        if goal.person is None:
            return 0.2, _NOWHERE
        normal = goal.contact.normal
        fraction = min(max(1.0 - goal.contact.time / 0.3, 0.0), 1.0)  # the hand will have braked until then
        hand = fraction * goal.person.velocity
        own = min(max(float(goal.palm.velocity @ normal), self.settings.slowest), 1.0)
        most = 0.75 * self.settings.care * self.settings.contact_speed
        if goal.head is not None and float(np.linalg.norm(goal.contact.point - goal.head)) < self.settings.face_radius:
            most = self.settings.care * self.settings.face_speed
        return min(max(own - float(hand @ normal), min(self.settings.slowest, most)), most), hand

    def _accounted(
        self, state: RetargetState, goal: PalmGoal, task: Task, plan: Planned, dt: float
    ) -> tuple[float, float, ConstraintRelaxation]:
        """Notes what had to be given up: s since contact was due, s since the plate is there, and what was relaxed."""
        s, known, contact = self.settings, state.relaxation, goal.contact
        if contact is None:
            return state.late, state.together, known
        late = state.late + dt if contact.time == 0.0 else 0.0
        off = plan.plate - contact.point - max(0.0, s.lag - contact.time) * task.hand_velocity
        away = math.sqrt(off @ off)
        together = state.together + dt if late > 0.0 and (away < s.met or state.together > 0.0) else 0.0
        if late > 0.0 and state.together == 0.0:  # it was due and is not there, or is there just now
            delay = state.late if together > 0.0 else late
            miss = away if state.late == 0.0 else known.miss
            known = replace(known, delay=delay, time_scale=1.0 + delay / state.given, miss=miss)
        limits = known.limits | plan.active
        return late, together, known if limits == known.limits else replace(known, limits=limits)


_AHEAD = np.array([1.0, 0.0, 0.0])  # where avatar and arm look, and people come from
_NOWHERE, _NO_HEAD, _UNSURE = np.zeros(3), np.zeros(4), np.eye(3)


def _sane(goal: PalmGoal) -> bool:
    """Every number of the goal is one: what is not is as if nobody were there."""
    palms = [palm for palm in (goal.palm, goal.person) if palm is not None]
    parts = [part for palm in palms for part in (palm.position, palm.normal, palm.velocity)]
    parts += [] if goal.head is None else [goal.head]
    if goal.contact is not None:
        parts += [goal.contact.point, goal.contact.normal, goal.contact.covariance.ravel(), [goal.contact.time]]
    if goal.hypotheses is not None:
        parts += [goal.hypotheses.weights, goal.hypotheses.points.ravel()]
    return bool(np.isfinite(np.concatenate(parts)).all())


def _shifted(state: RetargetState, tick: float, knot: float) -> Array:
    """The last plan as seen one tick later, at knots ``knot`` s apart."""
    begin = (np.arange(KNOTS) * knot + tick) / state.knot
    index = np.minimum(begin.astype(int), KNOTS - 1)
    fraction = (begin - index)[:, None]
    following = np.minimum(index + 1, KNOTS - 1)
    fraction = np.minimum(fraction, 1.0)
    return (1.0 - fraction) * state.accelerations[index] + fraction * state.accelerations[following]

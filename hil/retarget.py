"""Retargeting: the avatar's palm, and where and when the palms will meet, to joint positions of the servo arm.

Every tick a plan of the next moments is improved, not made anew (model predictive control, warm-started): joint
accelerations at N knots that reach up to the expected contact and a little beyond. The place and time of contact count
as much as the forecast is sure of them, the avatar's style less: the plate follows a copy of the avatar's palm path,
scaled about the place of contact, so that its speed profile and its direction of approach are the avatar's. Limits,
distances and the largest speed relative to the person's hand are costs in the plan, and what the first step of the plan
still breaks is cut off (:func:`hil.arm_motion.moved_on`). The arm follows its commands late: the plan runs ahead of
time by that lag.

State in, state out: the same inputs give the same outputs.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hil import arm_motion
from hil.arm_motion import Aim
from hil.profiles import minimum_jerk
from hil.servo_arm import JOINTS, ServoArm
from mocap_bridge.frames import PalmPose
from model.rotations import Array

KNOTS = 12
CONTACT_KNOT = 10
"""Of those, the one at the expected contact, as long as it is further than so many ticks away."""


@dataclass(frozen=True)
class RetargetSettings:
    """Times in s, lengths in m, speeds in m/s."""

    tick: float = 1.0 / 120.0
    lag: float = 0.03
    """The arm is where it was told to be so long ago."""
    sag: tuple[float, ...] = ()
    """rad per N·m, by how much each joint gives way to a torque; the command goes beyond by that. Empty: 0."""
    contact_speed: float = 0.78
    """Largest speed of the plate relative to the hand that it meets (ISO/TS 15066 by a two-body model)."""
    face_speed: float = 0.22
    """The same, where the head is near."""
    face_radius: float = 0.25
    """A contact so near the head's centre is in the face zone."""
    head_radius: float = 0.14
    """No part of the arm plans to come nearer the head's centre than this and a margin."""
    care: float = 0.8
    """Share of those speeds that is planned for: what is measured is late and noisy."""
    sharpness: float = 0.002
    """Deviation of the place of contact that the plan does not tell from none."""
    loose: float = 0.08
    """Deviation from the scaled path that costs as much as one standard deviation of the place of contact."""
    turned: float = 0.20
    """rad, the same for the direction in which the plate faces at contact, ..."""
    turning: float = 1.5
    """... which is surer by this many rad for each s nearer: a hand on its way faces elsewhere."""
    facing: float = 0.3
    """s before contact within which the plate turns from where it faces when it waits to the person's palm."""
    rounds: int = 1
    """Improvements of the plan a tick: the next tick goes on from there (real-time iteration, Diehl et al. 2005)."""
    effort: float = 3e-5
    """Cost of a joint acceleration of 1 rad/s² at a knot."""
    longest_delay: float = 0.3
    """A hand that could not be met in time is followed at most so long."""
    touch: float = 0.06
    """The plate stays with a hand that it has met so long."""
    near: float = 0.10
    waiting: float = 0.15
    """A hand that could not be met in time is followed only if it is this near and no faster than this, m/s."""
    press: float = 0.018
    most_press: float = 0.02
    """The plate aims so far through the hand as the two close in this time, s, but no further than this, m: a hand that
    is not met goes back, and the contact is then missed altogether."""
    met: float = 0.004
    """A commanded plate this near the place of contact is there."""
    longest_knot: float = 0.07


@dataclass(frozen=True)
class ExpectedContact:
    """Where and when the palms will meet.

    Attributes:
        point: (3,) m, in the world.
        covariance: (3, 3) m².
        normal: (3,) unit vector out of the plate.
        time: s from now; 0 while the palms touch.
    """

    point: Array
    covariance: Array
    normal: Array
    time: float


@dataclass(frozen=True)
class PalmGoal:
    """What the session asks of the arm in one tick.

    Attributes:
        palm: the avatar's palm.
        person: the person's palm; None where nobody knows it.
        head: (3,) m, centre of the person's head, or None.
        contact: None while no high five is on.
    """

    palm: PalmPose
    person: PalmPose | None = None
    head: Array | None = None
    contact: ExpectedContact | None = None


@dataclass(frozen=True)
class Sacrifice:
    """What a high five had to give up.

    Attributes:
        scale: size of the plate's path beside the avatar's palm's.
        delay: s, by how much the plate came late.
        time_scale: the time that the approach took over the time that was left when it began.
        miss: m, distance of the commanded plate from the place of contact when contact was due.
        limits: bits of :mod:`hil.arm_motion` of the limits that shortened a step.
    """

    scale: float = 1.0
    delay: float = 0.0
    time_scale: float = 1.0
    miss: float = 0.0
    limits: int = 0

    @property
    def limit_names(self) -> tuple[str, ...]:
        """The limits in words."""
        names = ("acceleration", "speed", "joint stop", "torque", "nearness")
        return tuple(name for bit, name in enumerate(names) if self.limits >> bit & 1)


@dataclass(frozen=True)
class RetargetState:
    """What one tick hands to the next.

    Attributes:
        joints, speeds: (J,) rad and rad/s, as commanded.
        pushes: (N, J) rad/s², the plan; its knots are ``knot`` s apart.
        knot: s.
        scale: of the avatar's path about the contact; None between high fives.
        given: s that were left when this approach began.
        late: s since contact was due.
        together: s since the commanded plate was there.
        sacrifice: of the high five that is on, or was last.
    """

    joints: Array
    speeds: Array
    pushes: Array = field(default_factory=lambda: np.zeros((KNOTS, JOINTS)))
    knot: float = 0.05
    scale: float | None = None
    given: float = 0.0
    late: float = 0.0
    together: float = 0.0
    sacrifice: Sacrifice = Sacrifice()


@dataclass(frozen=True)
class ArmStep:
    """One tick's command.

    Attributes:
        positions: (J,) rad, the command: where the joints shall be, and beyond by what they give way.
        joints, speeds: (J,) rad and rad/s, where they shall be a lag after the end of the tick.
        torques: (J,) N·m, that this takes, gravity and friction included.
        time: s until the commanded plate should meet the hand; infinite between high fives.
        miss: m, planned distance from the place of contact then.
        limits: bits of the limits that shortened this step.
    """

    positions: Array
    joints: Array
    speeds: Array
    torques: Array
    time: float
    miss: float
    limits: int


class Retarget:
    """The arm, its ready posture and the settings: what does not change from tick to tick."""

    def __init__(self, arm: ServoArm, ready: Array, settings: RetargetSettings | None = None) -> None:
        """Compiles what has to be compiled."""
        self.arm, self.ready = arm, np.array(ready, float)
        self.settings = settings or RetargetSettings()
        ready_plate = arm.plate_at(self.ready)
        self._ready_normal = ready_plate.normal
        self._nobody = PalmPose(ready_plate.position, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.zeros(3))
        self.step(self.start(), PalmGoal(self._nobody))

    def start(self, joints: Array | None = None) -> RetargetState:
        """The state of an arm at rest, by default in its ready posture."""
        where = self.ready if joints is None else np.clip(joints, self.arm.packed.low, self.arm.packed.high)
        return RetargetState(np.array(where, float), np.zeros(JOINTS))

    def moved(self, state: RetargetState, joints: Array, speeds: Array) -> RetargetState:
        """The state of an arm that was led elsewhere: joints (J,), rad, and speeds (J,), rad/s."""
        packed = self.arm.packed
        return replace(state, joints=np.clip(joints, packed.low, packed.high), speeds=speeds)

    def step(self, state: RetargetState, goal: PalmGoal) -> tuple[RetargetState, ArmStep]:
        """One tick. Whatever the goal says, the command is finite and inside every limit."""
        s = self.settings
        goal = self._carried_on(state, goal if _sane(goal) else PalmGoal(self._nobody))
        state = self._entered(state, goal)
        time, knot = self._timing(state, goal)
        aim = self._aim(state, goal, time, knot)
        pushes = _shifted(state, s.tick, knot)
        plan = arm_motion.planned(self.arm.packed, aim, state.joints, state.speeds, pushes, s.tick, s.rounds)
        pushes = plan.pushes if np.isfinite(plan.cost) else np.zeros_like(pushes)
        state = replace(state, joints=plan.joints, speeds=plan.speeds, pushes=pushes, knot=knot)
        told = (
            plan.joints
            if not s.sag
            else np.clip(plan.joints + plan.torques * np.array(s.sag), self.arm.packed.low, self.arm.packed.high)
        )
        if goal.contact is None:
            return state, ArmStep(told, plan.joints, plan.speeds, plan.torques, np.inf, 0.0, plan.active)
        index = min(max(round(time / knot) - 1, 0), KNOTS - 1)
        miss = float(np.linalg.norm(plan.points[index] - aim.points[index]))
        state = self._accounted(state, goal, plan.active)
        return state, ArmStep(told, plan.joints, plan.speeds, plan.torques, max(time, 0.0), miss, plan.active)

    def _carried_on(self, state: RetargetState, goal: PalmGoal) -> PalmGoal:
        """The goal; a hand that the plate is late for is followed until it was met."""
        person, s = goal.person, self.settings
        over = state.late == 0.0 or state.late > s.longest_delay or state.together > s.touch
        if goal.contact is not None or person is None or over or not self._waits(state, person):
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
        return replace(state, scale=scale, given=given, late=0.0, together=0.0, sacrifice=Sacrifice(scale))

    def _timing(self, state: RetargetState, goal: PalmGoal) -> tuple[float, float]:
        """Time until the command should be at contact, and between knots, s."""
        s = self.settings
        if goal.contact is None:
            return np.inf, 0.05
        time = goal.contact.time - s.lag - state.late
        return time, float(np.clip(time / CONTACT_KNOT, s.tick, s.longest_knot))

    def _aim(self, state: RetargetState, goal: PalmGoal, time: float, knot: float) -> Aim:
        s, ready = self.settings, self.ready
        times = knot * np.arange(1, KNOTS + 1)
        blank, none = np.zeros((KNOTS, 3)), np.zeros(KNOTS)
        head = np.zeros(4) if goal.head is None else np.array([*goal.head, s.head_radius])
        hands, hand_speeds, caps = self._hands(goal, times)
        contact = goal.contact
        if contact is None:
            return Aim(
                knot, blank, np.zeros((KNOTS, 3, 3)), blank, none, blank, none, hands, hand_speeds, caps,
                ready, np.full(KNOTS, 0.5), head, 10.0 * s.effort,
            )  # fmt: skip
        meeting = times >= time - 0.5 * knot
        speed = self._contact_velocity(goal)
        hand = np.zeros(3) if goal.person is None else goal.person.velocity
        after = np.clip(times - time, 0.0, None)[:, None]
        place = self._place(goal)
        points = np.where(meeting[:, None], place + after * hand, self._styled(state, goal, time, times, speed))
        sure = np.linalg.inv(contact.covariance + s.sharpness**2 * np.eye(3))
        weights = np.where(meeting[:, None, None], sure, knot / 0.05 * np.eye(3) / s.loose**2)
        normals, firm = self._normals(goal, meeting)
        velocities = np.where(meeting[:, None], speed, 0.0)
        first = meeting & (times < time + 1.5 * knot)
        return Aim(
            knot, points, weights, normals, firm,
            velocities, np.where(first, 5.0, 0.0), hands, hand_speeds, caps,
            ready, np.full(KNOTS, 1e-3), head, s.effort,
        )  # fmt: skip

    def _normals(self, goal: PalmGoal, meeting: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Where the plate shall face (N, 3), and how much that counts (N,)."""
        assert goal.contact is not None
        s, left = self.settings, goal.contact.time
        share = float(minimum_jerk(1.0 - left / s.facing))
        normal = (1.0 - share) * self._ready_normal + share * goal.contact.normal
        normal /= max(float(np.linalg.norm(normal)), 0.1)
        firm = 1.0 / (s.turned + s.turning * left) ** 2
        return np.tile(normal, (KNOTS, 1)), np.where(meeting, firm, 0.05 * firm)

    def _place(self, goal: PalmGoal) -> Array:
        """Where the command should meet the hand, (3,) m: once it is due, where the hand will be when the arm obeys."""
        assert goal.contact is not None
        ahead = max(0.0, self.settings.lag - goal.contact.time)
        if goal.person is None:
            return goal.contact.point
        closing = (self._contact_velocity(goal) - goal.person.velocity) @ goal.contact.normal
        press = min(self.settings.press * max(float(closing), 0.0), self.settings.most_press)
        return goal.contact.point + ahead * goal.person.velocity + press * goal.contact.normal

    def _hands(self, goal: PalmGoal, times: NDArray) -> tuple[Array, Array, Array]:
        """The person's palm (N, 3), m, its velocity (N, 3), m/s, and the speeds (N,) at which it may be met."""
        s = self.settings
        if goal.person is None:
            return np.zeros((KNOTS, 3)), np.zeros((KNOTS, 3)), np.full(KNOTS, np.inf)
        ahead = (times + s.lag)[:, None]
        fading = np.exp(-ahead / 0.3)
        places = goal.person.position + goal.person.velocity * 0.3 * (1.0 - fading)
        return places, goal.person.velocity * fading, np.full(KNOTS, s.care * self._cap(goal))

    def _cap(self, goal: PalmGoal) -> float:
        """Largest relative speed, m/s, at the place where the palms will meet, or at the hand."""
        s = self.settings
        where = goal.person.position if goal.contact is None and goal.person else None
        where = goal.contact.point if goal.contact is not None else where
        if goal.head is None or where is None:
            return s.contact_speed
        near = float(np.linalg.norm(where - goal.head)) < s.face_radius
        return s.face_speed if near else s.contact_speed

    def _contact_velocity(self, goal: PalmGoal) -> Array:
        """Velocity (3,), m/s, of the plate at contact: the hand's, and closing on it along the normal."""
        assert goal.contact is not None
        if goal.person is None:
            return 0.2 * goal.contact.normal
        hand, normal = goal.person.velocity, goal.contact.normal
        share = float(np.clip(1.0 - goal.contact.time / 0.3, 0.0, 1.0))  # the hand will have braked until then
        hand = share * hand
        own = float(np.clip(goal.palm.velocity @ normal, 0.05, 1.0))
        most = 0.75 * self.settings.care * self._cap(goal)
        closing = float(np.clip(own - hand @ normal, min(0.08, most), most))
        return hand + closing * normal

    def _styled(self, state: RetargetState, goal: PalmGoal, time: float, times: NDArray, speed: Array) -> Array:
        """Places (N, 3) on the avatar's way to contact, from where it is, scaled about the contact: a cubic."""
        assert goal.contact is not None
        scale = 1.0 if state.scale is None else state.scale
        away = scale * (goal.palm.position - goal.contact.point)
        drift, length = scale * goal.palm.velocity, max(time, self.settings.tick)
        x = np.clip(times / length, 0.0, 1.0)[:, None]
        cubic = away * (1.0 - x) ** 2 * (1.0 + 2.0 * x) + length * x * (1.0 - x) * (drift * (1.0 - x) - speed * x)
        return goal.contact.point + cubic

    def _accounted(self, state: RetargetState, goal: PalmGoal, active: int) -> RetargetState:
        """Notes what had to be given up."""
        assert goal.contact is not None
        s, known = self.settings, state.sacrifice
        late = state.late + s.tick if goal.contact.time == 0.0 else 0.0
        away = float(np.linalg.norm(self.arm.plate_at(state.joints).position - self._place(goal)))
        together = state.together + s.tick if late > 0.0 and (away < s.met or state.together > 0.0) else 0.0
        if late > 0.0 and state.together == 0.0:  # it was due and is not there, or is there just now
            delay = state.late if together > 0.0 else late
            miss = away if state.late == 0.0 else known.miss
            known = replace(known, delay=delay, time_scale=1.0 + delay / state.given, miss=miss)
        return replace(state, late=late, together=together, sacrifice=replace(known, limits=known.limits | active))


def _sane(goal: PalmGoal) -> bool:
    """Every number of the goal is one: what is not is as if nobody were there."""
    palms = [palm for palm in (goal.palm, goal.person) if palm is not None]
    parts = [part for palm in palms for part in (palm.position, palm.normal, palm.velocity)]
    parts += [] if goal.head is None else [goal.head]
    if goal.contact is not None:
        parts += [goal.contact.point, goal.contact.normal, goal.contact.covariance.ravel(), [goal.contact.time]]
    return bool(np.isfinite(np.concatenate(parts)).all())


def _shifted(state: RetargetState, tick: float, knot: float) -> Array:
    """The last plan as seen one tick later, at knots ``knot`` s apart."""
    begin = (np.arange(KNOTS) * knot + tick) / state.knot
    index = np.minimum(begin.astype(int), KNOTS - 1)
    share = (begin - index)[:, None]
    following = np.minimum(index + 1, KNOTS - 1)
    return (1.0 - np.minimum(share, 1.0)) * state.pushes[index] + np.minimum(share, 1.0) * state.pushes[following]

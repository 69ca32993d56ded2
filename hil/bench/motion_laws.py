"""How fast and how suddenly wire and body moved, near the person and anywhere: laws beside those of the references.

What goes over the wire is whole counts of the servos (2π / 4096 rad), a cycle at a time: one count more or less in one
cycle is 0.18 rad/s, and 22 rad/s². Speeds and accelerations are therefore taken over :data:`CYCLES` cycles, about as
long as a servo of the arm lags. What rounding by half a count a joint can add at the most is taken off.

The body is where the emulated plant has it, every ms, not what the servos say. It follows a lag later: a hand that
turns meanwhile closes in faster than anybody commanded (docs/safety.md has by how much). What the arm owes is that the
body moves as it was to when it was commanded: against the hand's velocity as it was known a lag before.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from highfive.hil.arm.arm_trial import MISSED, ArmTrial, rows_at
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.laws import COUNT, PERSON_FIRST, Laws
from highfive.hil.drivers.bus.cycle_ring import Mode
from highfive.hil.safety.limits import Contact, Limits
from highfive.hil.safety.speeds import closing_speed, face_speed
from highfive.hil.safety.states import State
from highfive.hil.session.session import RATE_HZ
from highfive.model.geometry.rotations import Array

CYCLES = 4
"""Of the bus, over which the wire's speeds are taken."""

WIRE_ROUNDING = 1.05
"""Ticks between which an acceleration is taken are up to a tenth nearer or further than the cycles that sent them."""

BODY_ACCELERATION, BODY_CLOSING, BODY_NEAR_HEAD = 1.5, 1.75, 1.5
"""Of what is allowed: a servo makes up for its lag by being faster than its goal, the more where a hand was hidden and
seen again. The worst of 10,000 schedules were 1.44, 1.66 and 1.30."""

LAG_S, SPAN_MS = 0.03, 25
"""s: the body is where it was commanded to be so long ago; ms over which the body's acceleration is taken."""


@dataclass(frozen=True)
class PersonAsKnown:
    """What the ticks knew of the person, and what they did, at the ticks' times.

    Attributes:
        trial: whose ticks.
    """

    trial: ArmTrial

    @cached_property
    def times(self) -> Array:
        """(T,) s."""
        return 1e-9 * np.array([tick.report.time_ns for tick in self.trial.ticks])

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Palm, m, its velocity, m/s, and head, m, each (N, 3), NaN where not known, at ``times`` (N,), s."""
        palm, velocity, head = (rows_at(times, self.times, rows) for rows in self.trial.person)
        return palm, velocity, head

    def while_tracking(self, times: Array) -> NDArray[np.bool_]:
        """(N,) bool: the newest tick at ``times`` (N,), s, led the arm."""
        tracking = np.array([tick.report.state is State.TRACKING for tick in self.trial.ticks])
        newest = np.maximum(np.searchsorted(self.times, times, side="right") - 1, 0)
        return tracking[newest] & (self.ages(times) <= MISSED / RATE_HZ)

    def ages(self, times: Array) -> Array:
        """(N,) s, of the newest tick at ``times`` (N,), s; infinite before the first."""
        newest = np.searchsorted(self.times, times, side="right") - 1
        return np.where(newest >= 0, times - self.times[np.maximum(newest, 0)], np.inf)

    def person_first(self) -> Array:
        """(F,) s, times of ticks in which person, or position, came before acceleration."""
        first = [bool(it.report.acted & PERSON_FIRST) or it.report.fraction < 1.0 for it in self.trial.ticks]
        return self.times[np.array(first)]


def plates_as_known(trial: ArmTrial, arm: ServoArm, times: Array) -> Array:
    """(N, 3) m, where the plate was as the servos had last said at ``times`` (N,), s: there a tick's line begins."""
    newest = trial.known_at(times - 1e-9 * trial.ticks[0].frame_ns)
    return np.array([arm.points(trial.actual[number])[0][0] for number in newest])


def judge_wire_motion(laws: Laws, trial: ArmTrial, limits: Limits, arm: ServoArm) -> None:
    """Goals as they went over the wire, while cycles came one after the other.

    Args:
        laws: added to.
        trial: what the arm did.
        limits: of the envelope.
        arm: the arm's kinematics.
    """
    person = PersonAsKnown(trial)
    first, longest = person.person_first(), MISSED / RATE_HZ
    for times, goals in _driven(trial):
        if len(times) <= CYCLES:
            continue
        places, jacobians = zip(*(arm.points(goal) for goal in goals), strict=True)
        points, reach = np.array(places), 0.5 * COUNT * np.array(jacobians)
        # A goal is of a tick that began before its cycle, now more, now less.
        ages = person.ages(times)
        told = times - np.where(np.isfinite(ages), ages, 0.0)
        closing = _closing_speed(person, arm, limits.contact, times, told, points[:, 0], reach[:, 0])
        laws.judge_near("wire: closing speed near the hand, m/s", closing, limits.contact.speed)
        _, _, heads = person.at(told)
        for phase in range(CYCLES):
            at = slice(phase, None, CYCLES)
            face = face_speed(times[at], points[at], heads[at], limits.face, reach[at])
            laws.judge_near("wire: speed near the head, m/s", face, limits.face.speed)
        spans = times[CYCLES:] - times[:-CYCLES]
        speeds = (goals[CYCLES:] - goals[:-CYCLES]) / spans[:, None]
        if len(speeds) <= CYCLES:
            continue
        step = 0.5 * np.maximum(times[2 * CYCLES :] - times[: -2 * CYCLES], told[2 * CYCLES :] - told[: -2 * CYCLES])
        step = step[:, None]
        # How long a goal was a tick's before its cycle makes its speed that much uncertain.
        jitter = np.abs(speeds) * (np.abs(ages[CYCLES:] - ages[:-CYCLES]) / spans)[:, None]
        unsure = 2.0 * COUNT / step**2 + (jitter[CYCLES:] + jitter[:-CYCLES]) / step
        change = np.abs(speeds[CYCLES:] - speeds[:-CYCLES]) / step - unsure
        begun, ended = times[: -2 * CYCLES] - longest, times[2 * CYCLES :]
        free = np.searchsorted(first, begun) == np.searchsorted(first, ended, side="right")
        # A driver whose host is silent repeats its last goal: the arm stops as hard as it can.
        silent = np.concatenate([[0], np.cumsum(ages > longest)])
        free &= silent[2 * CYCLES + 1 :] == silent[: len(free)]
        laws.judge(
            "wire: acceleration, of what is allowed", _largest(change[free] / limits.acceleration), WIRE_ROUNDING
        )


def judge_body_motion(laws: Laws, trial: ArmTrial, box: BlackBox, limits: Limits, arm: ServoArm, until_ns: int) -> None:
    """Where the body really was while the arm followed, until ``until_ns``: the first fault of its bus, standstill of
    its driver, or emergency stop.

    A servo that is dead, weak or hears half of its goals moves the body otherwise than it was commanded to; one that is
    stopped brakes as hard as it can.

    Args:
        laws: added to.
        trial: what the arm did.
        box: where the body was.
        limits: of the envelope.
        arm: the arm's kinematics.
        until_ns: of the clock.
    """
    person, rows = PersonAsKnown(trial), 1e-9 * np.array(box.times)
    times = person.times[person.times < 1e-9 * until_ns]
    followed = person.while_tracking(times) & person.while_tracking(times - LAG_S)
    for at in _runs(followed):
        seconds = times[at]
        poses = np.array([np.interp(seconds, rows, joint) for joint in np.transpose(box.positions)]).T
        points = np.array([arm.points(pose)[0] for pose in poses])
        palms, _, heads = person.at(seconds)
        _, velocities, _ = person.at(seconds - LAG_S)
        closing = closing_speed(seconds, points[:, 0], palms, limits.contact, None, velocities)
        laws.judge_near("body: closing speed near the hand, m/s", closing, BODY_CLOSING * limits.contact.speed)
        face = face_speed(seconds, points, heads, limits.face)
        laws.judge_near("body: speed near the head, m/s", face, BODY_NEAR_HEAD * limits.face.speed)
    followed = person.while_tracking(rows) & person.while_tracking(rows - LAG_S) & (rows < 1e-9 * until_ns)
    speeds = np.array(box.velocities)
    for at in _runs(followed):
        change = np.abs(speeds[at][SPAN_MS:] - speeds[at][:-SPAN_MS]) / (1e-3 * SPAN_MS)
        laws.judge("body: acceleration, of what is allowed", _largest(change / limits.acceleration), BODY_ACCELERATION)


def _driven(trial: ArmTrial) -> list[tuple[Array, Array]]:
    """Cycles that gave goals one after the other, without a gap: times (C,), s, and goals (C, J), rad.

    Where a cycle after a standstill repeats what was sent before it, cycles count from the next goal on.
    """
    found, run, last = list[tuple[Array, Array]](), list[tuple[float, Array]](), None
    for cycle in trial.cycles:
        begun, sent = 1e-9 * cycle.begun_ns, cycle.sent if cycle.mode is Mode.DRIVING else None
        if run and (sent is None or begun - run[-1][0] > MISSED / RATE_HZ):
            found.append(_columns(run))
            run = []
        if sent is not None and (run or last is None or (sent.positions != last).any()):
            run.append((begun, sent.positions))
        last = None if sent is None else sent.positions
    return [*found, _columns(run)] if run else found


def _columns(run: list[tuple[float, Array]]) -> tuple[Array, Array]:
    return np.array([it for it, _ in run]), np.array([it for _, it in run])


def _closing_speed(
    person: PersonAsKnown, arm: ServoArm, limits: Contact, times: Array, told: Array, plates: Array, reach: Array
) -> float:
    """Largest speed, m/s, at which plate and palm came nearer each other over :data:`CYCLES` cycles, near each other.

    Each cycle counts along the line as its tick knew it: from where the servos were said to be then to where the palm
    was believed to be. What the hand is faster than the limit by itself does not count, nor what rounding of the goals
    may have added at the most, nor what a cycle that led to outside ``near`` had left to brake away until there.
    0 where they never were near.

    Args:
        person: as the ticks knew her.
        arm: the arm's kinematics.
        limits: ``near``, ``touching``, ``speed`` and ``braking``.
        times, told: (C,) s, of the cycles, and of the ticks whose goals they sent.
        plates: (C, 3) m, where the goals put the plate.
        reach: (C, 3, J) m, by which rounding moves it, whichever way.
    """
    palms, velocities, _ = person.at(told)
    apart = palms - plates_as_known(person.trial, arm, told)
    distance = np.linalg.norm(apart, axis=1)
    lines = (apart / np.maximum(distance, 1e-9)[:, None])[1:]
    step = np.diff(times)
    hand = -np.einsum("ti,ti->t", velocities[1:], lines)
    nearer = np.einsum("ti,ti->t", np.diff(plates, axis=0), lines) + np.minimum(hand, limits.speed) * step
    nearest = np.minimum(distance, np.linalg.norm(palms - plates, axis=1))
    left = np.maximum(nearest[1:] - limits.near, 0.0)
    nearer -= (np.sqrt(limits.speed**2 + 2.0 * limits.braking * left) - limits.speed) * step
    summed = np.convolve(nearer, np.ones(CYCLES), "valid")
    weights = np.zeros((CYCLES + 1, len(summed), 3))  # with which the places of a window count in its sum
    for number in range(CYCLES):
        along = lines[number : len(summed) + number]
        weights[number] -= along
        weights[number + 1] += along
    rounding = sum(
        np.abs(np.einsum("ti,tij->tj", weight, reach[number : len(summed) + number])).sum(axis=1)
        for number, weight in enumerate(weights)
    )
    spans = np.maximum(times[CYCLES:] - times[:-CYCLES], told[CYCLES:] - told[:-CYCLES])
    apart_enough = np.lib.stride_tricks.sliding_window_view(distance[1:], CYCLES).min(axis=1) >= limits.touching
    near = np.isfinite(summed) & (nearest[CYCLES:] <= limits.near) & apart_enough
    return float(((summed - rounding) / spans)[near].max(initial=0.0))


def _runs(mask: NDArray[np.bool_]) -> list[slice]:
    """Where ``mask`` (N,) is true without a break."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _largest(values: Array) -> float:
    return float(values.max(initial=0.0))

"""The plan of the next moments: joint accelerations that follow a task, by a few steps of iterative LQR.

The task is :mod:`highfive.hil.arm.planning_task`, its cost :mod:`highfive.hil.arm.planning_cost`; what breaks a limit
in spite of it is cut off (:mod:`highfive.hil.arm.planning_limits`). World frame, SI units; J joints. What is
written for people is in :mod:`highfive.hil.arm.planner`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from highfive.hil.arm.planner_settings import WEIGHTS
from highfive.hil.arm.planning_cost import acceleration_cost, state_cost
from highfive.hil.arm.planning_limits import next_state
from highfive.hil.arm.planning_task import Aim, Task, aimed
from highfive.hil.arm_model.arm import Arm
from highfive.hil.arm_model.inverse_kinematics import posture_from
from highfive.hil.arm_model.kinematics import link_frames, plate_jacobian, plate_of
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.linear_algebra import cholesky, cholesky_solve


@compiled
def rolled_out(
    arm: Arm, aim: Aim, path: Array, accelerations: Array, fraction: float, feed: Array, gains: Array, new_path: Array,
    new_accelerations: Array,
) -> float:  # fmt: skip
    """Rolls the plan out with ``fraction`` of the improvement; path (N + 1, 2, J). Returns its cost."""
    cost, seconds, size = 0.0, aim.task.seconds, len(arm.joints)
    no, nothing = np.zeros(size), np.zeros((size, size))
    for j in range(size):
        new_path[0, 0, j], new_path[0, 1, j] = path[0, 0, j], path[0, 1, j]
    centres, frames = link_frames(arm, new_path[0, 0])
    for k in range(len(accelerations)):
        for i in range(size):
            acceleration = accelerations[k, i] + fraction * feed[k, i]
            for j in range(size):
                acceleration += gains[k, i, j] * (new_path[k, 0, j] - path[k, 0, j])
                acceleration += gains[k, i, size + j] * (new_path[k, 1, j] - path[k, 1, j])
            acceleration = min(max(acceleration, -arm.accelerations[i]), arm.accelerations[i])
            new_accelerations[k, i] = acceleration
            speed = new_path[k, 1, i]
            new_path[k + 1, 0, i] = new_path[k, 0, i] + seconds * speed + 0.5 * seconds**2 * acceleration
            new_path[k + 1, 1, i] = speed + seconds * acceleration
        cost += acceleration_cost(
            arm, aim.task.effort, WEIGHTS.torque_weight, centres, frames, new_path[k, 1], new_accelerations[k],
            False, no, no, nothing, nothing, nothing,
        )  # fmt: skip
        joints, speeds = new_path[k + 1, 0], new_path[k + 1, 1]
        centres, frames = link_frames(arm, joints)
        cost += state_cost(arm, aim, k, centres, frames, joints, speeds, False, no, no, nothing, nothing)
    return cost


class Derivatives(NamedTuple):
    """Derivatives of a plan's cost, by knot.

    Attributes:
        states, states_twice: (N, 2, J) and (N, 2, J, J), by joints and by speeds after each acceleration.
        accelerations, accelerations_twice: (N, 2, J) and (N, 3, J, J), by acceleration and speeds before it; by both.
    """

    states: Array
    states_twice: Array
    accelerations: Array
    accelerations_twice: Array


@compiled
def linearised(arm: Arm, aim: Aim, path: Array, accelerations: Array) -> Derivatives:
    """The derivatives along a path."""
    count, size = len(accelerations), len(arm.joints)
    found = Derivatives(
        np.zeros((count, 2, size)),
        np.zeros((count, 2, size, size)),
        np.zeros((count, 2, size)),
        np.zeros((count, 3, size, size)),
    )
    centres, frames = link_frames(arm, path[0, 0])
    for k in range(count):
        one, two = found.accelerations[k], found.accelerations_twice[k]
        acceleration_cost(
            arm,
            aim.task.effort,
            WEIGHTS.torque_weight,
            centres,
            frames,
            path[k, 1],
            accelerations[k],
            True,
            one[0],
            one[1],
            two[0],
            two[1],
            two[2],
        )
        joints, speeds, one, two = path[k + 1, 0], path[k + 1, 1], found.states[k], found.states_twice[k]
        centres, frames = link_frames(arm, joints)
        state_cost(arm, aim, k, centres, frames, joints, speeds, True, one[0], one[1], two[0], two[1])
    return found


@compiled
def improvement(  # noqa: PLR0912 (a kernel)
    arm: Arm, derivatives: Derivatives, h: float, damping: float, accelerations: Array, feed: Array, gains: Array
) -> bool:
    """The Riccati sweep (iterative LQR, Li & Todorov 2004): writes feed-forward (N, J) and gains (N, J, 2 J).

    ``damping`` counts a displacement of the joints from the old path, squared (Tassa et al. 2012). Accelerations that
    would go beyond a joint's largest stop there, and the others know it (Tassa et al. 2014, one guess of the active
    set).
    """
    size = len(arm.joints)
    value, twice = np.zeros((2, size)), np.zeros((2, 2, size, size))  # gradient and matrix of the cost to go, by (q, v)
    new, new_twice = np.zeros((2, size)), np.zeros((2, 2, size, size))
    # By acceleration and (q, v); by acceleration, twice and once.
    mixed, acceleration_twice, by_acceleration = np.empty((size, 2 * size)), np.empty((size, size)), np.empty(size)
    lower, right, free = np.zeros((size, size)), np.empty(size), np.ones(size)
    for back in range(len(accelerations)):
        k = len(accelerations) - 1 - back
        for half in range(2):
            for i in range(size):
                value[half, i] += derivatives.states[k, half, i]
                for j in range(size):
                    twice[half, half, i, j] += derivatives.states_twice[k, half, i, j]
        for i in range(size):
            twice[0, 0, i, i] += damping
            by_acceleration[i] = derivatives.accelerations[k, 0, i] + 0.5 * h * h * value[0, i] + h * value[1, i]
            new[0, i], new[1, i] = value[0, i], h * value[0, i] + value[1, i] + derivatives.accelerations[k, 1, i]
        for i in range(size):
            for j in range(size):
                qq, qv, vq, vv = twice[0, 0, i, j], twice[0, 1, i, j], twice[1, 0, i, j], twice[1, 1, i, j]
                acceleration_twice[i, j] = derivatives.accelerations_twice[k, 0, i, j]
                acceleration_twice[i, j] += 0.25 * h**4 * qq + 0.5 * h**3 * (qv + vq) + h * h * vv
                mixed[i, j] = 0.5 * h * h * qq + h * vq
                mixed[i, size + j] = 0.5 * h * h * (h * qq + qv) + h * (h * vq + vv)
                mixed[i, size + j] += derivatives.accelerations_twice[k, 1, i, j]
                new_twice[0, 0, i, j] = qq
                new_twice[0, 1, i, j] = h * qq + qv
                new_twice[1, 0, i, j] = h * qq + vq
                new_twice[1, 1, i, j] = h * h * qq + h * (qv + vq) + vv + derivatives.accelerations_twice[k, 2, i, j]
        if not boxed(arm, acceleration_twice, by_acceleration, accelerations[k], lower, right, free):
            return False
        for i in range(size):
            feed[k, i] = right[i]
        for column in range(2 * size):
            for i in range(size):
                right[i] = -free[i] * mixed[i, column]
            cholesky_solve(lower, right)
            for i in range(size):
                gains[k, i, column] = free[i] * right[i]
        # The cost to go of these steps, whether or not they are the best ones.
        for half in range(2):
            for i in range(size):
                for c in range(size):
                    new[half, i] += mixed[c, size * half + i] * feed[k, c]
                    pull = by_acceleration[c]
                    for d in range(size):
                        pull += acceleration_twice[c, d] * feed[k, d]
                    new[half, i] += gains[k, c, size * half + i] * pull
                for other in range(2):
                    for j in range(size):
                        for c in range(size):
                            new_twice[half, other, i, j] += mixed[c, size * half + i] * gains[k, c, size * other + j]
        value, new = new, value
        twice, new_twice = new_twice, twice
    return True


@compiled
def boxed(
    arm: Arm, matrix: Array, gradient: Array, acceleration: Array, lower: Array, step: Array, free: Array
) -> bool:
    """Writes the step (J,) that is best inside the accelerations, the factor of what is free, and what is (1 or 0)."""
    size = len(arm.joints)
    part = np.empty((size, size))
    for j in range(size):
        free[j] = 1.0
    for turn in range(2):
        for i in range(size):
            step[i] = -gradient[i] if free[i] > 0.0 else step[i]
        for i in range(size):
            for j in range(size):
                part[i, j] = matrix[i, j] if free[i] * free[j] > 0.0 else (1.0 if i == j else 0.0)
                if free[i] > 0.0 and free[j] == 0.0:
                    step[i] -= matrix[i, j] * step[j]
        if not cholesky(part, lower):
            return False
        cholesky_solve(lower, step)
        out = False
        for j in range(size):
            most = arm.accelerations[j]
            inside = min(max(acceleration[j] + step[j], -most), most) - acceleration[j]
            if abs(inside - step[j]) > 1e-9:
                step[j] = inside
                if turn == 0:
                    free[j], out = 0.0, True
        if not out:
            break
    return True


class Planned(NamedTuple):
    """A plan and its first step.

    Attributes:
        joints, speeds: (J,) rad and rad/s, one tick from now.
        torques: (J,) N·m, that this takes.
        accelerations: (N, J) rad/s², the plan.
        guess: (J,) rad, a posture that meets the hand.
        plate: (3,) m, where the plate is one tick from now.
        miss: m, distance of the plate from where it should be, at the knot of the meeting.
        cost: of the plan.
        active: bits of the limits that shortened the first step.
    """

    joints: Array
    speeds: Array
    torques: Array
    accelerations: Array
    guess: Array
    plate: Array
    miss: float
    cost: float
    active: int


@compiled
def _afresh(arm: Arm, task: Task, guess: Array, path: Array, accelerations: Array) -> None:
    """Writes the accelerations (N, J) of a cubic in the joints to a posture, at the plate's velocity; 0 after it."""
    size = len(arm.joints)
    centres, frames = link_frames(arm, guess)
    point, normal = plate_of(arm, centres, frames)
    of_point, _ = plate_jacobian(arm, centres, frames, point, normal)
    square, lower, pull, arrival = np.empty((3, 3)), np.zeros((3, 3)), np.empty(3), np.zeros(size)
    for r in range(3):
        pull[r] = task.braked[r] + task.closing * task.normal[r]
        for c in range(3):
            square[r, c] = 1e-2 if r == c else 0.0
            for j in range(size):
                square[r, c] += of_point[r, j] * of_point[c, j]
    if cholesky(square, lower):
        cholesky_solve(lower, pull)
        for j in range(size):
            for r in range(3):
                arrival[j] += of_point[r, j] * pull[r]
    length = max(task.time, task.seconds)
    for j in range(size):
        length = max(length, 1.3 * abs(guess[j] - path[0, 0, j]) / arm.speeds[j])
    for k in range(len(accelerations)):
        t = (k + 0.5) * task.seconds
        for j in range(size):
            way, begin, end = guess[j] - path[0, 0, j], path[0, 1, j], arrival[j]
            acceleration = (6.0 * way / length - 4.0 * begin - 2.0 * end) / length
            acceleration += t / length**2 * (6.0 * (begin + end) - 12.0 * way / length)
            accelerations[k, j] = acceleration if t < length else 0.0


@compiled
def _better(arm: Arm, aim: Aim, cost: float, path: Array, plan: Array, other: Array, trial: Array) -> float:
    """Writes an improved path and plan into ``other`` and ``trial``; returns its cost, or ``cost`` if there is none."""
    derivatives = linearised(arm, aim, path, plan)
    size = len(arm.joints)
    feed, gains = np.zeros((len(plan), size)), np.zeros((len(plan), size, 2 * size))
    damping, s = 0.0, aim.task.plan
    for _ in range(s.dampings):
        if improvement(arm, derivatives, aim.task.seconds, damping, plan, feed, gains):
            fraction = 1.0
            for _ in range(s.step_lengths):
                now = rolled_out(arm, aim, path, plan, fraction, feed, gains, other, trial)
                if now < cost:
                    return now
                fraction *= s.shortening
        damping = s.first_damping * cost if damping == 0.0 else s.more_damping * damping
    return cost


@compiled_entry
def planned(
    arm: Arm, task: Task, joints: Array, speeds: Array, accelerations: Array, guess: Array, tick: float, rounds: int
) -> Planned:
    """Improves a plan ``rounds`` times from joints and speeds (J,) of now, and takes its first step of ``tick`` s.

    The plan, or a new one to the posture that ``guess`` is improved to: whichever costs less.
    """
    count, size = len(accelerations), len(arm.joints)
    aim = aimed(task, count)
    path, other = np.empty((count + 1, 2, size)), np.empty((count + 1, 2, size))
    plan, trial = np.empty((count, size)), np.empty((count, size))
    feed, gains = np.zeros((count, size)), np.zeros((count, size, 2 * size))
    for k in range(count + 1):
        for j in range(size):
            path[k, 0, j], path[k, 1, j] = joints[j], speeds[j]
            other[k, 0, j], other[k, 1, j] = joints[j], speeds[j]
    cost = rolled_out(arm, aim, path, accelerations, 0.0, feed, gains, other, plan)
    path, other = other, path
    if task.time > 2.0 * tick and task.time < math.inf:
        guess, _ = posture_from(arm, task.point, task.normal, guess, task.plan.guess_steps)
        fresh = np.empty((count, size))
        _afresh(arm, task, guess, path, fresh)
        for k in range(count + 1):
            for j in range(size):
                other[k, 0, j], other[k, 1, j] = joints[j], speeds[j]
        spare = np.empty((count + 1, 2, size))
        now = rolled_out(arm, aim, other, fresh, 0.0, feed, gains, spare, trial)
        if not cost <= now:
            cost, path, plan, trial = now, spare, trial, plan
    for _ in range(rounds):
        now = _better(arm, aim, cost, path, plan, other, trial)
        gained = cost - now
        if not gained > 0.0:
            break
        cost, path, other, plan, trial = now, other, path, trial, plan
        if gained < task.plan.converged * cost:
            break
    place, speed, torques, active = next_state(arm, joints, speeds, plan[0], tick, task.head, task.plan)
    centres, frames = link_frames(arm, place)
    plate, _ = plate_of(arm, centres, frames)
    miss = 0.0
    if task.time < math.inf:
        knot = min(max(round(task.time / task.seconds) - 1, 0), count - 1)
        centres, frames = link_frames(arm, path[knot + 1, 0])
        point, _ = plate_of(arm, centres, frames)
        for r in range(3):
            miss += (point[r] - aim.points[knot, r]) ** 2
    return Planned(place, speed, torques, plan, guess, plate, math.sqrt(miss), cost, active)

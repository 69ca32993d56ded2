"""What a plan is to do, and the trajectory it is to follow until it does."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from highfive.hil.arm.planner_settings import WEIGHTS, PlanSettings
from highfive.model.compiled import compiled
from highfive.model.geometry.rotations import Array
from highfive.model.linear_algebra import cholesky, cholesky_solve


class Task(NamedTuple):
    """What the next moments are for.

    Attributes:
        time: s until the plate should meet the hand, negative once it is due; infinite: it shall rest.
        point, normal: (3,) m and unit vector, where it should be then, and facing where.
        covariance, sharpness: (3, 3) m² and m, how sure the place is, and what is not distinguished from none.
        firm: weight of the normal's deviation.
        closing: m/s, speed along the normal at which it closes on the hand.
        settle: s before that from which on it is in front of the hand, ``standoff`` m away, and goes with it.
        press: m, that it goes on through the hand; ``pressed``: it should be there at once.
        away, drift: (3,) m and m/s, place and velocity of the path to be followed until then, from the point.
        loose: m, deviation from that path that counts 1.
        hand, hand_velocity: (3,) m and m/s, the person's palm when the arm obeys.
        braked: (3,) m/s, its velocity at contact.
        cap: m/s, largest speed relative to that palm where the plate touches it; infinite: no palm.
        rest, rest_weight: (J,) rad, the ready posture, and how much it counts.
        head: (4,) centre and radius, m, of a head to keep away from; radius 0: none.
        face: (3,) m/s that the plate may have near that head, m from its centre where it may, m/s² to get there.
        effort, calm: s⁴/rad² and s²/rad², weights of joint accelerations and speeds.
        seconds: s between knots.
        plan: what the plan weighs; the compiled form of its settings.
    """

    time: float
    point: Array
    normal: Array
    covariance: Array
    sharpness: float
    firm: float
    closing: float
    settle: float
    standoff: float
    press: float
    pressed: bool
    away: Array
    drift: Array
    loose: float
    hand: Array
    hand_velocity: Array
    braked: Array
    cap: float
    rest: Array
    rest_weight: float
    head: Array
    face: Array
    effort: float
    calm: float
    seconds: float
    plan: PlanSettings


class Aim(NamedTuple):
    """What a plan of N knots, the first ``task.seconds`` from now, is after.

    Costs are squares in units of what is tolerated: a metre counts ``point_weights``, and so on.

    Attributes:
        task: what it is for; head, face, rest and the weights of effort are the same at every knot.
        points, point_weights: (N, 3) m and (N, 3, 3) 1/m², where the plate shall be and how much that counts.
        normals, normal_weights: (N, 3) and (N,), where it shall face.
        velocities, velocity_weights: (N, 3) m/s and (N,) s²/m², of the plate.
        hands, hand_velocities: (N, 3) m and m/s, the person's palm.
        caps: (N,) m/s, largest speed at which plate and palm may close in where they are near; infinite: no palm.
    """

    task: Task
    points: Array
    point_weights: Array
    normals: Array
    normal_weights: Array
    velocities: Array
    velocity_weights: Array
    hands: Array
    hand_velocities: Array
    caps: Array


@compiled
def aimed(task: Task, count: int) -> Aim:  # noqa: PLR0912 (a kernel)
    """The task, knot by knot."""
    aim = Aim(
        task, np.zeros((count, 3)), np.zeros((count, 3, 3)), np.empty((count, 3)), np.zeros(count),
        np.zeros((count, 3)), np.zeros(count), np.empty((count, 3)), np.empty((count, 3)), np.full(count, task.cap),
    )  # fmt: skip
    sure, lower, column = np.zeros((3, 3)), np.zeros((3, 3)), np.empty(3)
    for r in range(3):
        for c in range(3):
            sure[r, c] = task.covariance[r, c]
        sure[r, r] += task.sharpness**2
    known, variance = cholesky(sure, lower), (sure[0, 0] + sure[1, 1] + sure[2, 2]) / 3.0
    for c in range(3):
        for r in range(3):
            column[r] = 1.0 if r == c else 0.0
        if known:
            cholesky_solve(lower, column)
        for r in range(3):
            sure[r, c] = column[r]
    settled = task.time - task.settle
    length, calm = max(settled, task.seconds), 3.0 * WEIGHTS.hand_fading
    end, pace = np.empty(3), np.empty(3)
    if settled < math.inf:
        _awaited(task, max(settled, 0.0), end, pace)
    for k in range(count):
        t = (k + 1) * task.seconds
        fading = math.exp(-t / calm)
        for r in range(3):
            aim.normals[k, r] = task.normal[r]
            aim.hands[k, r] = task.hand[r] + task.hand_velocity[r] * calm * (1.0 - fading)
            aim.hand_velocities[k, r] = task.hand_velocity[r] * fading
        if task.time == math.inf:
            continue
        if task.cap < math.inf:
            _met_hand(task, t, aim.hands[k], aim.hand_velocities[k])
        past = t - task.time
        aim.normal_weights[k] = WEIGHTS.normal_before * task.firm
        if t - settled < -0.5 * task.seconds:  # on the way
            x = t / length
            for r in range(3):
                stop = end[r] - task.standoff * task.normal[r]
                cubic = stop + (task.point[r] + task.away[r] - stop) * (1.0 - x) ** 2 * (1.0 + 2.0 * x)
                cubic += length * x * (1.0 - x) * (task.drift[r] * (1.0 - x) - pace[r] * x)
                aim.points[k, r] = cubic
                aim.point_weights[k, r, r] = task.seconds / WEIGHTS.path_knot / task.loose**2
            continue
        aim.normal_weights[k] = task.firm
        if abs(past) < 1.5 * task.seconds:
            aim.velocity_weights[k] = WEIGHTS.meeting_weight
        through = task.press if task.pressed else min(task.closing * past, task.press)
        early = WEIGHTS.place_fading * min(past, 0.0)
        _awaited(task, t, aim.points[k], aim.velocities[k])
        for r in range(3):
            aim.points[k, r] += max(through, -task.standoff) * task.normal[r]
            aim.velocities[k, r] = task.braked[r] + task.closing * task.normal[r]
            for c in range(3):
                aim.point_weights[k, r, c] = sure[r, c] * variance / (variance + early**2)
    return aim


@compiled
def _awaited(task: Task, t: float, place: Array, pace: Array) -> None:
    """Writes where the plate is in front of, (3,) m, and its velocity (3,): the hand, when it is near the contact.

    A plate cannot go with a hand that comes fast; it waits where they will meet.
    """
    _met_hand(task, t, place, pace)
    if t >= task.time:
        return
    away = 0.0
    for r in range(3):
        away += (place[r] - task.point[r]) ** 2
    away, waited = math.sqrt(away), task.plan.waiting_distance
    if away > waited:
        for r in range(3):
            place[r] = task.point[r] + waited / away * (place[r] - task.point[r])
            pace[r] *= (waited / away) ** 2


@compiled
def _met_hand(task: Task, t: float, place: Array, pace: Array) -> None:
    """Writes where the hand is in t s, (3,) m, and its velocity (3,): a cubic from now to the contact, then fading."""
    past = t - task.time
    if past >= 0.0 or task.cap == math.inf:
        gone = past if past < 0.0 else WEIGHTS.hand_fading * (1.0 - math.exp(-past / WEIGHTS.hand_fading))
        for r in range(3):
            place[r], pace[r] = task.point[r] + gone * task.braked[r], task.braked[r]
        return
    length, x = task.time, t / task.time
    for r in range(3):
        way = task.point[r] - task.hand[r]
        begin, end = length * task.hand_velocity[r], length * task.braked[r]
        place[r] = task.hand[r] + x * (begin + x * (3.0 * way - 2.0 * begin - end + x * (begin + end - 2.0 * way)))
        pace[r] = (begin + x * (2.0 * (3.0 * way - 2.0 * begin - end) + 3.0 * x * (begin + end - 2.0 * way))) / length

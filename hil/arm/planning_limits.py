"""What an arm can do in the next step: limits, torque, and speed near a hand or a head."""

from __future__ import annotations

import math

import numpy as np

from highfive.hil.arm.planning_cost import HARD_GAP
from highfive.hil.arm_model.arm import Arm
from highfive.hil.arm_model.distances import smallest_gap
from highfive.hil.arm_model.dynamics import available_torque, friction_torque, joint_torques, mass_matrix
from highfive.hil.arm_model.kinematics import link_frames
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array

BRAKES = 0.5
"""Share of a joint's acceleration that is kept for stopping before a limit."""


@compiled
def keeps_limits(arm: Arm, joint: int, place: float, speed: float, push: float, seconds: float) -> bool:
    """Whether the joint can still stop before its limits after a step."""
    brake = BRAKES * arm.accelerations[joint]
    after = place + seconds * speed + 0.5 * seconds**2 * push
    faster = speed + seconds * push
    way = 0.5 * faster * (abs(faster) / brake + seconds)  # the last step of braking takes a whole one
    return arm.low[joint] <= min(after, after + way) and max(after, after + way) <= arm.high[joint]


@compiled
def allowed(  # noqa: PLR0912  (a kernel)
    arm: Arm, joints: Array, speeds: Array, push: Array, seconds: float, head: Array, torques: Array
) -> int:
    """Shortens accelerations (J,) until every limit holds after the step; returns the bits of those that did it.

    Writes the torques (J,) that the step takes into ``torques``.
    """
    active, brakes = 0, np.empty(6)
    for j in range(6):
        most = arm.accelerations[j]
        brakes[j] = min(max(-speeds[j] / seconds, -BRAKES * most), BRAKES * most)
        low, high = -most, most
        if not math.isfinite(push[j]):
            push[j] = brakes[j]
        if abs(push[j]) > most:
            active |= ACCELERATION
        fastest, slowest = (arm.speeds[j] - speeds[j]) / seconds, (-arm.speeds[j] - speeds[j]) / seconds
        if push[j] > fastest or push[j] < slowest:
            active |= SPEED
        wanted = min(max(push[j], low, slowest), high, fastest)
        if not keeps_limits(arm, j, joints[j], speeds[j], wanted, seconds):
            active |= STOP
            good, bad = brakes[j], wanted
            for _ in range(20):
                middle = 0.5 * (good + bad)
                if keeps_limits(arm, j, joints[j], speeds[j], middle, seconds):
                    good = middle
                else:
                    bad = middle
            wanted = good
        push[j] = wanted
    centres, frames = link_frames(arm, joints)
    if hand_speed_kept(arm, centres, frames, speeds, brakes, push):
        active |= TORQUE
    slow = np.empty(6)
    for j in range(6):  # what stays as it is, where that does not lead into a stop
        slow[j] = 0.0 if keeps_limits(arm, j, joints[j], speeds[j], 0.0, seconds) else brakes[j]
    share = kept_fraction(arm, centres, frames, speeds, push, slow)
    if share <= 0.0:
        slow = brakes
        share = kept_fraction(arm, centres, frames, speeds, push, slow)
    if share < 1.0:
        active |= TORQUE
    for j in range(6):
        push[j] = slow[j] + share * (push[j] - slow[j])
    stopped = np.empty(6)
    for j in range(6):
        after = speeds[j] + seconds * push[j]
        stopped[j] = joints[j] + seconds * speeds[j] + 0.5 * seconds**2 * push[j]
        stopped[j] += after * abs(after) / (2.0 * BRAKES * arm.accelerations[j])
    gap = smallest_gap(arm, stopped, head)
    if gap < HARD_GAP and gap < smallest_gap(arm, joints, head):
        active |= NEARNESS
        for j in range(6):
            push[j] = brakes[j]
    joint_torques(arm, centres, frames, speeds, push, torques)
    for j in range(6):
        torques[j] += friction_torque(arm, j, speeds[j])
    return active


@compiled
def hand_speed_kept(arm: Arm, centres: Array, frames: Array, speeds: Array, brakes: Array, push: Array) -> bool:
    """Takes from each joint that asks too much of its servo what is too much, towards braking; whether one did."""
    torques, spared = np.empty(6), False
    mass = np.empty((0, 0))
    for _ in range(SPARED):
        joint_torques(arm, centres, frames, speeds, push, torques)
        for j in range(6):
            torque = torques[j] + friction_torque(arm, j, speeds[j])
            sign = 1.0 if torque > 0.0 else -1.0
            over = sign * torque - available_torque(arm, j, speeds[j], sign)
            if over <= 0.0:
                continue
            if not spared:
                mass, spared = mass_matrix(arm, centres, frames), True
            less = push[j] - sign * over / mass[j, j]
            push[j] = max(less, min(brakes[j], push[j])) if sign > 0.0 else min(less, max(brakes[j], push[j]))
    return spared


@compiled
def kept_fraction(arm: Arm, centres: Array, frames: Array, speeds: Array, push: Array, slow: Array) -> float:
    """How far from accelerations ``slow`` (J,) to ``push`` (J,) the torques stay inside their line: 0 to 1."""
    wanted, least = np.empty(6), np.empty(6)
    joint_torques(arm, centres, frames, speeds, push, wanted)
    joint_torques(arm, centres, frames, speeds, slow, least)
    share = 1.0
    for j in range(6):
        rub = friction_torque(arm, j, speeds[j])
        sign = 1.0 if wanted[j] + rub > 0.0 else -1.0
        limit = available_torque(arm, j, speeds[j], sign)
        if sign * (wanted[j] + rub) > limit:
            way = sign * (wanted[j] - least[j])
            share = min(share, max(0.0, (limit - sign * (least[j] + rub)) / way)) if way > 1e-9 else 0.0
    return share


@compiled_entry
def step_within_limits(
    arm: Arm, joints: Array, speeds: Array, push: Array, seconds: float, head: Array
) -> tuple[Array, Array, Array, int]:
    """Joints and speeds (J,) a step later, with accelerations ``push`` (J,) as far as limits allow.

    Also the torques (J,), N·m, that it takes, and the bits of the limits that shortened it.
    """
    return next_state(arm, joints, speeds, push, seconds, head)


@compiled
def next_state(
    arm: Arm, joints: Array, speeds: Array, push: Array, seconds: float, head: Array
) -> tuple[Array, Array, Array, int]:
    """Joints and speeds (J,) after a step with accelerations ``push`` (J,), as limits allow it; bits of the limits."""
    push, torques = push.copy(), np.empty(6)
    active = allowed(arm, joints, speeds, push, seconds, head, torques)
    place, speed = joints.copy(), speeds.copy()
    for j in range(6):
        place[j] += seconds * speeds[j] + 0.5 * seconds**2 * push[j]
        speed[j] += seconds * push[j]
    return place, speed, torques, active


SPARED = 3
"""Times that torques are looked at and what is too much is taken from the joint itself, before all are shortened."""


ACCELERATION, SPEED, STOP, TORQUE, NEARNESS = 1, 2, 4, 8, 16
"""Bits that say which limit shortened a step."""

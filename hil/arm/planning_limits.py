"""What an arm can do in the next step: limits, torque, and speed near a hand or a head."""

from __future__ import annotations

import math

import numpy as np

from highfive.hil.arm.planner_settings import PlanSettings
from highfive.hil.arm_model.arm import Arm
from highfive.hil.arm_model.distances import smallest_gap
from highfive.hil.arm_model.dynamics import available_torque, friction_torque, joint_torques, mass_matrix
from highfive.hil.arm_model.kinematics import link_frames
from highfive.model.compiled import compiled
from highfive.model.geometry.rotations import Array


@compiled
def keeps_limits(
    arm: Arm, joint: int, place: float, speed: float, acceleration: float, seconds: float, braking: float
) -> bool:
    """Whether the joint can still stop before its limits after a step, with ``braking`` times its acceleration."""
    brake = braking * arm.accelerations[joint]
    after = place + seconds * speed + 0.5 * seconds**2 * acceleration
    faster = speed + seconds * acceleration
    way = 0.5 * faster * (abs(faster) / brake + seconds)  # the last step of braking takes a whole one
    return arm.low[joint] <= min(after, after + way) and max(after, after + way) <= arm.high[joint]


@compiled
def allowed(  # noqa: PLR0912  (a kernel)
    arm: Arm, joints: Array, speeds: Array, acceleration: Array, seconds: float, head: Array, settings: PlanSettings,
    torques: Array,
) -> int:  # fmt: skip
    """Shortens accelerations (J,) until every limit holds after the step; returns the bits of those that did it.

    Writes the torques (J,) that the step takes into ``torques``.
    """
    count = len(arm.joints)
    active, brakes, braking = 0, np.empty(count), settings.braking_fraction
    for j in range(count):
        most = arm.accelerations[j]
        brakes[j] = min(max(-speeds[j] / seconds, -braking * most), braking * most)
        low, high = -most, most
        if not math.isfinite(acceleration[j]):
            acceleration[j] = brakes[j]
        if abs(acceleration[j]) > most:
            active |= ACCELERATION
        fastest, slowest = (arm.speeds[j] - speeds[j]) / seconds, (-arm.speeds[j] - speeds[j]) / seconds
        if acceleration[j] > fastest or acceleration[j] < slowest:
            active |= SPEED
        requested = min(max(acceleration[j], low, slowest), high, fastest)
        if not keeps_limits(arm, j, joints[j], speeds[j], requested, seconds, braking):
            active |= STOP
            good, bad = brakes[j], requested
            for _ in range(20):
                middle = 0.5 * (good + bad)
                if keeps_limits(arm, j, joints[j], speeds[j], middle, seconds, braking):
                    good = middle
                else:
                    bad = middle
            requested = good
        acceleration[j] = requested
    centres, frames = link_frames(arm, joints)
    if torques_limited(arm, centres, frames, speeds, brakes, acceleration, settings.torque_rounds):
        active |= TORQUE
    slow = np.empty(count)
    for j in range(count):  # what stays as it is, where that does not lead into a stop
        slow[j] = 0.0 if keeps_limits(arm, j, joints[j], speeds[j], 0.0, seconds, braking) else brakes[j]
    fraction = kept_fraction(arm, centres, frames, speeds, acceleration, slow)
    if fraction <= 0.0:
        slow = brakes
        fraction = kept_fraction(arm, centres, frames, speeds, acceleration, slow)
    if fraction < 1.0:
        active |= TORQUE
    for j in range(count):
        acceleration[j] = slow[j] + fraction * (acceleration[j] - slow[j])
    stopped = np.empty(count)
    for j in range(count):
        after = speeds[j] + seconds * acceleration[j]
        stopped[j] = joints[j] + seconds * speeds[j] + 0.5 * seconds**2 * acceleration[j]
        stopped[j] += after * abs(after) / (2.0 * braking * arm.accelerations[j])
    gap = smallest_gap(arm, stopped, head)
    if gap < settings.hard_gap and gap < smallest_gap(arm, joints, head):
        active |= NEARNESS
        for j in range(count):
            acceleration[j] = brakes[j]
    joint_torques(arm, centres, frames, speeds, acceleration, torques)
    for j in range(count):
        torques[j] += friction_torque(arm, j, speeds[j])
    return active


@compiled
def torques_limited(
    arm: Arm, centres: Array, frames: Array, speeds: Array, brakes: Array, acceleration: Array, rounds: int
) -> bool:
    """Takes from each joint that asks too much of its servo what is too much, towards braking; whether one did."""
    count = len(arm.joints)
    torques, limited = np.empty(count), False
    mass = np.empty((0, 0))
    for _ in range(rounds):
        joint_torques(arm, centres, frames, speeds, acceleration, torques)
        for j in range(count):
            torque = torques[j] + friction_torque(arm, j, speeds[j])
            sign = 1.0 if torque > 0.0 else -1.0
            over = sign * torque - available_torque(arm, j, speeds[j], sign)
            if over <= 0.0:
                continue
            if not limited:
                mass, limited = mass_matrix(arm, centres, frames), True
            less = acceleration[j] - sign * over / mass[j, j]
            if sign > 0.0:
                acceleration[j] = max(less, min(brakes[j], acceleration[j]))
            else:
                acceleration[j] = min(less, max(brakes[j], acceleration[j]))
    return limited


@compiled
def kept_fraction(arm: Arm, centres: Array, frames: Array, speeds: Array, acceleration: Array, slow: Array) -> float:
    """How far from ``slow`` (J,), rad/s², to ``acceleration`` (J,) the torques stay inside their line: 0 to 1."""
    count = len(arm.joints)
    required, least = np.empty(count), np.empty(count)
    joint_torques(arm, centres, frames, speeds, acceleration, required)
    joint_torques(arm, centres, frames, speeds, slow, least)
    fraction = 1.0
    for j in range(count):
        friction = friction_torque(arm, j, speeds[j])
        sign = 1.0 if required[j] + friction > 0.0 else -1.0
        limit = available_torque(arm, j, speeds[j], sign)
        if sign * (required[j] + friction) > limit:
            more, room = sign * (required[j] - least[j]), max(0.0, limit - sign * (least[j] + friction))
            fraction = min(fraction, room / more) if more > 1e-9 else 0.0
    return fraction


@compiled
def next_state(
    arm: Arm, joints: Array, speeds: Array, acceleration: Array, seconds: float, head: Array, settings: PlanSettings
) -> tuple[Array, Array, Array, int]:
    """Joints and speeds (J,) after a step with an ``acceleration`` (J,), as limits allow it; bits of the limits."""
    count = len(arm.joints)
    acceleration, torques = acceleration.copy(), np.empty(count)
    active = allowed(arm, joints, speeds, acceleration, seconds, head, settings, torques)
    place, speed = joints.copy(), speeds.copy()
    for j in range(count):
        place[j] += seconds * speeds[j] + 0.5 * seconds**2 * acceleration[j]
        speed[j] += seconds * acceleration[j]
    return place, speed, torques, active


ACCELERATION, SPEED, STOP, TORQUE, NEARNESS = 1, 2, 4, 8, 16
"""Bits that say which limit shortened a step."""

"""Inverse dynamics of an arm, its mass matrix, and what torque its motors have."""

from __future__ import annotations

import math

import numpy as np

from highfive.hil.arm_model.arm import Arm
from highfive.hil.arm_model.kinematics import joint_axis, link_frames, point_jacobian
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array

GRAVITY = 9.81
"""m/s²"""


@compiled
def joint_torques(  # noqa: PLR0912 (a kernel)
    arm: Arm, centres: Array, frames: Array, speeds: Array, push: Array, torques: Array
) -> None:
    """Writes the torques (J,) that accelerations ``push`` (J,) take with gravity: recursive Newton–Euler."""
    count = len(arm.joints)
    turn, spin = np.zeros(3), np.zeros(3)  # angular velocity and acceleration of the link
    pull = np.zeros(3)  # acceleration of the joint's centre, gravity as a push upwards
    pull[2] = GRAVITY
    lever, accelerated, force, moment = np.empty(3), np.empty(3), np.empty((count, 3)), np.empty((count, 3))
    own_turn, own_spin, swirl = np.empty(3), np.empty(3), np.empty(3)
    for j in range(count):
        if j > 0:
            for r in range(3):
                lever[r] = centres[j, r] - centres[j - 1, r]
            _carried(turn, spin, lever, pull)
        ax, ay, az = joint_axis(frames, j)
        v, a = speeds[j], push[j]
        spin[0] += v * (turn[1] * az - turn[2] * ay) + a * ax
        spin[1] += v * (turn[2] * ax - turn[0] * az) + a * ay
        spin[2] += v * (turn[0] * ay - turn[1] * ax) + a * az
        turn[0] += v * ax
        turn[1] += v * ay
        turn[2] += v * az
        for r in range(3):
            lever[r] = 0.0
            for c in range(3):
                lever[r] += frames[j, r, c] * arm.centres[j, c]
            accelerated[r] = pull[r]
            moment[j, r] = 0.0
        _carried(turn, spin, lever, accelerated)
        for k in range(3):  # in the link's own frame: I α + ω × I ω
            own_turn[k] = frames[j, 0, k] * turn[0] + frames[j, 1, k] * turn[1] + frames[j, 2, k] * turn[2]
            own_spin[k] = frames[j, 0, k] * spin[0] + frames[j, 1, k] * spin[1] + frames[j, 2, k] * spin[2]
        for k in range(3):
            swirl[k] = 0.0
            for c in range(3):
                swirl[k] += arm.inertias[j, k, c] * own_turn[c]
        for k in range(3):
            one, two = (k + 1) % 3, (k + 2) % 3
            own = own_turn[one] * swirl[two] - own_turn[two] * swirl[one]
            for c in range(3):
                own += arm.inertias[j, k, c] * own_spin[c]
            for r in range(3):
                moment[j, r] += frames[j, r, k] * own
        for r in range(3):
            force[j, r] = arm.masses[j] * accelerated[r]
        moment[j, 0] += lever[1] * force[j, 2] - lever[2] * force[j, 1]
        moment[j, 1] += lever[2] * force[j, 0] - lever[0] * force[j, 2]
        moment[j, 2] += lever[0] * force[j, 1] - lever[1] * force[j, 0]
    for back in range(count):
        j = count - 1 - back
        ax, ay, az = joint_axis(frames, j)
        torques[j] = ax * moment[j, 0] + ay * moment[j, 1] + az * moment[j, 2] + arm.armature[j] * push[j]
        if j > 0:
            x, y, z = (
                centres[j, 0] - centres[j - 1, 0],
                centres[j, 1] - centres[j - 1, 1],
                centres[j, 2] - centres[j - 1, 2],
            )
            moment[j - 1, 0] += moment[j, 0] + y * force[j, 2] - z * force[j, 1]
            moment[j - 1, 1] += moment[j, 1] + z * force[j, 0] - x * force[j, 2]
            moment[j - 1, 2] += moment[j, 2] + x * force[j, 1] - y * force[j, 0]
            for r in range(3):
                force[j - 1, r] += force[j, r]


@compiled
def mass_matrix(arm: Arm, centres: Array, frames: Array) -> Array:  # noqa: PLR0912 (a kernel)
    """Mass matrix (J, J) with the gears' inertia, from each link's Jacobians."""
    count = len(arm.joints)
    mass, of_point, com = np.zeros((count, count)), np.empty((3, count)), np.empty(3)
    inertia, half = np.empty((3, 3)), np.empty((3, 3))
    for j in range(count):
        for r in range(3):
            com[r] = centres[j, r]
            for c in range(3):
                com[r] += frames[j, r, c] * arm.centres[j, c]
                half[r, c] = 0.0
                for k in range(3):
                    half[r, c] += frames[j, r, k] * arm.inertias[j, k, c]
        for r in range(3):
            for c in range(3):
                inertia[r, c] = 0.0
                for k in range(3):
                    inertia[r, c] += half[r, k] * frames[j, c, k]
        point_jacobian(arm, centres, frames, j, com, of_point)
        for a in range(j + 1):
            axis = joint_axis(frames, a)
            for b in range(a + 1):
                other, total = joint_axis(frames, b), 0.0
                for r in range(3):
                    total += arm.masses[j] * of_point[r, a] * of_point[r, b]
                    for c in range(3):
                        total += axis[r] * inertia[r, c] * other[c]
                mass[a, b] += total
    for a in range(count):
        mass[a, a] += arm.armature[a]
        for b in range(a):
            mass[b, a] = mass[a, b]
    return mass


@compiled
def equations_of_motion(arm: Arm, centres: Array, frames: Array, speeds: Array) -> tuple[Array, Array]:
    """Mass matrix (J, J) with the gears' inertia, and Coriolis, centrifugal and gravity torques (J,)."""
    bias = np.empty(len(speeds))
    joint_torques(arm, centres, frames, speeds, np.zeros(len(speeds)), bias)
    return mass_matrix(arm, centres, frames), bias


@compiled
def _carried(turn: Array, spin: Array, arm: Array, acceleration: Array) -> None:
    """Adds to an acceleration (3,) what a lever ``arm`` (3,) of a turning body adds: α × r + ω × (ω × r)."""
    x = turn[1] * arm[2] - turn[2] * arm[1]
    y = turn[2] * arm[0] - turn[0] * arm[2]
    z = turn[0] * arm[1] - turn[1] * arm[0]
    acceleration[0] += spin[1] * arm[2] - spin[2] * arm[1] + turn[1] * z - turn[2] * y
    acceleration[1] += spin[2] * arm[0] - spin[0] * arm[2] + turn[2] * x - turn[0] * z
    acceleration[2] += spin[0] * arm[1] - spin[1] * arm[0] + turn[0] * y - turn[1] * x


@compiled_entry
def dynamics(arm: Arm, joints: Array, speeds: Array) -> tuple[Array, Array]:
    """Mass matrix (J, J), kg·m², and Coriolis, centrifugal and gravity torques (J,), N·m; friction is not in them."""
    centres, frames = link_frames(arm, joints)
    return equations_of_motion(arm, centres, frames, speeds)


@compiled
def friction_torque(arm: Arm, joint: int, speed: float) -> float:
    """Torque, N·m, that friction takes, smoothed about standstill."""
    return arm.damping[joint] * speed + arm.friction[joint] * math.tanh(speed / 0.05)


@compiled
def available_torque(arm: Arm, joint: int, speed: float, sign: float) -> float:
    """Torque, N·m, available in the direction ``sign``: stall torque less what back-EMF takes at this speed."""
    return arm.stall[joint] * min(1.0, max(0.0, 1.0 - sign * speed / arm.no_load[joint]))


@compiled
def _runs(arm: Arm, start: Array, displacement: Array, seconds: float) -> bool:
    """Whether a minimum-jerk movement along ``displacement`` stays inside speed and torque–speed line."""
    count = len(arm.joints)
    joints, speeds, pulls = np.empty(count), np.empty(count), np.empty(count)
    for sample in range(17):
        s = sample / 16.0
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rate = 30.0 * s**2 * (1.0 - s) ** 2 / seconds
        change = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / seconds**2
        for j in range(count):
            joints[j] = start[j] + share * displacement[j]
            speeds[j], pulls[j] = rate * displacement[j], change * displacement[j]
            if abs(speeds[j]) > arm.speeds[j]:
                return False
        centres, frames = link_frames(arm, joints)
        mass, torque = equations_of_motion(arm, centres, frames, speeds)
        for j in range(count):
            torque[j] += friction_torque(arm, j, speeds[j])
            for k in range(count):
                torque[j] += mass[j, k] * pulls[k]
            sign = 1.0 if torque[j] > 0.0 else -1.0
            if abs(torque[j]) > available_torque(arm, j, speeds[j], sign):
                return False
    return True


@compiled_entry
def quickest(arm: Arm, start: Array, end: Array) -> float:
    """Duration, s, of the quickest minimum-jerk movement of all joints together that the servos can follow."""
    displacement, low, high = end - start, 0.02, 4.0
    for _ in range(14):
        middle = 0.5 * (low + high)
        if _runs(arm, start, displacement, middle):
            high = middle
        else:
            low = middle
    return high

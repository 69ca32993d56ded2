"""An emulated arm that is not as its model says: what the planner and the feed-forward do not know of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from highfive.hil.arm_model.servo_arm import DEFAULT_MOUNT
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.emulator.emulated_bus import EmulatedBus
from highfive.hil.drivers.emulator.perturbed_servo import PerturbedServo
from highfive.hil.drivers.emulator.servos_of_rig import build_servos
from highfive.hil.drivers.values import Array
from highfive.hil.safety.limits import JOINTS
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.sim.arm_body import PREFIX
from highfive.hil.sim.arm_plant import ArmPlant

MASS, FRICTION, TORQUE = 0.2, 0.5, 0.15
"""Shares by which masses, friction, and torques for the same error may be off."""

PLAY, DELAY_S, ZERO = np.radians(0.3), 0.015, np.radians(1.0)
"""rad of backlash in a joint; s from a goal's arrival until the servo acts on it, at most; rad of one joint's zero."""

VOLTS = 11.1, 12.6
"""Of the supply, at the servos; below 11 V the arm is stopped."""


@dataclass(frozen=True)
class Perturbation:
    """In what an arm differs.

    Attributes:
        seed: it was drawn from.
        masses: (J,) factors, of the links.
        friction: (J,) factors, of viscous and dry friction.
        torques: (J,) factors, of what the servos give for an error.
        play: (J,) rad, of backlash.
        delay_s: s, from a goal's arrival until a servo acts on it.
        voltage: V.
        zeros: (J,) rad, that servos say too much; not 0 for one joint.
    """

    seed: int
    masses: Array
    friction: Array
    torques: Array
    play: Array
    delay_s: float
    voltage: float
    zeros: Array


def drawn_perturbation(seed: int) -> Perturbation:
    """Uniform within the bounds above."""
    rng, joints = np.random.default_rng((seed, 2)), len(JOINTS)
    masses, friction, torques = (rng.uniform(1.0 - size, 1.0 + size, joints) for size in (MASS, FRICTION, TORQUE))
    zeros = np.zeros(joints)
    zeros[rng.integers(joints)] = rng.choice([-ZERO, ZERO])
    play = rng.uniform(0.0, PLAY, joints)
    return Perturbation(
        seed, masses, friction, torques, play, float(rng.uniform(0.0, DELAY_S)), float(rng.uniform(*VOLTS)), zeros
    )


def perturbed_bus(it: Perturbation, rig: Rig) -> EmulatedBus:
    """The arm on its default mount, where it rests, on a bus that was just switched on."""

    def change(model: Any) -> None:  # MuJoCo's stubs lack what it changes
        for name, mass, friction in zip(JOINTS, it.masses, it.friction, strict=True):
            joint = model.joint(PREFIX + name)
            model.body_mass[joint.bodyid] *= mass
            model.body_inertia[joint.bodyid] *= mass
            model.dof_damping[joint.dofadr] *= friction
            model.dof_frictionloss[joint.dofadr] *= friction

    servos, joints = build_servos(rig, kind=PerturbedServo)
    bus = EmulatedBus(servos, joints, ArmPlant(DEFAULT_MOUNT, load_limits().way_points[-1], change), seed=it.seed)
    for servo, joint in zip(servos, joints, strict=True):
        servo.play, servo.factor = float(it.play[joint]), float(it.torques[joint])
        servo.delay_ns, servo.voltage = round(1e9 * it.delay_s), it.voltage
        servo.astray = -float(it.zeros[joint])
    return bus

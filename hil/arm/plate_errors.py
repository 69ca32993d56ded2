"""How far the plate of an arm is from where its calibration has it, where palms meet.

Postures of contact are those of the grid, ± 5 cm and ± 25°.
"""

from __future__ import annotations

import numpy as np

from highfive.calibration.arm_fit import ArmFit
from highfive.calibration.arm_plate import Plate
from highfive.hil.arm.hidden_arm import HiddenArm, HiddenTruth
from highfive.hil.arm_model.servo_arm import default_arm, solve
from highfive.hil.sim.people.grid import GRID_Y, GRID_Z
from highfive.model.geometry.rotations import Array

CONTACTS, AHEAD_M, AROUND_M, TURNED = 60, 0.5, 0.05, np.radians(25.0)
"""Postures in which plates are judged: number, distance before the avatar, and how far about each cell."""


def contact_postures(count: int = CONTACTS) -> Array:
    """Postures (count, J), rad, in which palms meet on the grid."""
    rng, arm, found = np.random.default_rng(5), default_arm(), []
    while len(found) < count:
        place = np.array([AHEAD_M, rng.choice(GRID_Y), rng.choice(GRID_Z)])
        place += np.append(0.0, rng.uniform(-AROUND_M, AROUND_M, 2))
        yaw, rise = rng.uniform(-TURNED, TURNED, 2)
        normal = np.array([np.cos(yaw) * np.cos(rise), np.sin(yaw) * np.cos(rise), np.sin(rise)])
        joints, left = solve(arm, place, normal, arm.ready)
        if left < 0.002:
            found.append(joints)
    return np.array(found)


def true_plates(truth: HiddenTruth, postures: Array) -> Array:
    """(N, 3) m, where the plate's middle really is in postures (N, J), rad, in the motion capture's frame."""
    arm, found = HiddenArm(truth, 1), []
    for joints in postures:
        arm.stand(joints, np.zeros(len(joints)))
        found.append(arm.plate()[0])
    return np.array(found)


def missed(fit: ArmFit, plate: Plate, postures: Array, plates: Array) -> Array:
    """(N,) m, from where a fit has the plate's middle to where it is, ``plates`` (N, 3)."""
    _, places, axes = fit.predicted(postures)
    return np.linalg.norm(plate.at(places, axes)[0] - plates, axis=1)

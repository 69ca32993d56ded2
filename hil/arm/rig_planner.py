"""Retargeting for the arm of a rig: how late and how soft its servos are, and the limits that it keeps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from highfive.hil.arm.planner import LAG_BY_DATA, LAG_MEASURED, Retarget
from highfive.hil.arm.planner_settings import RetargetSettings
from highfive.hil.arm_model.arm_folder import ArmFolder, find_arm
from highfive.hil.arm_model.servo_arm import ServoArm, default_arm
from highfive.hil.drivers.bus.rig import COUNTS, Rig
from highfive.hil.safety.limits import Limits
from highfive.model.geometry.rotations import Array

ON_THE_WAY = 0.008
"""s from a command to the servos having it: planning, and half a cycle of the bus."""

EVERYWHERE = 10.0
"""m: where no point may be faster than near a face, the plan takes the whole room for its zone."""

FULL_GAIN = 885.0 * 128.0
"""Counts of error times gain at which a servo's position controller gives full voltage (the maker's manual)."""


def planner(rig: Rig, limits: Limits, arm: ServoArm | None = None, lags: Array | None = None) -> Retarget:
    """Retargeting for an arm as it is known (None: the default one as drawn): what may not be sent is not planned
    either. ``lags``: (J,) s, from command to encoder, as measured; None: as the servos' data have it.

    Compiles where nobody has yet.
    """
    arm = arm or default_arm()
    slow = replace(arm, fastest=tuple(limits.speed.tolist()))
    settings = retarget_settings(rig, limits, folder=arm.folder)
    origin = LAG_BY_DATA
    if lags is not None:
        settings, origin = replace(settings, lag=planned_ahead(lags)), LAG_MEASURED
    soft = tuple((np.array(settings.sag) + arm.compliance).tolist())
    return Retarget(slow, np.array(arm.folder.ready), replace(settings, sag=soft), lag_from=origin)


def planned_ahead(lags: Array) -> float:
    """s, of measured lags (J,), s: their median, and half a period of the bus; a command stays for one, and is half of
    one old on average."""
    return float(np.median(lags)) + 0.5 * RetargetSettings().tick


def retarget_settings(
    rig: Rig, limits: Limits, on_the_way: float = ON_THE_WAY, folder: ArmFolder | None = None
) -> RetargetSettings:
    """How late the joints of a rig are, and by how much they give way: controllers answer to the error, and motors
    have a torque–speed line.

    A joint moves at no-load speed, or gives its stall torque, where the error takes the full voltage. ``on_the_way``:
    s that a command takes to the servos. The plan keeps the limits near the person by itself.
    """
    folder = folder or find_arm()
    return RetargetSettings(
        lag=float(np.median(full_errors(rig) / folder.each[1])) + on_the_way,
        sag=tuple(sags(rig, folder).tolist()),
        contact_speed=limits.contact.speed,
        face_speed=limits.face.speed,
        face_radius=EVERYWHERE if limits.motion.point_speed <= limits.face.speed else limits.face.radius,
        face_braking=limits.face.braking,
    )


def sags(rig: Rig, folder: ArmFolder) -> Array:
    """(J,) rad/(N·m), by which an arm's joints stand off their goals under load."""
    return full_errors(rig) / folder.each[0]


def full_errors(rig: Rig) -> Array:
    """(J,) rad, errors at which the position controllers give the full voltage."""
    return np.array([FULL_GAIN / joint.position_p_gain * math.tau / COUNTS for joint in rig.joints])

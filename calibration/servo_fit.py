"""What servos do that their counts do not say: zeros, compliance and play of an arm whose room and links are known.

Each posture is taken twice, every joint once from either side: half of what lies between the two is play.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.arm_fit import ArmFit, fit_arm
from highfive.calibration.arm_kinematics import ArmShape
from highfive.calibration.arm_plate import FOLDS
from highfive.calibration.arm_poses import ArmPoses
from highfive.calibration.pose_check import calibrated, check_poses
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

SERVOS = ("zero", "compliance", "play")
"""What is fitted; the room, links and the plate stay as they were calibrated."""

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class ServoFitSettings(Settings):
    """What nothing should rest on."""

    worst: float = setting(0.0025, "m", above=0.0)
    """Most that the plate may be off in pairs that were held out (root mean square): that of the check before a
    session."""
    zero: float = setting(float(np.radians(10.0)), "rad", above=0.0)
    """A larger zero is a horn on the wrong tooth (15°), or another arm."""


SERVO_FIT = ServoFitSettings()


@dataclass(frozen=True)
class ServoFit:
    """Servos as they are.

    Attributes:
        found: the calibration with them in it.
        before, after: m, root mean square of the markers' middle: with the calibration as it was, and in pairs that
            were held out.
        sigmas: (3, J) of zeros, rad, compliance, rad/(N·m), and play, rad; of a fit of noise, too small.
    """

    found: ArmCalibration
    before: float
    after: float
    sigmas: Array


def fit_servos(
    shape: ArmShape, found: ArmCalibration, poses: ArmPoses, settings: ServoFitSettings = SERVO_FIT
) -> ServoFit:
    """Fits servos to pairs of poses.

    Args:
        shape: the arm as drawn.
        found: its calibration.
        poses: 2 K poses, two neighbours of one posture from opposite sides; encoders as counts have them, zeros not
            added; markers in the motion capture's frame.
        settings: how well they have to fit.

    Raises:
        HighFiveError: no zeros explain what was seen, or one is none that a horn has.
    """
    here = replace(poses, markers=found.registration.placement.apply(poses.markers))
    start = calibrated(shape, found)
    off, pairs = np.empty(len(poses)), np.arange(len(poses)) // 2
    for fold in range(FOLDS):
        out = pairs % FOLDS == fold
        part = fit_arm(shape, here.only(~out), UP, SERVOS, start=start)
        off[out] = check_poses(shape, _with(found, part), poses.only(out)).off
    fit = fit_arm(shape, here, UP, SERVOS, start=start)
    after, before = float(np.sqrt(np.mean(off**2))), check_poses(shape, found, poses).rms
    worst = int(np.argmax(np.abs(fit.errors.zero)))
    if (zero := abs(float(fit.errors.zero[worst]))) > settings.zero:
        raise HighFiveError(
            f"the zero of {shape.names[worst]} comes out {np.degrees(zero):.0f}° off, at most "
            f"{np.degrees(settings.zero):.0f}° are believed: is its horn a tooth (15°) off? put it right first"
        )
    if after > settings.worst:
        raise HighFiveError(
            f"no zeros explain what was seen: the plate is {1e3 * after:.1f} mm off (root mean square), at most "
            f"{1e3 * settings.worst:g}; was the base bumped, or a marker moved? run highfive calibrate extrinsics again"
        )
    joints, marks = len(shape.names), fit.errors
    sizes = {name: getattr(marks, name).size for name in ("base_turn", "base_place")}
    first = sum(sizes.values())
    last = len(fit.sigmas) - marks.ripple.size - joints
    sigmas = np.stack([fit.sigmas[at : at + joints] for at in (first, first + joints, last)])
    return ServoFit(_with(found, fit), before, after, sigmas)


def _with(found: ArmCalibration, fit: ArmFit) -> ArmCalibration:
    """A calibration with the servos of a fit."""
    errors = fit.errors
    joints = {
        name: replace(
            found.joints[name],
            zero=float(errors.zero[j]),
            compliance=max(0.0, float(errors.compliance[j])),
            play=max(0.0, float(errors.play[j])),
        )
        for j, name in enumerate(fit.shape.names)
    }
    return replace(found, joints=joints)

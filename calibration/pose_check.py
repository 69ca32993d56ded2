"""Five poses before a session: is the arm still where it was calibrated, and as it was?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.arm_fit import ARM_FIT, ArmFitSettings
from highfive.calibration.arm_kinematics import (
    ArmErrors,
    ArmShape,
    as_drawn,
    frames_of,
    gravity_torques,
    jacobian,
    joint_columns,
    marker_places,
    true_angles,
)
from highfive.calibration.arm_poses import ArmPoses
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

BASE = ("base_turn", "base_place")
"""What the poses of a check are chosen to tell (:func:`highfive.calibration.pose_choice.choose_poses`)."""


@dataclass(frozen=True)
class PoseCheckSettings(Settings):
    """Of the five-pose check."""

    poses: int = setting(5, least=3)
    worst: float = setting(0.0025, "m", above=0.0)
    """Most that the markers' middle may be off (root mean square over the poses)."""
    moved: float = setting(26.0, above=0.0)
    """Most that a base which was moved explains of what is off, in squared deviations (the likelihood ratio's; χ² of 6
    where all errors are noise). A base turned by 0.3° moves the plate by 2.4 mm, which joints that do not repeat hide
    from the root mean square. Chosen on 24 arms of other seeds than those of ``bench calibration``: 99 of 100 checks of
    arms as they were are below 22, of turned ones above 33."""


POSE_CHECK = PoseCheckSettings()


@dataclass(frozen=True)
class PoseCheck:
    """What the poses showed.

    Attributes:
        off: (N,) m, of the markers' middle from where the calibration has it.
        rms: m, over the poses.
        moved: squared deviations that a moved base explains.
        trouble: one line; '' where the arm is as it was.
    """

    off: Array
    rms: float
    moved: float
    trouble: str


def calibrated(shape: ArmShape, found: ArmCalibration) -> ArmErrors:
    """The errors of an arm as its calibration has them, in the world."""
    joints = [found.joints[name] for name in shape.names]
    drawn = as_drawn(shape, rotations.to_matrix(found.mount_rotation), found.mount)
    return ArmErrors(
        rotation=drawn.rotation,
        translation=drawn.translation,
        base_turn=drawn.base_turn,
        base_place=drawn.base_place,
        zero=np.array([joint.zero for joint in joints]),
        compliance=np.array([joint.compliance for joint in joints]),
        length=np.array([joint.length for joint in joints]),
        tilt=np.array([joint.tilt for joint in joints]),
        marker=found.markers - shape.markers,
        play=np.array([joint.play for joint in joints]),
        ripple=drawn.ripple,
    )


def check_poses(
    shape: ArmShape, found: ArmCalibration, poses: ArmPoses, settings: PoseCheckSettings = POSE_CHECK
) -> PoseCheck:
    """Holds an arm to its calibration.

    Args:
        shape: the arm as drawn.
        found: its calibration.
        poses: a few of it now, from all over its room; in each at least one marker was seen.
        settings: how far it may be off.
    """
    errors, up = calibrated(shape, found), np.array([0.0, 0.0, 1.0])
    stiff = np.zeros_like(poses.encoders)
    torques = gravity_torques(
        shape, frames_of(shape, errors, true_angles(errors, poses.encoders, stiff, poses.sides)), up
    )
    frames = frames_of(shape, errors, true_angles(errors, poses.encoders, torques, poses.sides))
    places = marker_places(shape, errors, frames)
    away = found.registration.placement.apply(poses.markers) - places
    count = np.maximum(poses.seen.sum(axis=1), 1)

    def middle(values: Array) -> Array:
        shown = poses.seen.reshape(*poses.seen.shape, *[1] * (values.ndim - 2))
        return np.sum(np.where(shown, values, 0.0), axis=1) / count.reshape(-1, *[1] * (values.ndim - 2))

    residual, turns = middle(away), middle(joint_columns(frames, places))
    base = middle(jacobian(errors, frames, places, poses.encoders, torques, poses.sides)[..., :6])
    off = np.linalg.norm(residual, axis=1)
    rms, moved = float(np.sqrt(np.mean(off**2))), _explained(residual, base, turns, count)
    trouble = ""
    if rms > settings.worst or moved > settings.moved:
        trouble = (
            f"the plate is {1e3 * rms:.1f} mm (root mean square of {len(off)} poses) from where the calibration has "
            f"it, at most {1e3 * settings.worst:g} are safe, and a moved base explains {moved:.0f} of it, at most "
            f"{settings.moved:g} are chance; was the base bumped, or did a horn slip? run highfive calibrate "
            "extrinsics again"
        )
    return PoseCheck(off, rms, moved, trouble)


def _explained(residual: Array, base: Array, turns: Array, count: Array, settings: ArmFitSettings = ARM_FIT) -> float:
    """Squared deviations of residuals (N, 3) that a motion of the base explains, with columns (N, 3, 6); joints, with
    columns (N, 3, J), do not repeat."""
    covariance = settings.joint_noise**2 * turns @ np.swapaxes(turns, 1, 2)
    covariance += (settings.marker_noise**2 / count)[:, None, None] * np.eye(3)
    weighted = np.swapaxes(np.linalg.solve(covariance, base), 1, 2)
    normal, slope = np.sum(weighted @ base, axis=0), np.sum(weighted @ residual[..., None], axis=0)[:, 0]
    return float(slope @ np.linalg.solve(normal + 1e-6 * np.eye(6), slope))

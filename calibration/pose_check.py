"""Five poses before a session: is the arm still where it was calibrated, and as it was?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.arm_kinematics import (
    ArmErrors,
    ArmShape,
    as_drawn,
    frames_of,
    gravity_torques,
    marker_places,
    true_angles,
)
from highfive.calibration.arm_poses import ArmPoses
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class PoseCheckSettings(Settings):
    """Of the five-pose check."""

    poses: int = setting(5, least=3)
    worst: float = setting(0.0025, "m", above=0.0)
    """Most that the markers' middle may be off (root mean square over the poses)."""


POSE_CHECK = PoseCheckSettings()


@dataclass(frozen=True)
class PoseCheck:
    """What the poses showed.

    Attributes:
        off: (N,) m, of the markers' middle from where the calibration has it.
        rms: m, over the poses.
        trouble: one line; '' where the arm is as it was.
    """

    off: Array
    rms: float
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
    away = found.registration.placement.apply(poses.markers) - marker_places(shape, errors, frames)
    seen = poses.seen[..., None]
    middle = np.sum(np.where(seen, away, 0.0), axis=1) / np.maximum(seen.sum(axis=1), 1)
    off = np.linalg.norm(middle, axis=1)
    rms = float(np.sqrt(np.mean(off**2)))
    if rms <= settings.worst:
        return PoseCheck(off, rms, "")
    return PoseCheck(
        off,
        rms,
        f"the plate is {1e3 * rms:.1f} mm (root mean square of {len(off)} poses) from where the calibration has it, at "
        f"most {1e3 * settings.worst:g} are safe; was the base bumped, or did a horn slip? run highfive calibrate "
        "extrinsics again",
    )

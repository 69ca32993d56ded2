"""From a fitted arm to what is kept: where the world lies in the room, and where the base really stands in it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from highfive.calibration.arm_file import ArmCalibration, CalibratedJoint, KeptPose
from highfive.calibration.arm_fit import ArmFit
from highfive.calibration.arm_plate import Plate
from highfive.calibration.arm_poses import ArmPoses
from highfive.calibration.plate_template import PlateTemplate
from highfive.calibration.registration import Registration
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class Source:
    """What a calibration is of, and by what it was measured.

    Attributes:
        arm: fingerprint.
        system: the motion capture, as in its address.
        date: UTC.
        tool, command, note: version, command line, and what the operator wrote.
        temperatures: °C of the servos, lowest and highest; None where nobody read them.
    """

    arm: str
    system: str
    date: datetime
    tool: str
    command: str
    note: str = ""
    temperatures: tuple[float, float] | None = None


def world_of(fit: ArmFit, position: Array, rotation: Array) -> tuple[Array, Array, Array, Array]:
    """The world beside the motion capture: vertical and floor are the motion capture's, place and yaw the arm's.

    Args:
        fit: the arm in the motion capture's frame.
        position, rotation: (3,) m and (4,) quaternion, of the base by its file.

    Returns:
        rotation (4,) and translation (3,), m, from the motion capture's frame to the world; place (3,), m, and
        quaternion (4,) of the base in the world as it really stands: height, tilt and roll are the measured ones.
    """
    level = rotations.rotation_between(fit.up, np.array([0.0, 0.0, 1.0]))
    base = rotations.to_matrix(level) @ fit.errors.base_axes
    between = rotations.to_matrix(rotation) @ base.T
    yaw = np.arctan2(between[1, 0] - between[0, 1], between[0, 0] + between[1, 1])
    turn = rotations.multiply(rotations.from_axis_angle("z", yaw), level)
    place = rotations.rotate(turn, fit.errors.base)
    move = np.array([position[0] - place[0], position[1] - place[1], 0.0])
    return turn, move, place + move, rotations.multiply(turn, rotations.from_matrix(fit.errors.base_axes))


def calibration_of(
    path: Path,
    fit: ArmFit,
    poses: ArmPoses,
    plate: Plate,
    template: PlateTemplate,
    off: Array,
    mount: tuple[Array, Array],
    source: Source,
) -> ArmCalibration:
    """What is kept of a fit.

    Args:
        path: of the file.
        fit: of all poses.
        poses: N of them.
        plate: in it.
        template: of the plate.
        off: (N,) m, of poses that were held out; NaN where the plate was not seen.
        mount: (3,) m and (4,) quaternion, of the base by its file.
        source: of the poses.
    """
    turn, move, place, axes = world_of(fit, *mount)
    told = off[np.isfinite(off)]
    errors = fit.errors
    joints = {
        name: CalibratedJoint(
            zero=float(errors.zero[j]),
            compliance=max(0.0, float(errors.compliance[j])),
            play=float(errors.play[j]),
            length=errors.length[j],
            tilt=errors.tilt[j],
        )
        for j, name in enumerate(fit.shape.names)
    }
    registration = Registration(
        path, source.date, source.arm, source.system, turn, move, len(off), float(np.percentile(told, 95))
    )
    return ArmCalibration(
        registration=registration,
        tool=source.tool,
        command=source.command,
        note=source.note,
        mount=place,
        mount_rotation=axes,
        plate=plate.centre,
        plate_normal=plate.normal / np.linalg.norm(plate.normal),
        marker_names=template.names,
        markers=fit.shape.markers + errors.marker,
        joints=joints,
        held_out_median=float(np.median(told)),
        held_out_max=float(told.max()),
        rms=fit.rms,
        temperatures=source.temperatures,
        latency={},
        poses=_kept_poses(fit, poses, off),
    )


def _kept_poses(fit: ArmFit, poses: ArmPoses, off: Array) -> tuple[KeptPose, ...]:
    """Each with what is left of it."""
    seen = np.maximum(poses.seen.sum(axis=1), 1)
    left = np.sqrt(np.sum(np.where(poses.seen, fit.residuals, 0.0) ** 2, axis=1) / seen)
    return tuple(
        KeptPose(encoders, float(rms), float(one) if np.isfinite(one) else None)
        for encoders, rms, one in zip(poses.encoders, left, off, strict=True)
    )

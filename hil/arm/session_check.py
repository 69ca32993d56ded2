"""Five poses before a session: a real arm beside a live person has to be where, and as, its calibration says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.plate_template import PlateTemplate
from highfive.calibration.pose_check import BASE, POSE_CHECK, PoseCheck, check_poses
from highfive.calibration.pose_choice import choose_poses
from highfive.calibration.pose_file import together
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.extrinsics import take_poses
from highfive.hil.arm.free_postures import free_postures
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm.posture_route import route
from highfive.hil.arm_model.servo_arm import ServoArm, mounted
from highfive.model.errors import HighFiveError

SEED = 0
"""Of the postures among which the five are chosen: the same in each session, and in ``bench calibration``."""


def plate_of(found: ArmCalibration) -> PlateTemplate:
    """The plate with its markers as they were calibrated."""
    return PlateTemplate(found.marker_names, found.markers - found.plate, found.plate, found.plate_normal)


def five_poses(drive: PostureDrive, watch: PlateWatch, body: ServoArm, found: ArmCalibration) -> PoseCheck:
    """Visits five postures that tell whether the base moved, slowly, and holds what is seen to the calibration.

    Args:
        drive: the arm, with calibrated zeros.
        watch: sees :func:`plate_of` it.
        body: as it is known.
        found: its calibration.

    Raises:
        HighFiveError: the arm is not as it was, was stopped, somebody stayed in its way, or the plate is not seen.
    """
    shape = drawn_shape(mounted(body.folder), found.markers)
    free = free_postures(body, SEED)
    postures = free[choose_poses(shape, free, POSE_CHECK.poses, BASE)]
    poses = together(take_poses(drive, watch, body.ready, route(body, postures)))
    zeros = np.array([found.joints[name].zero for name in shape.names])
    # The check knows of zeros itself, and begins with what the servos' counts say.
    poses = replace(poses, encoders=poses.encoders - zeros)
    if (check := check_poses(shape, found, poses)).trouble:
        raise HighFiveError(f"nothing moves any more: {check.trouble}")
    return check

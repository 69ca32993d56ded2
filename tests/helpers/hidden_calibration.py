"""A hidden arm's calibration, as its fit finds it from 30 postures: without the wire, in seconds."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from highfive.calibration.arm_file import ArmCalibration, load_arm, save_arm
from highfive.calibration.arm_fit import fit_arm
from highfive.calibration.arm_plate import held_out, plate_of_fit
from highfive.calibration.arm_poses import ArmPoses
from highfive.calibration.arm_result import Source, calibration_of
from highfive.calibration.pose_choice import choose_poses
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.fingerprint import fingerprint
from highfive.hil.arm.free_postures import free_postures
from highfive.hil.arm.hidden_arm import COUNT, TEMPLATE, HiddenArm, HiddenTruth
from highfive.hil.arm_model.servo_arm import DEFAULT_MOUNT, default_arm
from highfive.hil.drivers.bus.rig import load_rig

UP = np.array([0.0, 0.0, 1.0])


def hidden_calibration(truth: HiddenTruth, file: Path) -> ArmCalibration:
    """Writes it, and reads it back."""
    shape = drawn_shape(default_arm(), TEMPLATE.markers)
    free = free_postures(default_arm(), 0)
    postures = free[choose_poses(shape, free, 30)]
    encoders = np.round(postures / COUNT) * COUNT
    arm, places = HiddenArm(truth), []
    for joints in encoders:
        arm.stand(joints, np.zeros(len(joints)))
        places.append(arm.markers())
    poses = ArmPoses(encoders, np.zeros_like(encoders), np.array(places), np.ones(np.shape(places)[:2], bool))
    fit = fit_arm(shape, poses, UP)
    source = Source(fingerprint(load_rig()), "vicon", datetime.now(UTC), "tests", "tests")
    mount = (np.array(DEFAULT_MOUNT.position), DEFAULT_MOUNT.quaternion)
    off = held_out(shape, poses, UP, TEMPLATE)
    plate = plate_of_fit(fit, TEMPLATE)
    save_arm(file, calibration_of(file, fit, poses, plate, TEMPLATE, off, mount, source), replace=True)
    return load_arm(file)

"""Poses of an arm that differs from its drawing, as MuJoCo has it: an oracle that shares no line with the fit."""

import numpy as np

from highfive.calibration.arm_poses import ArmPoses
from highfive.hil.arm.free_postures import PostureSettings, free_postures
from highfive.hil.arm.hidden_arm import HiddenArm, HiddenTruth
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.model.geometry.rotations import Array

UP = np.array([0.0, 0.0, 1.0])


def postures(count: int, seed: int = 0) -> Array:
    """Random ones that the arm can take (count, J)."""
    return free_postures(default_arm(), seed, PostureSettings(candidates=max(count, 30)))[:count]


def seen_poses(truth: HiddenTruth, encoders: Array, noise: float = 0.0005, repeat: bool = True) -> ArmPoses:
    """What the cameras see of them."""
    arm, rng = HiddenArm(truth), np.random.default_rng(truth.seed)
    sides = np.where(rng.random(encoders.shape) < 0.5, -1.0, 1.0)
    markers = []
    for joints, side in zip(encoders, sides, strict=True):
        arm.stand(joints, side, repeat=repeat)
        markers.append(arm.markers())
    places = np.array(markers)
    return ArmPoses(encoders, sides, places + rng.normal(0.0, noise, places.shape), np.ones(places.shape[:2], bool))

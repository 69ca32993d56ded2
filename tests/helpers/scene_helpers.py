"""Poses and people for the tests of the scene."""

import numpy as np

from highfive.hil.sim.avatar import Pose
from highfive.mocap_bridge.frames import HumanArm, PalmPose
from highfive.model.geometry import rotations

UP = np.array([0.0, 0.0, 1.0])
RAISED = {
    "right_shoulder_y": -75.0, "right_shoulder_z": 15.0, "right_shoulder_x": -12.0, "right_elbow_y": -72.0,
    "right_elbow_z": 80.0, "right_wrist_x": -20.0,
}  # fmt: skip


def pose_of(skeleton, degrees):
    angles = np.zeros((len(skeleton), 3))
    for name, angle in degrees.items():
        joint, _, axis = name.rpartition("_")
        i = skeleton.index(joint)
        angles[i, skeleton.hinge_orders[i].index(axis)] = np.radians(angle)
    return Pose(skeleton.offsets[0].copy(), angles)


def random_pose(skeleton, rng):
    angles = rng.uniform(skeleton.hinge_limits[..., 0], skeleton.hinge_limits[..., 1])
    return Pose(rng.normal(size=3), angles)


def person_with_palm(position, normal, fingers=UP, velocity=(0.0, 0.0, 0.0), head=(1.10, 0.0, 1.66)):
    """A person who faces the avatar and has the palm there."""
    position, normal = np.asarray(position, float), np.asarray(normal, float)
    fingers = np.asarray(fingers, float) - (fingers @ normal) * normal
    fingers = fingers / np.linalg.norm(fingers)
    wrist = position - 0.014 * normal - 0.068 * fingers
    shoulder = np.array([1.08, 0.19, 1.43])
    elbow = 0.5 * (shoulder + wrist) - [0.0, 0.0, 0.15]
    knuckles = wrist + 0.095 * fingers
    palm = PalmPose(position, normal, fingers, np.asarray(velocity, float))
    facing = rotations.from_axis_angle("z", np.pi)
    points = np.stack([wrist, knuckles])
    return HumanArm(np.asarray(head, float), facing, shoulder, elbow, wrist, knuckles, palm, points, True, 0, 0)

"""A simulated person who raises and lowers the right arm, as a C3D file with or without gaps, and the truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.joint_angles import ANGLES, BASES, angles_between
from highfive.model.geometry import rotations

RATE_HZ = 120.0
RIGHT_ARM = ("right_shoulder", "right_elbow", "right_wrist")


@dataclass(frozen=True)
class Reach:
    """The file, the markers (T, M, 3), m, which of them it has (T, M), and the arm's angles (T, 8), degrees."""

    path: Path
    markers: np.ndarray
    there: np.ndarray
    angles: np.ndarray


def arm_angles(skeleton, lift, forward=-1.4, outward=-0.3):
    """Hinges (T, J, 3), rad, of a right arm that is lifted by ``lift`` (T,), 0 to 1."""
    angles = np.zeros((len(lift), len(skeleton), 3))
    shoulder, elbow, wrist = (skeleton.index(joint) for joint in RIGHT_ARM)
    angles[:, shoulder] = np.stack([-0.2 + forward * lift, outward - 0.3 * lift, 0.4 * lift], axis=-1)
    angles[:, elbow] = np.stack([-0.4 - 1.0 * lift, 0 * lift, -lift], axis=-1)
    angles[:, wrist, 0] = 0.4 * lift
    return angles


def simulated_reach(
    path: Path, hidden=(), name="paper", frames=360, prefix="human:", noise=0.0, scale=1.0, alias=None
) -> Reach:
    """Writes a reach; ``hidden`` are markers that are missing for 300 ms every 700 ms."""
    marker_set, skeleton = load_marker_set(name), avatar_skeleton().scaled(scale)
    time = np.arange(frames) / RATE_HZ
    lift = 0.5 - 0.5 * np.cos(2 * np.pi * time / 2.0)
    angles = arm_angles(skeleton, lift)
    root = np.stack([1.0 + 0.03 * np.sin(1.3 * time), 0.02 * np.sin(time), np.full(frames, 0.93 * scale)], axis=-1)
    centres, orientations = skeleton.forward_kinematics(root, skeleton.from_hinges(angles))
    markers = marker_set.simulate(skeleton, centres, orientations)
    there = np.ones(markers.shape[:2], dtype=bool)
    for start in range(60, frames - 40, 84):
        there[start : start + 36, marker_set.indices(list(hidden))] = False
    base = next(name for name in BASES if name in marker_set.segments)
    turns = rotations.to_matrix(orientations[:, [skeleton.index(joint) for joint in (base, *RIGHT_ARM)]])
    truth = np.degrees([angles_between(*(np.ascontiguousarray(turn) for turn in four)) for four in turns])
    assert truth.shape[1] == len(ANGLES)
    noisy = markers + np.random.default_rng(3).normal(scale=noise, size=markers.shape) if noise else markers
    labels = [prefix + (alias or {}).get(label, label) for label in marker_set.names]
    write_c3d(path, make_recording(RATE_HZ, labels, noisy, there))
    return Reach(path, markers, there, truth)

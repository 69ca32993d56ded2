"""Points without names: how they move shows what they are."""

import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.joint_shapes import recognise_shape
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

SKELETON = avatar_skeleton()
CENTRES = load_marker_set("joint_centres")
KEPT = [name for name in CENTRES.names if "_1" not in name[-2:] or "trunk" in name]
JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
LIMBS = [f"{side}_{j}" for side in ("left", "right") for j in JOINTS]


def recording(seed, frames=90, noise=0.002):
    """Somebody who steps about, turns a little and reaches out with either hand; labels in an order of no meaning."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 3.0, frames)
    angles = np.zeros((frames, len(SKELETON), 3))
    for name, hinge, size in (
        ("pelvis", 0, 0.6), ("lumbar_3", 0, 0.1), ("thoracic_8", 2, 0.15), ("neck", 0, 0.2), ("head", 2, 0.3),
        ("right_shoulder", 0, -1.4), ("right_shoulder", 1, -0.4), ("right_elbow", 0, -1.3), ("right_wrist", 0, 0.4),
        ("left_shoulder", 0, -0.7), ("left_shoulder", 1, 0.3), ("left_elbow", 0, -0.8), ("left_wrist", 0, 0.3),
        ("right_hip", 0, -0.4), ("right_knee", 0, 0.5), ("left_hip", 0, -0.4), ("left_knee", 0, 0.5),
        ("left_ankle", 0, 0.2), ("right_ankle", 0, 0.2),
    ):  # fmt: skip
        wave = 0.5 - 0.5 * np.cos(rng.uniform(1.5, 4.0) * time + rng.uniform(0, 6))
        angles[:, SKELETON.index(name), hinge] = size * wave
    root = np.stack([0.5 * np.sin(time), 0.2 * time, np.full(frames, 0.93)], axis=1)
    positions = SKELETON.forward_kinematics(root, SKELETON.from_hinges(SKELETON.clamp(angles)))
    points = CENTRES.subset(KEPT).simulate(SKELETON, *positions)
    points = points + rng.normal(0.0, noise, points.shape)
    order = np.random.default_rng(0).permutation(len(KEPT))
    names = [f"j{m:02d}" for m in range(len(KEPT))]
    return make_recording(30.0, names, points[:, order], np.ones(points.shape[:2], dtype=bool)), {
        CENTRES.subset(KEPT).names[m]: names[i] for i, m in enumerate(order)
    }


@pytest.mark.parametrize("axis", ["z", "x"])
def test_limbs_are_told_by_lengths_that_stay(axis):
    recordings, truths = zip(*(recording(seed) for seed in range(3)), strict=True)
    turn = rotations.from_axis_angle("x", np.pi / 2) if axis == "x" else rotations.IDENTITY
    turned = [make_recording(r.rate_hz, r.names, 1e3 * rotations.rotate(turn, r.points), r.valid) for r in recordings]
    known = recognise_shape(turned)
    assert {name: known[name] for name in LIMBS} == {name: truths[0][name] for name in LIMBS}
    assert {known[f"{side}_ball"] for side in ("left", "right")} <= {
        truths[0][f"{side}_{toe}"] for side in ("left", "right") for toe in ("ball", "toe_tip")
    }
    assert {"pelvis", "neck", "head"} <= known.keys()


def test_a_cloud_of_points_is_no_body():
    points = np.random.default_rng(0).normal(size=(60, 20, 3))
    cloud = make_recording(30.0, [f"j{m}" for m in range(20)], points, np.ones((60, 20), dtype=bool))
    with pytest.raises(HighFiveError, match="do not move like the joints"):
        recognise_shape([cloud])

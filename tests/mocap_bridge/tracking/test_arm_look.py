"""Angles from one look: flexion is what the joints make, deviations are honest, what no marker shows is left blank."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.joint_angles import ANGLES, BASES, angles_between
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.geometry import rotations

SKELETON = avatar_skeleton()
FRAMES, SETTLED, SEEDS = 100, 10, 8
NOTHING = np.zeros((0, 3))
SETS = ["paper", "plug_in_gait_upper", "upper_limb", "cmu_joint_centres", "full_body"]
FLEXION, CARRYING = ANGLES.index("elbow_flexion"), ANGLES.index("carrying_angle")


@dataclass
class Tracked:
    """True angles, reported ones and deviations (T, 8), rad, which are seen, and how far the joints bend (T,), rad."""

    truth: np.ndarray
    angles: np.ndarray
    deviations: np.ndarray
    seen: np.ndarray
    bend: np.ndarray


def tracked(marker_set: MarkerSet, seed: int) -> Tracked:
    """An arm that sways, of somebody unlike the set: lengths, markers' places and carrying angle drawn; with gaps."""
    rng = np.random.default_rng([seed, 7])
    joints = ("shoulder", "elbow", "wrist")
    lengths = dict(zip((f"right_{joint}" for joint in joints), rng.normal(1.0, 0.07, 3), strict=True))
    body, time = SKELETON.scaled(lengths), np.arange(FRAMES) / 120.0

    def sway(middle, size):
        return middle + size * np.sin(2 * np.pi * rng.uniform(0.3, 0.9) * time + rng.uniform(0.0, 6.3))

    shoulder, elbow, wrist = (SKELETON.index(f"right_{joint}") for joint in joints)
    turns = np.zeros((FRAMES, len(SKELETON), 3))
    turns[:, shoulder] = np.stack([sway(-0.9, 0.6), sway(-0.3, 0.3), sway(0.0, 0.5)], axis=-1)
    carrying = np.full(FRAMES, rng.normal(0.0, np.radians(8.0)))
    turns[:, elbow] = np.stack([sway(-1.1, 0.6), carrying, sway(-0.2, 0.7)], axis=-1)
    turns[:, wrist, :2] = np.stack([sway(0.0, 0.3), sway(0.0, 0.15)], axis=-1)
    root = np.tile([1.0, 0.0, 0.93], (FRAMES, 1))
    centres, orientations = body.forward_kinematics(root, body.from_hinges(turns))
    away = rng.normal(size=(len(marker_set), 3)) * marker_set.spreads[:, None]
    worn = replace(marker_set, local_positions=marker_set.local_positions + away)
    points = worn.simulate(body, centres, orientations)
    points += rng.normal(scale=0.001, size=points.shape)
    shown = np.ones(points.shape[:2], dtype=bool)
    arm = [m for m, joint in enumerate(marker_set.joints) if joint.startswith("right_")]
    shown[30:66, rng.choice(arm, 2, replace=False)] = False
    base = next(name for name in BASES if name in marker_set.segments)
    frames = rotations.to_matrix(orientations[:, [SKELETON.index(base), shoulder, elbow, wrist]])
    upper, fore = centres[:, elbow] - centres[:, shoulder], centres[:, wrist] - centres[:, elbow]
    tracker, found = Tracker(marker_set), []
    for k in range(FRAMES):
        tracker.update(MarkerFrame(marker_set.names, points[k], shown[k], k, round(k * 1e9 / 120), 0, NOTHING))
        found.append(tracker.arm_angles)
    return Tracked(
        truth=np.array([angles_between(*(np.ascontiguousarray(f) for f in four)) for four in frames])[SETTLED:],
        angles=np.array([each.angles for each in found])[SETTLED:],
        deviations=np.array([each.deviations for each in found])[SETTLED:],
        seen=np.array([each.seen for each in found])[SETTLED:],
        bend=np.arctan2(np.linalg.norm(np.cross(upper, fore), axis=1), (upper * fore).sum(axis=1))[SETTLED:],
    )


@pytest.mark.parametrize("name", [*SETS[:-1], pytest.param(SETS[-1], marks=pytest.mark.slow)])
@pytest.mark.slow
def test_flexion_agrees_with_the_bend_and_all_angles_with_the_truth_within_their_deviations(name):
    found = [tracked(load_marker_set(name), seed) for seed in range(SEEDS)]
    for each in found:
        assert each.seen[:, FLEXION].mean() > 0.95
    bend = [(f.angles[:, FLEXION] - f.bend) / f.deviations[:, FLEXION] for f in found]
    # What is off in all frames of a person is one draw: of eight, one may be three deviations off for a while.
    assert np.mean(np.abs(np.concatenate(bend)) < 3.0) > 0.97
    assert np.abs(np.concatenate(bend)).max() < 4.0
    for i, angle in enumerate(ANGLES):
        away = [((f.angles[:, i] - f.truth[:, i] + np.pi) % (2 * np.pi) - np.pi) / f.deviations[:, i] for f in found]
        reported = np.concatenate([z[f.seen[:, i]] for z, f in zip(away, found, strict=True)])
        assert len(reported) == 0 or np.sqrt(np.mean(reported**2)) < 2.0, angle
    assert "joint_centres" not in name or not any(f.seen[:, CARRYING].any() for f in found)


def test_an_arm_of_three_points_tells_its_bend_and_nothing_that_takes_an_axis():
    """Shoulder, elbow and wrist alone, in every pose: the bend is right, turns about the bones are left blank."""
    whole = load_marker_set("cmu_joint_centres")
    points = {"rradius", "rhand", "rfingers", "rthumb"}
    bare = whole.subset([name for name in whole.names if name not in points - {"rfingers"}])
    for seed in range(4):
        found = tracked(bare, seed)
        assert (np.abs(found.angles[:, FLEXION] - found.bend) < 3.0 * found.deviations[:, FLEXION]).all()
        assert found.seen[:, FLEXION].all()
        for blank in ("carrying_angle", "pronation", "wrist_deviation"):
            assert not found.seen[:, ANGLES.index(blank)].any(), blank

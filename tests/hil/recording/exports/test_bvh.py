"""BVH: a reader that knows the format alone finds every joint where the recording has it."""

import numpy as np
import pytest
from bvh_by_the_format import read_bvh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shipped import exported, shipped_trials

from highfive.hil.recording.exports.bvh import ORDER, bvh, smooth_euler
from highfive.hil.recording.exports.motion_files import bvh_files
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.body_geometry import bone_end
from highfive.model.geometry import rotations

TENTH_MM = 1e-4


def to_z_up(places):
    return places[:, [2, 0, 1]]


@pytest.mark.parametrize("place", range(4))
def test_joints_are_where_they_were_recorded(place, tmp_path):
    trial, path = shipped_trials()[place], tmp_path / "t.bvh"
    bvh_files(exported(trial), ["t.bvh"])[0].write(path)
    read = read_bvh(path)
    assert read.frame_time == pytest.approx(1 / 60, abs=1e-8) and len(read.rows) == len(trial)
    places = read.places()
    for joint, name in enumerate(avatar_skeleton().names):
        assert np.abs(to_z_up(places[name]) - trial.positions[:, joint]).max() < TENTH_MM


def test_ends_are_the_tips_of_bones(tmp_path):
    trial, path = shipped_trials()[0], tmp_path / "t.bvh"
    bvh_files(exported(trial), ["t.bvh"])[0].write(path)
    places, skeleton = read_bvh(path).places(), avatar_skeleton()
    leaves = set(skeleton.names) - {skeleton.names[parent] for parent in skeleton.parents if parent >= 0}
    assert {name for name in places if name.endswith("_end")} == {f"{name}_end" for name in leaves}
    for name in ("right_index_3", "left_toe"):
        joint = skeleton.index(name)
        tip = trial.positions[:, joint] + rotations.rotate(trial.orientations[:, joint], bone_end(skeleton, name))
        assert np.abs(to_z_up(places[f"{name}_end"]) - tip).max() < TENTH_MM


def test_in_the_rest_pose_the_avatar_stands_and_looks_along_z(tmp_path):
    skeleton, path = avatar_skeleton(), tmp_path / "rest.bvh"
    rest = np.tile(rotations.IDENTITY, (2, len(skeleton), 1))
    path.write_bytes(bvh(skeleton, np.tile(skeleton.offsets[0], (2, 1)), rest, 120.0))
    read = read_bvh(path)
    assert not read.rows[:, 3:].any()
    places = {name: at[0] for name, at in read.places().items()}
    assert places["head_end"][1] == pytest.approx(1.75, abs=1e-5)
    assert places["left_toe"][2] > places["left_ankle"][2]
    assert places["left_wrist"][0] > 0 > places["right_wrist"][0]


@given(st.lists(st.tuples(*[st.floats(-4, 4)] * 3), min_size=1, max_size=5), st.sampled_from([0.0, 1e-9, 1e-6]))
def test_angles_are_the_rotation_also_at_the_singularity(angles, off):
    """The middle angle at a right angle or beside it, the others any."""
    exact = np.array([(a, np.pi / 2 - off, c) for a, _, c in angles] + angles)
    q = rotations.from_euler(ORDER, exact)[:, None]
    found = smooth_euler(ORDER, q)[:, 0]
    theirs = Rotation.from_euler(ORDER.upper(), found).as_matrix()
    assert np.abs(theirs - rotations.to_matrix(q[:, 0])).max() < 1e-7


def test_angles_do_not_jump():
    turn = np.linspace(0.0, 5.0 * np.pi, 400)  # through every quadrant, two turns and a half, on each axis in turn
    for axis in "xyz":
        angles = smooth_euler(ORDER, rotations.from_axis_angle(axis, turn)[:, None])
        assert np.abs(np.diff(angles, axis=0)).max() < 0.1

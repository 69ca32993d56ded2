import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.upright import up_axis
from highfive.model.geometry import rotations

TURNS = {"+z": np.eye(3), "-z": np.diag([1.0, -1.0, -1.0])} | {
    way: Rotation.from_euler(axis, angle, degrees=True).as_matrix()
    for way, axis, angle in (("+y", "x", -90), ("-y", "x", 90), ("+x", "y", 90), ("-x", "y", -90))
}


def standing(marker_set):
    skeleton = avatar_skeleton()
    rest = np.tile(rotations.IDENTITY, (3, len(skeleton), 1))
    placed = skeleton.forward_kinematics(np.tile(skeleton.offsets[0], (3, 1)), rest)
    return load_marker_set(marker_set).simulate(skeleton, *placed)


@pytest.mark.parametrize("way", TURNS)
@pytest.mark.parametrize("marker_set", ["paper", "full_body", "plug_in_gait", "joint_centres"])
def test_a_standing_person_tells_any_axis(marker_set, way):
    points = standing(marker_set) @ TURNS[way].T
    names = load_marker_set(marker_set).names
    seen = np.ones(points.shape[:2], dtype=bool)
    assert up_axis(make_recording(100.0, names, points, seen)) == way


def test_markers_without_a_head_tell_none():
    points, names = standing("upper_limb"), load_marker_set("upper_limb").names
    assert up_axis(make_recording(100.0, names, points, np.ones(points.shape[:2], dtype=bool))) is None


def test_someone_who_leans_or_is_not_known_tells_none():
    points, names = standing("full_body"), load_marker_set("full_body").names
    leaning = points @ Rotation.from_euler("x", 45, degrees=True).as_matrix()
    seen = np.ones(points.shape[:2], dtype=bool)
    assert up_axis(make_recording(100.0, names, leaning, seen)) is None
    assert up_axis(make_recording(100.0, [f"P{m}" for m in range(len(names))], points, seen)) is None
    assert up_axis(make_recording(100.0, names, points, ~seen)) is None

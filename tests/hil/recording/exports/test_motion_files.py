"""C3D of both people: ezc3d and our own reader find the markers where the recording has them."""

from dataclasses import replace

import ezc3d
import numpy as np
import pytest
from shipped import exported, shipped_trials

from highfive.hil.datasets.dyads import Role, read_pairs
from highfive.hil.recording.exports.motion_files import AVATAR_SET, c3d_files
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.trial_table import read_table
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError

F32_MM = 1e-6
"""m; single precision of a millimetre."""


@pytest.fixture(scope="module")
def hidden():
    """A high five in which one marker is hidden for a while."""
    trial = shipped_trials()[1]
    seen = trial.seen.copy()
    seen[20:40, 3] = False
    return replace(trial, seen=seen, markers=np.where(seen[..., None], trial.markers, 0.0))


@pytest.fixture(scope="module")
def folder(hidden, tmp_path_factory):
    folder = tmp_path_factory.mktemp("c3d")
    for file in c3d_files(exported(hidden, shipped_trials()[2]), ["a.c3d", "b.c3d"]):
        file.write(folder / file.name)
    return folder


def test_other_readers_find_the_same_markers_and_gaps(folder, hidden):
    file = ezc3d.c3d(str(folder / "a.c3d"))
    labels = file["parameters"]["POINT"]["LABELS"]["value"]
    points, residuals = file["data"]["points"], file["data"]["meta_points"]["residuals"][0]
    assert file["parameters"]["POINT"]["RATE"]["value"][0] == 60.0
    for m, name in enumerate(hidden.names):
        column = labels.index(f"human:{name}")
        np.testing.assert_array_equal(residuals[column] >= 0, hidden.seen[:, m])
        there = hidden.seen[:, m]
        theirs = 1e-3 * points[:3, column].T
        np.testing.assert_allclose(theirs[there], hidden.markers[there, m], atol=F32_MM)


def test_uneven_ticks_become_one_rate_and_lost_ones_hide_the_person(tmp_path):
    trial = shipped_trials()[1]
    kept = np.delete(np.arange(len(trial)), [50, 51])
    rng = np.random.default_rng(0)
    times = trial.times + rng.uniform(-0.2, 0.2, len(trial)) / 60.0
    way = np.zeros((len(trial), len(trial.names), 3))
    way[..., 0] = times[:, None]  # a marker that goes straight shows when it was seen
    uneven = replace(
        trial, seen=trial.seen[kept], markers=way[kept], times=times[kept], root=trial.root[kept],
        quaternions=trial.quaternions[kept],
    )  # fmt: skip
    c3d_files(exported(uneven), ["u.c3d"])[0].write(tmp_path / "u.c3d")
    found = read_c3d(tmp_path / "u.c3d").person("human")
    at = uneven.times[0] + np.arange(len(found)) / found.rate_hz
    seen = found.valid.all(axis=1)
    assert found.rate_hz == pytest.approx(60.0, rel=0.01) and abs(len(found) - len(trial)) <= 1
    assert 2 <= (~seen).sum() <= 4 and 49 <= np.flatnonzero(~seen)[0] <= 51
    np.testing.assert_allclose(found.points[seen, 0, 0], at[seen], atol=0.02 / 60.0)


def test_the_avatar_wears_markers_that_move_with_its_joints(folder, hidden):
    recording, worn, skeleton = read_c3d(folder / "a.c3d"), load_marker_set(AVATAR_SET), avatar_skeleton()
    avatar = recording.person("avatar")
    assert avatar.names == worn.names and avatar.valid.all()
    truth = worn.simulate(skeleton, hidden.positions, hidden.orientations)
    np.testing.assert_allclose(avatar.points, truth, atol=F32_MM)


def test_the_table_and_the_files_are_a_data_folder(folder):
    rows = read_table(folder)
    assert [(row.file, row.emotion, row.cell) for row in rows] == [("a.c3d", "happy", "B2"), ("b.c3d", "angry", "B2")]
    said = []
    pairs = read_pairs([folder / row.file for row in rows], Role("human", None), Role("avatar", None), said.append)
    assert pairs.kept == (0, 1) and pairs.people.name == "paper" and pairs.actors.name == AVATAR_SET
    assert not said  # in the avatar's world already, right hands: nothing had to be found out


def test_a_recording_without_markers_says_so():
    bare = replace(shipped_trials()[0], names=(), markers=np.zeros((246, 0, 3)), seen=np.zeros((246, 0), dtype=bool))
    with pytest.raises(HighFiveError, match=r"/markers.*before version 0\.2\.0"):
        c3d_files(exported(bare), ["a.c3d"])

"""CSV and NPZ say the same as the recording."""

import csv

import numpy as np
import pytest
from shipped import exported, shipped_recording, shipped_trials

from highfive.hil.recording.exports.tables import csv_files, npz_file
from highfive.hil.sim.avatar import avatar_skeleton


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tables")
    for file in [*csv_files(exported(*shipped_trials()), "s"), npz_file(exported(*shipped_trials()), "s.npz")]:
        file.write(folder / file.name)
    return folder


def table(folder, name):
    with (folder / f"s_{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def column(rows, name):
    return np.array([float(row[name]) if row[name] else np.nan for row in rows])


def test_person_and_avatar_are_as_recorded(folder):
    recording = shipped_recording()
    person, avatar = table(folder, "person"), table(folder, "avatar")
    said = recording.arrays("/person")
    for rows in (person, avatar):
        np.testing.assert_allclose(column(rows, "time"), said["time"], atol=1e-9)
        np.testing.assert_array_equal(column(rows, "trial"), recording.arrays("/tick")["trial"] + 1)
    for i, axis in enumerate("xyz"):
        np.testing.assert_allclose(column(person, f"wrist_{axis}"), said["wrist"][:, i], atol=1e-9)
        played = recording.arrays("/avatar")["root"][:, i]
        np.testing.assert_allclose(column(avatar, f"pelvis_{axis}"), played, atol=1e-9)
    q = np.stack([column(avatar, f"right_elbow_q{axis}") for axis in "wxyz"], axis=1)
    recorded = recording.arrays("/avatar")["quaternions"][:, avatar_skeleton().index("right_elbow")]
    np.testing.assert_allclose(np.abs((q * recorded).sum(axis=1)), 1.0, atol=2e-5)


def test_a_marker_that_was_not_measured_has_empty_cells(folder):
    rows, said = table(folder, "markers"), shipped_recording().arrays("/markers")
    seen = np.array([[bool(row[f"{name}_x"]) for name in shipped_trials()[0].names] for row in rows])
    np.testing.assert_array_equal(seen, said["seen"])
    for m, name in enumerate(shipped_trials()[0].names):
        there = seen[:, m]
        np.testing.assert_allclose(
            column(rows, f"{name}_z")[there], said["positions"][there, m, 2], atol=5.1e-6
        )  # of 10 µm


def test_contacts_have_a_row_a_high_five(folder):
    rows, said = table(folder, "contacts"), shipped_recording().channels["/contact"]
    assert [int(row["trial"]) for row in rows] == [1, 2, 3, 4]
    assert [row["emotion"] for row in rows] == ["neutral", "happy", "angry", "sad"]
    for row, contact in zip(rows, said, strict=True):
        assert bool(int(row["met"])) == contact.data["met"]
        assert float(row["distance"]) == contact.data["distance"]
        assert float(row["contact_time"]) == pytest.approx(float(row["start"]) + contact.data["met_time"], abs=1e-6)


def test_npz_needs_no_pickle_and_holds_the_same(folder):
    with np.load(folder / "s.npz", allow_pickle=False) as held:
        arrays = {name: held[name] for name in held.files}
    assert all(values.dtype != object for values in arrays.values())
    for name, of in (
        ("person_wrist", lambda it: it.points["wrist"]),
        ("avatar_quaternions", lambda it: it.quaternions),
    ):
        np.testing.assert_array_equal(arrays[name], np.concatenate([of(trial) for trial in shipped_trials()]))
    seen = np.concatenate([trial.seen for trial in shipped_trials()])
    np.testing.assert_array_equal(np.isfinite(arrays["markers"]).all(axis=-1), seen)
    np.testing.assert_array_equal(arrays["trial"], shipped_recording().arrays("/tick")["trial"] + 1)
    assert list(arrays["phase"]) == [tick.data["phase"] for tick in shipped_recording().channels["/tick"]]
    assert list(arrays["avatar_joints"]) == list(avatar_skeleton().names)
    assert list(arrays["trials_emotion"]) == ["neutral", "happy", "angry", "sad"]

"""The simulated capture: the same bytes for a seed, a whole table, and the defects that real captures have."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from highfive.hil.sim.people.actors import PairTrial, simulate_pair
from highfive.hil.sim.people.capture import (
    CLEAN,
    Defects,
    _beside,
    _captured_before,
    capture,
    markers_of,
    record_pair,
    trial_seed,
)
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.people.role import RATE_HZ
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.files.trial_table import COLUMNS, TABLE, write_table
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError

SEED = 5  # of the folder ``captured``


@pytest.fixture(scope="module")
def trial() -> PairTrial:
    return simulate_pair("angry", "B2", 0, trial_seed(SEED, "angry", "B2", 0))


def runs(gone: np.ndarray) -> list[int]:
    """Lengths of the runs of True in (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], gone.astype(int), [0]])))
    return (edges[1::2] - edges[::2]).tolist()


def test_the_table_names_every_file_once(captured: Path) -> None:
    with (captured / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [row["cell"] for row in rows] == list(CELLS)
    assert {row["emotion"] for row in rows} == {"angry"} and {row["split"] for row in rows} == {"train"}
    assert sorted(row["file"] for row in rows) == sorted(path.name for path in captured.glob("*.c3d"))


def test_both_actors_wear_their_sets_at_120_hz(captured: Path) -> None:
    recording = read_c3d(captured / "angry_A1_1.c3d")
    assert recording.rate_hz == 120.0 and recording.prefixes == ("human", "avatar")
    assert len(recording.person("human").names) == 16  # five on the head, eleven on the right arm
    assert set(recording.person("avatar").names) == set(load_marker_set("full_body").names)


def test_a_trial_is_the_same_bytes_whatever_else_is_captured(captured: Path, tmp_path: Path) -> None:
    rng = trial_seed(SEED, "angry", "B2", 0)
    again = record_pair(simulate_pair("angry", "B2", 0, rng), Defects(), rng)
    write_c3d(tmp_path / "again.c3d", again)
    assert (tmp_path / "again.c3d").read_bytes() == (captured / "angry_B2_1.c3d").read_bytes()


@pytest.mark.slow
def test_another_seed_or_repetition_is_another_trial(trial: PairTrial) -> None:
    for seed, repetition in ((SEED + 1, 0), (SEED, 1)):
        other = simulate_pair("angry", "B2", repetition, trial_seed(seed, "angry", "B2", repetition))
        frames = min(len(other.avatar.root_in_world), len(trial.avatar.root_in_world))
        assert np.abs(other.avatar.root_in_world[:frames] - trial.avatar.root_in_world[:frames]).max() > 1e-4


def test_defects_are_as_many_and_as_long_as_requested(captured: Path, trial: PairTrial) -> None:
    recordings = [read_c3d(path) for path in sorted(captured.glob("*.c3d"))]
    lengths = [n for r in recordings for gone in ~r.valid.T for n in runs(gone)]
    seconds = sum(r.valid.size for r in recordings) / RATE_HZ
    assert len(lengths) == pytest.approx(Defects.gaps_a_second * seconds, rel=0.5)
    assert min(lengths) >= 1 and max(lengths) <= 2 * 0.25 * RATE_HZ  # two may meet
    ghosts = [n for r in recordings for there in r.unlabelled_valid.T for n in runs(there)]
    assert len(ghosts) == pytest.approx(sum(len(r) for r in recordings) / RATE_HZ, rel=0.5)
    recording = read_c3d(captured / "angry_B2_1.c3d").person("human")
    marker_set = load_marker_set("paper")
    points, seen = marker_set.arrange(recording.names, recording.points, recording.valid)
    noise = (points - markers_of(trial.person, marker_set))[seen]
    assert np.std(noise) == pytest.approx(Defects.noise, rel=0.05)
    assert np.all(np.abs(noise.mean(axis=0)) < 5e-5)


def test_without_defects_the_markers_are_where_they_are(trial: PairTrial) -> None:
    clean: Recording = record_pair(trial, CLEAN, np.random.default_rng(0))
    assert clean.valid.all() and not clean.unlabelled_valid.any()
    person = load_marker_set("paper")
    np.testing.assert_array_equal(clean.person("human").points, markers_of(trial.person, person))


def test_what_cannot_be_captured_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    cases = {
        "bored": lambda: capture(tmp_path / "a", ("bored",)),
        "0 repetitions": lambda: capture(tmp_path / "b", ("sad",), repetitions=0),
        "2 held out": lambda: capture(tmp_path / "c", ("sad",), repetitions=2, test_repetitions=2),
        "cannot write": lambda: capture(tmp_path / "file", ("sad",)),
        "trials.csv": lambda: write_table(tmp_path / "absent", []),
    }
    for part, call in cases.items():
        with pytest.raises(HighFiveError, match=part) as error:
            call()
        assert "\n" not in str(error.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


def test_what_a_killed_capture_left_is_cleared_and_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "highfive")
    left, others = ".highfive-0123abcd-capture", {"mine", ".highfive-my-capture"}
    for name in (left, *others):
        (tmp_path / name).mkdir()
        (tmp_path / name / "angry_A1_1.c3d").write_bytes(b"half")
    with _beside(tmp_path, locked=False) as beside:  # another capture may be at work in it
        assert {path.name for path in tmp_path.iterdir()} == {beside.name, left, *others}
    with _beside(tmp_path, locked=True) as beside:
        assert {path.name for path in tmp_path.iterdir()} == {beside.name, *others}
    log = caplog.text
    assert ".highfive-0123abcd-capture removed" in log and "which a killed capture left" in log
    assert {path.name for path in tmp_path.iterdir()} == others


@pytest.mark.parametrize("kind", ["pipe", "device", "large"])
def test_a_table_that_never_ends_is_none_of_a_capture(tmp_path: Path, kind: str) -> None:
    path = tmp_path / TABLE
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as file:
            file.truncate(1 << 40)  # more than any memory
    assert _captured_before(tmp_path) == set()

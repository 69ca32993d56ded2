"""From C3D pairs to trials and a model: what comes out against the actors' true motion, which nobody tells."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from highfive.hil.cli import main as cli
from highfive.hil.datasets.training_data import SolvedPair, load_trials, track_hand
from highfive.hil.sim.avatar import avatar_skeleton, right_palm
from highfive.hil.sim.people.actors import PairTrial, simulate_pair
from highfive.hil.sim.people.capture import trial_seed
from highfive.hil.sim.people.role import ActorMotion
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.files.trial_table import read_table, write_table
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.geometry import rotations
from highfive.model.hgpdm import presets
from highfive.model.hgpdm.presets import DEFAULT

SEED = 5  # of the folder ``captured``
CELL = "C3"
BODY = 23  # joints before those of the fingers
TOUCH = 6  # frames that the simulated palms stay together


@pytest.fixture(scope="module")
def truth() -> PairTrial:
    return simulate_pair("angry", CELL, 0, trial_seed(SEED, "angry", CELL, 0))


@pytest.fixture(scope="module")
def solved(captured: Path, tmp_path_factory: pytest.TempPathFactory) -> SolvedPair:
    """One trial of two from which the actor's body is fitted."""
    folder = tmp_path_factory.mktemp("pair")
    cells = (CELL, "B2")
    for cell in cells:
        shutil.copy(captured / f"angry_{cell}_1.c3d", folder)
    write_table(folder, [(f"angry_{cell}_1.c3d", "angry", cell, "1", "test") for cell in cells])
    return load_trials(folder)[0]


def palm_of(motion: ActorMotion) -> np.ndarray:
    kinematics = motion.skeleton.forward_kinematics(motion.root_in_world, motion.quaternions)
    return right_palm(motion.skeleton, *kinematics)[0]


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.square(values), axis=0))


@pytest.mark.slow
def test_solved_joints_are_the_actors_true_ones(solved: SolvedPair, truth: PairTrial) -> None:
    found = avatar_skeleton().from_rotation_vectors(solved.trial.joints)
    turned = rotations.multiply(rotations.conjugate(truth.avatar.quaternions), found)
    error = np.degrees(np.linalg.norm(rotations.to_rotation_vector(turned), axis=-1))
    assert rms(error)[:BODY].max() < 1.5
    # A finger carries one marker or none: its joints share a bend that is right on the whole.
    assert rms(error)[BODY:].mean() < 8.0
    assert np.linalg.norm(solved.trial.root - truth.avatar.root_in_world, axis=-1).max() < 3e-3


@pytest.mark.slow
def test_palms_are_where_they_really_are(solved: SolvedPair, truth: PairTrial) -> None:
    assert np.linalg.norm(solved.trial.palm - palm_of(truth.avatar), axis=-1).max() < 4e-3
    # The person's is the tracker's, which knows the hand's size only from the markers.
    assert np.linalg.norm(solved.trial.person_palm - palm_of(truth.person), axis=-1).max() < 6e-3


@pytest.mark.slow
def test_contact_is_found_while_the_palms_touch(solved: SolvedPair, truth: PairTrial) -> None:
    assert -2 <= solved.trial.contact_frame - truth.contact_frame <= TOUCH + 2


@pytest.mark.slow
def test_a_trial_says_what_the_table_said(solved: SolvedPair) -> None:
    trial = solved.trial
    assert (trial.emotion, trial.cell, trial.repetition, trial.test, trial.rate_hz) == ("angry", CELL, 1, True, 120.0)
    assert solved.markers == load_marker_set("full_body").names
    # Noise of 0.5 mm a coordinate is 0.87 mm in space.
    assert np.median(solved.rms) < 1.0e-3 and solved.rms.max() < 3e-3


@pytest.mark.slow
def test_the_hand_is_that_of_the_online_chain(captured: Path, solved: SolvedPair) -> None:
    person = read_c3d(captured / f"angry_{CELL}_1.c3d").person("human")
    points, palm, _ = track_hand(person, load_marker_set("paper"))
    np.testing.assert_array_equal(points, solved.trial.hand_points)
    np.testing.assert_array_equal(palm, solved.trial.person_palm)
    # A palm is beyond the wrist, before the knuckles' far side.
    wrist, knuckles = points[:, 0], points[:, 1]
    assert np.all(np.linalg.norm(palm - wrist, axis=-1) < np.linalg.norm(knuckles - wrist, axis=-1) + 0.02)


@pytest.mark.slow
def test_an_arm_of_which_a_marker_is_never_seen_is_none(captured: Path) -> None:
    person = read_c3d(captured / f"angry_{CELL}_1.c3d").person("human")
    assert track_hand(person, load_marker_set("paper"))[2] is not None
    valid = person.valid.copy()
    valid[:, person.names.index("RSHO")] = False
    unseen = make_recording(person.rate_hz, person.names, person.points, valid)
    hand, _, arm = track_hand(unseen, load_marker_set("paper"))
    assert arm is None and np.isfinite(hand).all()


def test_an_arm_that_is_hidden_at_the_end_stays_where_it_was(captured: Path) -> None:
    """One gap, wherever it lies, costs no trial its arm."""
    person = read_c3d(captured / f"angry_{CELL}_1.c3d").person("human")
    whole = track_hand(person, load_marker_set("paper"))[2]
    valid = person.valid.copy()
    valid[-60:, person.names.index("RELB")] = False
    gap = make_recording(person.rate_hz, person.names, person.points, valid)
    arm = track_hand(gap, load_marker_set("paper"))[2]
    assert whole is not None and arm is not None
    assert np.linalg.norm(arm - whole, axis=-1).max() < 0.1


def test_a_table_may_leave_cell_and_repetition_empty_and_have_more_columns(tmp_path: Path) -> None:
    (tmp_path / "trials.csv").write_text(
        "\ufeffsplit,file,emotion,cell,repetition,note\ntest, a.c3d ,happy,,,late\n", encoding="utf-8"
    )
    (row,) = read_table(tmp_path)
    assert (row.file, row.emotion, row.cell, row.repetition, row.test) == ("a.c3d", "happy", "", -1, True)


@pytest.mark.slow(50)
def test_a_model_trained_on_a_small_capture_answers_a_session(
    captured: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(presets.PRESETS, "small", replace(DEFAULT, name="small", iterations=40, points=900))
    monkeypatch.chdir(tmp_path)

    def highfive(*words: object) -> dict:
        monkeypatch.setattr("sys.argv", ["highfive", *map(str, words), "--json"])
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        assert end.value.code in (None, 0), err
        return json.loads(out)

    trained = highfive(
        "train", captured, "--preset", "small", "--no-distractors", "--inducing", 60, "--out", "tiny.safetensors"
    )
    assert trained["trials"] == 9 and trained["preset"] == "small"
    assert trained["marker_rms_mm_all"] < 1.5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tiny.safetensors"]
    words = ("--source", captured / "angry_B2_1.c3d", "--human", "human", "--no-pictures", "--out", "session")
    summary = highfive("simulate", "--model", "tiny.safetensors", *words)
    assert summary["model"] == "tiny.safetensors" and list(summary["contact_error_mm"]["by_emotion"]) == ["angry"]
    assert summary["trials"] == 1 and summary["contact_error_mm"]["max"] <= 5.0

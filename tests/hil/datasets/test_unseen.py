"""Recordings that nobody here prepared: what comes out against what the people really did."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from real_pair import write_real_set
from unseen import HABITS, Export, palm_of, walking_pair, write_set

from highfive.hil.cli import main as cli
from highfive.hil.datasets.dyads import Role, read_pairs
from highfive.hil.datasets.training_data import SolvedPair, contact_frame, load_trials, unwrapped
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.trial_table import read_table, write_table
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.hgpdm import presets
from highfive.model.hgpdm.presets import DEFAULT

CELLS = ("B2", "A3")
BODY = 23  # joints before those of the fingers
Z_UP = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
LEFT_HANDED_Y_UP = ((1, 0, 0), (0, 0, 1), (0, 1, 0))
EXPORTS = {
    "depth camera, y up, mm": Export(),
    "Mixamo names, centimetres called millimetres": Export("mixamo", ("mm", 100.0)),
    "left-handers, z up": Export("short", ("m", 1.0), Z_UP, left_handers=True),
    "left-handed axes": Export("zed", ("m", 1.0), LEFT_HANDED_Y_UP),
    "labels without meaning, metres called millimetres": Export("numbers", ("mm", 1.0)),
}
QUICK = {"left-handed axes", "labels without meaning, metres called millimetres"}
"""Exports that are read in the fast tests, too: one that is mirrored, and one in which nothing is said."""


def joints_of(skeleton, root, quaternions):
    return skeleton.forward_kinematics(root, quaternions)[0][:, :BODY]


def check(pair: SolvedPair, cell: str, number: int) -> None:
    """The solved trial is what the simulated pair did, from where the actor stood at first."""
    truth = walking_pair(cell, number)
    frames = len(pair.trial.joints)
    assert 0 <= len(truth.avatar.root_in_world) - frames < 4
    start = truth.avatar.root_in_world[0] * [1, 1, 0]
    skeleton = avatar_skeleton()
    found = joints_of(skeleton, pair.trial.root, skeleton.from_rotation_vectors(pair.trial.joints))
    true = joints_of(skeleton, truth.avatar.root_in_world - start, truth.avatar.quaternions)[:frames]
    error = np.linalg.norm(found - true, axis=-1)
    assert error.mean() < 0.025 and error.max() < 0.10
    palm = np.linalg.norm(pair.trial.person_palm - (palm_of(truth.person) - start)[:frames], axis=-1)
    assert palm[pair.trial.contact_frame] < 0.03
    assert abs(pair.trial.contact_frame - truth.contact_frame) <= 4
    gap = np.linalg.norm(pair.trial.palm - pair.trial.person_palm, axis=-1)
    assert gap[pair.trial.contact_frame] < 0.04
    assert np.sqrt(np.mean(pair.rms**2)) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize(
    "export",
    [
        pytest.param(export, id=name, marks=[] if name in QUICK else pytest.mark.slow)
        for name, export in EXPORTS.items()
    ],
)
def test_any_export_gives_the_motion_that_was(tmp_path: Path, export: Export) -> None:
    write_set(tmp_path, CELLS[:1], export, test=0)
    said: list[str] = []
    (pair,) = load_trials(tmp_path, say=said.append)
    check(pair, CELLS[0], 0)
    assert any("left hands are mirrored" in line for line in said) == export.left_handers
    assert any("left-handed" in line for line in said) == (export.axes == LEFT_HANDED_Y_UP)
    assert any("by how they move" in line for line in said) == (export.habit == "numbers")


@pytest.mark.slow
def test_a_damaged_recording_costs_its_own_trial_only(tmp_path: Path) -> None:
    write_set(tmp_path, CELLS, Export(), test=0)
    damaged, whole = (row.file for row in read_table(tmp_path))
    content = (tmp_path / damaged).read_bytes()
    (tmp_path / damaged).write_bytes(content[: len(content) // 2])
    said: list[str] = []
    (pair,) = load_trials(tmp_path, say=said.append)
    check(pair, CELLS[1], 1)
    assert sum(damaged in line and "left out" in line for line in said) == 1
    (tmp_path / whole).write_bytes(b"")
    with pytest.raises(HighFiveError, match="none of the 2 files can be read"):
        load_trials(tmp_path, say=said.append)
    (tmp_path / whole).unlink()
    with pytest.raises(HighFiveError, match=whole):
        load_trials(tmp_path, say=said.append)


@pytest.mark.slow
def test_actors_of_other_sizes_bring_the_scene_to_the_avatars_size(tmp_path: Path) -> None:
    """A short and a tall actor: each was measured, and the palms meet where the avatar's palm is."""
    for number, size in enumerate((0.92, 1.06)):
        write_set(tmp_path / str(number), CELLS[: number + 1], Export(size=size), test=0)
        (tmp_path / str(number) / f"take{number}.c3d").rename(tmp_path / f"take{number}.c3d")
    write_table(tmp_path, [(f"take{n}.c3d", "neutral", "", "", "train") for n in (0, 1)])
    said: list[str] = []
    for number, pair in enumerate(load_trials(tmp_path, say=said.append)):
        trial = pair.trial
        assert np.linalg.norm(trial.palm - trial.person_palm, axis=-1)[trial.contact_frame] < 0.04
        truth = walking_pair(CELLS[number], number)
        start = truth.avatar.root_in_world[0] * [1, 1, 0]
        walked = truth.avatar.root_in_world[-1] - start
        np.testing.assert_allclose(trial.root[-1], walked, atol=0.04)
    assert "the limbs are those of 2 actors; each was measured" in said


@pytest.mark.slow
def test_bad_takes_are_left_out_with_a_word(tmp_path: Path) -> None:
    write_set(tmp_path, CELLS, Export(), test=0)
    whole = read_c3d(tmp_path / "take1.c3d")
    none = {"unlabelled": whole.unlabelled[:5], "unlabelled_valid": whole.unlabelled_valid[:5]}
    write_c3d(tmp_path / "short.c3d", replace(whole, points=whole.points[:5], valid=whole.valid[:5], **none))
    alone = [name.startswith("human") for name in whole.names]
    write_c3d(tmp_path / "alone.c3d", replace(whole, valid=whole.valid & alone))
    names = ("take0.c3d", "short.c3d", "alone.c3d", "take1.c3d")
    write_table(tmp_path, [(name, "neutral", "", "", "train") for name in names])
    said: list[str] = []
    read = read_pairs([tmp_path / name for name in names], Role("human", None), Role("Avatar", None), said.append)
    assert read.kept == (0, 3)
    assert any(line.startswith("short.c3d is left out") for line in said)
    assert any(line.startswith("alone.c3d is left out") for line in said)
    write_table(tmp_path, [("short.c3d", "neutral", "", "", "train")])
    with pytest.raises(HighFiveError, match="none of the 1 files shows two people"):
        load_trials(tmp_path, say=said.append)


def rewritten(path: Path, **changes) -> None:
    whole = read_c3d(path)
    none = {"unlabelled": whole.unlabelled[:, :0], "unlabelled_valid": whole.unlabelled_valid[:, :0]}
    write_c3d(path, replace(whole, **(none | {name: change(whole) for name, change in changes.items()})))


def test_two_people_of_other_names_are_found_where_nobody_was_requested(tmp_path: Path) -> None:
    write_set(tmp_path, CELLS, Export("mixamo"), test=0)
    files = [tmp_path / f"take{n}.c3d" for n in range(2)]
    for path in files:
        rewritten(path, names=lambda r: [n.replace("human:", "p1:").replace("avatar:", "p2:") for n in r.names])
    said: list[str] = []
    read = read_pairs(files, Role("human", None), Role("avatar", None), said.append)
    assert read.kept == (0, 1)
    assert any("p1 is taken for the person, p2 for the avatar's actor" in line for line in said)
    turned = read_pairs(files, Role("p2", None), Role("p1", None), said.append)
    np.testing.assert_array_equal(turned.pairs[0][0].valid, read.pairs[0][1].valid)
    with pytest.raises(HighFiveError, match="no labels of 'human'"):
        read_pairs(files, Role("human", None), Role("robot", None), said.append)


def test_a_trial_lasts_as_long_as_both_are_seen(tmp_path: Path) -> None:
    write_set(tmp_path, CELLS[:1], Export(), test=0)

    def gone(recording):
        valid = recording.valid.copy()
        human = np.array([name.startswith("human") for name in recording.names])
        valid[:7, human] = valid[-11:, ~human] = False
        valid[20:25, human] = False  # a gap in between stays one
        return valid

    frames = len(read_c3d(tmp_path / "take0.c3d"))
    rewritten(tmp_path / "take0.c3d", valid=gone)
    read = read_pairs([tmp_path / "take0.c3d"], Role("human", None), Role("avatar", None), lambda line: None)
    person, actor = read.pairs[0]
    assert len(person) == len(actor) == frames - 18
    seen = np.flatnonzero(~person.valid.any(axis=1))
    assert seen.tolist() == [13, 14, 15, 16, 17]


def test_a_person_who_is_not_there_is_named(tmp_path: Path) -> None:
    write_set(tmp_path, CELLS[:1], Export(), test=0)
    with pytest.raises(HighFiveError, match="no labels of 'robot'; the persons in it are: human, avatar"):
        read_pairs([tmp_path / "take0.c3d"], Role("human", None), Role("robot", None), print)


def test_contact_is_when_palms_come_together_not_when_noise_is_least() -> None:
    approach = np.concatenate([np.linspace(0.5, 0.02, 60), np.full(40, 0.02), np.linspace(0.02, 0.5, 60)])
    for seed in range(20):
        noisy = approach + np.random.default_rng(seed).uniform(-0.0014, 0.0014, len(approach))
        assert contact_frame(noisy, 120.0) in (59, 60)
    # A hand that came near before, and went away again, has not met yet.
    twice = np.concatenate([np.linspace(0.5, 0.021, 40), np.linspace(0.021, 0.4, 30), np.linspace(0.4, 0.02, 30)])
    assert contact_frame(twice, 120.0) == 99


@pytest.mark.parametrize("speed", [0.08, 0.16, 0.3, 1.0, 3.0])
def test_contact_of_slow_palms_is_not_when_they_are_nearly_there(speed: float) -> None:
    """3 mm before contact a slow palm is 20 to 40 ms from it."""
    seconds = np.arange(-60, 60) / 120.0
    for least in (0.0, 0.08):  # markers on the backs of hands stay apart
        for seed in range(20):
            noise = np.random.default_rng(seed).uniform(-0.0005, 0.0005, len(seconds))
            frame = contact_frame(least + speed * np.abs(seconds) + noise, 120.0)
            assert abs(seconds[frame]) < 1.1 / 120.0


def test_rotation_vectors_go_on_past_half_a_turn() -> None:
    angle = np.linspace(0.0, 6.0, 200)
    wrapped = rotations.to_rotation_vector(rotations.from_axis_angle("z", angle))
    np.testing.assert_allclose(unwrapped(wrapped)[:, 2], angle, atol=1e-9)
    still = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 6))
    np.testing.assert_array_equal(unwrapped(still), still)


def test_every_habit_of_naming_keeps_the_arms() -> None:
    for name, habit in HABITS.items():
        assert all(habit(f"{side}_{joint}") for side in ("LEFT", "RIGHT") for joint in ("SHOULDER", "WRIST")), name


@pytest.mark.data
@pytest.mark.slow
def test_the_real_high_five_in_pieces(recordings: Path, tmp_path: Path) -> None:
    write_real_set(recordings, tmp_path, 3)
    pairs = load_trials(tmp_path, say=lambda line: None)
    skeleton = avatar_skeleton()
    for pair in pairs:
        trial = pair.trial
        assert np.sqrt(np.mean(pair.rms**2)) < 0.003 and pair.rms.max() < 0.01
        hinges = skeleton.to_hinges(skeleton.from_rotation_vectors(trial.joints))[:, 1:]
        low, high = np.moveaxis(skeleton.hinge_limits[1:], -1, 0)
        assert np.degrees(np.maximum(low - hinges, hinges - high).max()) < 2.0  # what the spline overshoots
        assert np.abs(np.diff(hinges, axis=0)).max() * trial.rate_hz < 25.0  # rad/s: no joint jumps
        palm = trial.palm[trial.contact_frame]
        # The published recording shows the fingers nearest 0.10 m apart, above the heads.
        assert np.linalg.norm(palm - trial.person_palm[trial.contact_frame]) < 0.12
        assert 0.4 < palm[0] < 1.1 and abs(palm[1]) < 0.2 and 1.6 < palm[2] < 2.0
        assert abs(trial.root[0, 1]) < 0.05
    assert [row.test for row in read_table(tmp_path)] == [False, False, False]


@pytest.mark.slow(35)
def test_a_model_is_trained_on_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(presets.PRESETS, "small", replace(DEFAULT, name="small", iterations=30, points=600))
    write_set(tmp_path / "lab", ("B2", "A3", "C1", "B1", "A2"), Export(noise=0.004))
    monkeypatch.chdir(tmp_path)
    words = [
        "highfive",
        "train",
        "lab",
        "--preset",
        "small",
        "--no-distractors",
        "--inducing",
        "40",
        "--out",
        "m.safetensors",
        "--json",
    ]
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as end:
        cli.main()
    out, err = capsys.readouterr()
    assert end.value.code in (None, 0), err
    assert json.loads(out)["trials"] == 4
    assert "recognised as joint centres" in err

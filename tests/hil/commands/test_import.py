"""``highfive import``: a simulated pair in other programs' files comes back as the C3D file that it would have been."""

import json
from functools import cache

import numpy as np
import pytest
from command_line import failing, running
from disk import files_no_larger_than
from foreign_files import table, trc, y_up

from highfive.hil.datasets.dyads import Role, read_pairs
from highfive.hil.recording.exports.bvh import bvh
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.people.capture import CLEAN, record_pair, trial_seed
from highfive.mocap_bridge.files.c3d import read_c3d

run, fails = running("import"), failing("import")
TENTH_MM = 1e-4


@cache
def pair():
    return simulate_pair("happy", "B2", 0, trial_seed(3, "happy", "B2", 0))


@cache
def markers():
    return record_pair(pair(), CLEAN, np.random.default_rng(0))


def unseen_as_nan(some=slice(None)):
    points = markers().points.copy()
    points[10:20, 4] = np.nan
    return points[some]


def skeleton_file(path, actor, scale=1.0):
    motion = getattr(pair(), actor)
    whole = motion.skeleton.scaled(scale)
    path.write_bytes(bvh(whole, scale * motion.root_in_world, motion.quaternions, 120.0))


def test_trc_of_both_people_in_y_up_millimetres(run, tmp_path):
    (tmp_path / "a.trc").write_text(trc(markers().names, 1e3 * y_up(unseen_as_nan()), 120.0))
    code, out, _ = run(tmp_path / "a.trc", "--to", tmp_path / "data", "--emotion", "happy", "--json")
    said = json.loads(out)
    assert code == 0 and said["frames"] == len(markers())
    assert said["trials"][0]["people"] == ["human", "avatar"]
    found = read_c3d(tmp_path / "data" / "a.c3d")
    assert found.names == markers().names and found.rate_hz == 120.0
    assert not found.valid[10:20, 4].any() and found.valid.sum() == found.valid.size - 10
    np.testing.assert_allclose(found.points[found.valid], markers().points[found.valid], atol=2e-6)
    (row,) = (tmp_path / "data" / "trials.csv").read_text().split()[1:]
    assert row == "a.c3d,happy,,,"


@pytest.mark.parametrize("unit", ["m", "cm", "mm"])
@pytest.mark.slow
def test_tables_tell_unit_and_vertical_by_the_people(run, tmp_path, unit):
    scale = {"m": 1.0, "cm": 100.0, "mm": 1000.0}[unit]
    (tmp_path / "up_z.csv").write_text(table(markers().names, scale * unseen_as_nan(), 120.0))
    (tmp_path / "up_y.csv").write_text(table(markers().names, scale * y_up(unseen_as_nan()), 120.0, ";", ","))
    words = (tmp_path / "up_z.csv", tmp_path / "up_y.csv", "--to", tmp_path / "data")
    if unit == "cm":  # arm and head alone extend over 70 cm, a whole person over 70 inches
        code, _, said = run(*words)
        assert code == 2 and "in doubt" in said
        words = (*words, "--units", "cm")
    assert run(*words)[0] == 0
    for name in ("up_z.c3d", "up_y.c3d"):
        found = read_c3d(tmp_path / "data" / name)
        np.testing.assert_allclose(found.points[found.valid], markers().points[found.valid], atol=2e-6)


@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_two_skeletons_become_one_trial_that_is_read_as_any(run, tmp_path, scale):
    skeleton_file(tmp_path / "person.bvh", "person", scale)
    skeleton_file(tmp_path / "actor.bvh", "avatar", scale)
    files = ("--human", tmp_path / "person.bvh", "--avatar", tmp_path / "actor.bvh")
    assert run(*files, "--to", tmp_path / "data", "--emotion", "happy")[0] == 0
    found = read_c3d(tmp_path / "data" / "person.c3d")
    # Up is found; which way the two look is the file's: BVH says +z is ahead, which comes to be −y.
    for role, actor in (("human", pair().person), ("avatar", pair().avatar)):
        truth, _ = actor.skeleton.forward_kinematics(actor.root_in_world, actor.quaternions)
        ours = found.person(role)
        for name in ("right_wrist", "head", "pelvis", "left_ankle"):
            there = truth[:, actor.skeleton.index(name)] @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
            assert np.abs(ours.points[:, ours.names.index(name)] - there).max() < TENTH_MM
    said = []
    read = read_pairs([tmp_path / "data" / "person.c3d"], Role("human", None), Role("avatar", None), said.append)
    person, actor = read.pairs[0]
    wrist = person.names.index("right_wrist"), actor.names.index("right_wrist")
    nearest = np.linalg.norm(person.points[:, wrist[0]] - actor.points[:, wrist[1]], axis=1)
    meets = pair().contact_frame
    assert abs(int(np.argmin(nearest)) - meets) < 12


def test_folders_pair_files_of_one_name(run, fails, tmp_path):
    for who in ("person", "avatar"):
        (tmp_path / who).mkdir()
        skeleton_file(tmp_path / who / "one.bvh", who)
    folders = ("--human", tmp_path / "person", "--avatar", tmp_path / "avatar")
    assert run(*folders, "--to", tmp_path / "data")[0] == 0
    assert sorted(path.name for path in (tmp_path / "data").iterdir()) == ["one.c3d", "trials.csv"]
    skeleton_file(tmp_path / "person" / "two.bvh", "person")
    assert "two is in one of them only" in fails(*folders, "--to", tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_prefixes_of_a_labs_own(run, fails, tmp_path):
    names = [name.replace("human:", "Anna_").replace("avatar:", "Ben_") for name in markers().names]
    (tmp_path / "a.csv").write_text(table(names, unseen_as_nan(), 120.0))
    given = (tmp_path / "a.csv", "--to", tmp_path / "data", "--human", "Anna")
    assert run(*given, "--avatar", "Ben")[0] == 0
    assert read_c3d(tmp_path / "data" / "a.c3d").names == markers().names
    assert "no labels of 'Bert'" in fails(*given, "--avatar", "Bert", "--overwrite")


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize("write", [trc, table])
def test_a_real_pair_comes_back_as_it_was(run, recordings, tmp_path, write):
    real = read_c3d(recordings / "high_five" / "cmu_20_21_11_high_five.c3d")
    name = "real.trc" if write is trc else "real.csv"
    (tmp_path / name).write_text(write(real.names, 1e3 * y_up(real.points), real.rate_hz))
    assert run(tmp_path / name, "--to", tmp_path / "data", "--human", "A", "--avatar", "B")[0] == 0
    found = read_c3d(tmp_path / "data" / "real.c3d")
    assert found.prefixes == ("human", "avatar") and found.rate_hz == pytest.approx(120.0)
    np.testing.assert_allclose(found.points, real.points, atol=2e-6)


def test_a_full_disk_is_one_line_and_leaves_nothing(run, tmp_path):
    skeleton_file(tmp_path / "a.bvh", "avatar")
    with files_no_larger_than(50_000):
        code, _, err = run(tmp_path / "a.bvh", "--to", tmp_path / "data")
    (line,) = [line for line in err.splitlines() if line.startswith("error:")]
    assert code == 2 and "cannot write" in line
    assert not (tmp_path / "data").exists()


def test_one_person_alone_is_said(run, tmp_path):
    skeleton_file(tmp_path / "a.bvh", "avatar")
    code, out, err = run(tmp_path / "a.bvh", "--to", tmp_path / "data")
    assert code == 0 and "of one person only" in err
    assert "highfive train" not in out and f"highfive simulate --source {tmp_path / 'data' / 'a.c3d'}" in out


def test_the_person_alone_is_imported_to_be_played(run, fails, tmp_path):
    (tmp_path / "people").mkdir()
    (tmp_path / "none").mkdir()
    for name in ("a", "b"):
        skeleton_file(tmp_path / "people" / f"{name}.bvh", "person")
    code, out, err = run("--human", tmp_path / "people" / "a.bvh", "--to", tmp_path / "one")
    assert code == 0 and "of one person only" in err and "not to learn from: a.c3d" in err
    assert f"highfive simulate --source {tmp_path / 'one' / 'a.c3d'}" in out
    assert read_c3d(tmp_path / "one" / "a.c3d").prefixes == ("human",)
    assert run("--human", tmp_path / "people", "--to", tmp_path / "two")[0] == 0
    assert sorted(path.name for path in (tmp_path / "two").iterdir()) == ["a.c3d", "b.c3d", "trials.csv"]
    assert "there is no .bvh" in fails("--human", tmp_path / "none", "--to", tmp_path / "three")
    assert "--human FILE alone" in fails("--avatar", tmp_path / "people" / "a.bvh", "--to", tmp_path / "three")


def test_doubts_are_refused_until_somebody_says(run, fails, tmp_path):
    (tmp_path / "a.csv").write_text(table([f"P{m}" for m in range(20)], markers().points[:, :20], 120.0))
    to = ("--to", tmp_path / "data")
    assert "which axis is up is in doubt" in fails(tmp_path / "a.csv", *to)
    assert run(tmp_path / "a.csv", *to, "--up", "z")[0] == 0
    skeleton_file(tmp_path / "b.bvh", "avatar", 17.0)  # the unit of CMU's
    assert "--units" in fails(tmp_path / "b.bvh", *to, "--overwrite")
    assert run(tmp_path / "b.bvh", *to, "--overwrite", "--units", 1 / 17.0)[0] == 0
    found = read_c3d(tmp_path / "data" / "b.c3d")
    assert found.points[0, found.names.index("pelvis"), 2] == pytest.approx(pair().avatar.root_in_world[0, 2], abs=1e-4)
    (tmp_path / "down.csv").write_text(table(markers().names, markers().points * [1.0, -1.0, -1.0], 120.0))
    assert "heads are towards -z" in fails(tmp_path / "down.csv", *to, "--overwrite")


def test_a_hand_that_is_missing_is_named(fails, tmp_path):
    skeleton_file(tmp_path / "a.bvh", "avatar")
    text = (tmp_path / "a.bvh").read_text().replace("right_wrist", "right_blob")
    (tmp_path / "a.bvh").write_text(text)
    assert "no right_wrist is recognised" in fails(tmp_path / "a.bvh", "--to", tmp_path / "data")


@pytest.mark.parametrize("name", ["a.bvh", "a.trc", "a.csv"])
@pytest.mark.parametrize(
    ("content", "says"), [(b"", "is empty"), (bytes(range(256)) * 9, "no text"), (b"junk\nand more of it\n", "a.")]
)
def test_junk_is_refused(fails, tmp_path, name, content, says):
    (tmp_path / name).write_bytes(content)
    assert says in fails(tmp_path / name, "--to", tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_refusals(fails, tmp_path):
    nan = np.full((9, 46, 3), np.nan)
    (tmp_path / "a.trc").write_text(trc(markers().names[:46], nan, 120.0))
    to = ("--to", tmp_path / "data")
    assert "not one measured point" in fails(tmp_path / "a.trc", *to)
    assert "--units says m" in fails(tmp_path / "a.trc", *to, "--units", "m")
    for units in ("feet", "0", "-1", "nan"):
        assert "mm, cm, m, in, or the metres" in fails(tmp_path / "a.trc", *to, "--units", units)
    assert "y or z" in fails(tmp_path / "a.trc", *to, "--up", "x")
    assert "no import needed" in fails(tmp_path / "a.c3d", *to)
    assert "give files" in fails(*to)
    assert "become a.c3d" in fails(tmp_path / "a.trc", tmp_path / "b" / "a.trc", *to)
    assert not (tmp_path / "data").exists()
    full = tmp_path / "full"
    full.mkdir()
    (full / "mine").write_text("")
    (tmp_path / "b.csv").write_text(table(markers().names, markers().points, 120.0))
    assert "--overwrite" in fails(tmp_path / "b.csv", "--to", full)

"""``highfive import`` of BVH: whatever order, unit and vertical a program writes a motion in, it is the same motion."""

from functools import cache

import numpy as np
import pytest
from bvh_by_the_format import Bvh, read_bvh
from bvh_rewritten import names_of, rewritten, text_of, without
from command_line import failing, running

from highfive.hil.recording.exports.bvh import bvh
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.people.capture import trial_seed
from highfive.mocap_bridge.files.c3d import read_c3d

run, fails = running("import"), failing("import")
TENTH_MM = 1e-4


@cache
def actor():
    return simulate_pair("happy", "B2", 0, trial_seed(3, "happy", "B2", 0)).avatar


@pytest.fixture
def usual(tmp_path) -> Bvh:
    """The avatar's actor, as ``export`` writes her."""
    path = tmp_path / "usual.bvh"
    path.write_bytes(bvh(actor().skeleton, actor().root_in_world, actor().quaternions, 120.0))
    return read_bvh(path)


def imported(run, path, *words):
    folder = path.with_suffix("")
    assert run(path, "--to", folder, *words)[0] == 0
    found = read_c3d(folder / f"{path.stem}.c3d")
    assert found.valid.all()
    return {name: found.points[:, m] for m, name in enumerate(found.names)}


@pytest.mark.parametrize(
    ("scale", "late", "up", "words"),
    [
        (1.0, False, "y", ()),
        (1.0, True, "y", ()),
        (100.0, False, "y", ()),
        (1000.0, True, "z", ()),
        (1.0 / 0.0254, False, "y", ("--units", "in")),
        (1.0 / 0.056444, True, "z", ("--units", "0.056444")),  # CMU's
    ],
)
@pytest.mark.slow
def test_another_order_and_unit_is_the_same_motion(run, tmp_path, usual, scale, late, up, words):
    theirs = imported(run, tmp_path / "usual.bvh")
    other = rewritten(usual, np.random.default_rng(round(scale)), scale, late, up)
    assert names_of(other) != names_of(usual) and sorted(names_of(other)) == sorted(names_of(usual))
    path = tmp_path / "other.bvh"
    path.write_text(text_of(other))
    found = imported(run, path, *words)
    assert found.keys() == theirs.keys()
    off = {name: float(np.abs(found[name] - theirs[name]).max()) for name in theirs}
    assert max(off.values()) < TENTH_MM, max(off, key=off.__getitem__)
    # Not by our own reader alone: the file's joints as the format has them, and the actor's as her skeleton has them.
    y_up = {name: scale * theirs[name] @ [[1, 0, 0], [0, 0, -1], [0, 1, 0]] for name in theirs}
    for name, there in read_bvh(path).places().items():
        expected = y_up[name] if up == "y" else scale * theirs[name]
        assert np.abs(there - expected).max() < scale * TENTH_MM
    truth, _ = actor().skeleton.forward_kinematics(actor().root_in_world, actor().quaternions)
    for j, name in enumerate(actor().skeleton.names):
        assert np.abs(found[name] - truth[:, j] @ [[0, -1, 0], [1, 0, 0], [0, 0, 1]]).max() < TENTH_MM


def test_a_right_hand_that_is_missing_is_one_line(fails, tmp_path, usual):
    path = tmp_path / "handless.bvh"
    path.write_text(text_of(without(usual, "right_wrist")))
    said = fails(path, "--to", tmp_path / "data")
    assert "handless.bvh: no right_wrist is recognised (recognised: right_shoulder as right_shoulder, " in said
    assert len(said) < 500 and "not recognised: " in said and said.rstrip().endswith("; rename its joints")
    assert not (tmp_path / "data").exists()


def test_without_a_left_hand_or_fingers_the_rest_is_the_same(run, tmp_path, usual):
    theirs = imported(run, tmp_path / "usual.bvh")
    less = without(usual, "left_wrist")
    for finger in ("thumb", "index", "middle", "ring", "little"):
        less = without(less, f"right_{finger}_1")
    path = tmp_path / "less.bvh"
    path.write_text(text_of(less))
    found = imported(run, path)
    assert "right_wrist" in found and not [name for name in found if "index" in name or name == "left_wrist"]
    for name in found.keys() & theirs.keys():
        assert np.abs(found[name] - theirs[name]).max() < TENTH_MM

"""The animated GLB: bones go where bodies went, and every vertex with them as on the page."""

import json
import shutil
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from shipped import exported, shipped_trials
from test_skin_file import Glb, seen

from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.cast import Cast
from highfive.hil.view.moving_skin import glb_files
from highfive.hil.view.recorded import recorded_trials
from highfive.hil.view.skin_file import FAR, SKIN, skin_file
from highfive.model.geometry import rotations

TRIAL = 2
ROUNDED = 3e-5
"""Entries of a rotation matrix: a recording's quaternions are rounded to 1e-5, and one of the two ways normalises."""


@cache
def data() -> bytes:
    (file,) = glb_files(exported(shipped_trials()[TRIAL]), ["session_trial02.glb"])
    with TemporaryDirectory() as folder:
        path = Path(folder) / file.name
        file.write(path)
        return path.read_bytes()


@cache
def bodies():
    return recorded_trials(SHIPPED_RECORDING, seen())[TRIAL].bodies


@pytest.mark.slow
def test_each_bone_has_its_body_in_every_tick():
    glb = Glb(data())
    (animation,) = glb.document["animations"]
    trial = shipped_trials()[TRIAL]
    tracks = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        times = glb.array(sampler["input"])[:, 0]
        np.testing.assert_allclose(times, trial.times - trial.times[0], atol=1e-6)
        assert glb.document["accessors"][sampler["input"]]["max"] == [pytest.approx(times[-1])]
        name = glb.document["nodes"][channel["target"]["node"]]["name"]
        tracks[name, channel["target"]["path"]] = glb.array(sampler["output"])
    names = Cast.of(seen().model).names
    assert len(tracks) == 2 * len(names)
    for body, name in enumerate(names):
        np.testing.assert_allclose(tracks[name, "translation"], bodies()[:, body, :3], atol=1e-5)
        turns = tracks[name, "rotation"][:, [3, 0, 1, 2]]
        np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-6)
        assert (np.sum(turns[1:] * turns[:-1], axis=1) > 0.0).all()  # no way round
        same = rotations.to_matrix(turns) - rotations.to_matrix(rotations.normalize(bodies()[:, body, 3:]))
        assert np.abs(same).max() < ROUNDED


@pytest.mark.slow
def test_skins_are_those_of_the_page_in_the_first_pose():
    glb, page = Glb(data()), Glb(skin_file(Cast.of(seen().model)))
    bones = np.tile(np.eye(4), (bodies().shape[1], 1, 1))
    bones[:, :3, 3], bones[:, :3, :3] = bodies()[0, :, :3], rotations.to_matrix(bodies()[0, :, 3:])
    names = {node["name"] for node in glb.document["nodes"]}
    assert not any(name.endswith(FAR) for name in names)
    skins = [name for name in names if name.startswith(SKIN)]
    assert {f"{name}{FAR}" for name in skins} < {node["name"] for node in page.document["nodes"]}
    for name in skins:
        np.testing.assert_array_equal(glb.placed(name, bones), page.placed(name, bones))
    for bone, node in enumerate(glb.document["nodes"][: bodies().shape[1]]):
        np.testing.assert_allclose(node["translation"], bodies()[0, bone, :3], atol=1e-5)


def test_eyes_are_round_and_look_outwards():
    glb = Glb(data())
    eyes = [mesh for mesh in glb.document["meshes"] if mesh["name"].endswith("_eye")]
    assert len(eyes) == 4
    for eye in eyes:
        attributes = eye["primitives"][0]["attributes"]
        points, normals = glb.array(attributes["POSITION"]), glb.array(attributes["NORMAL"])
        np.testing.assert_allclose(points, 0.013 * normals, atol=1e-6)
        corners = points[glb.array(eye["primitives"][0]["indices"]).reshape(-1, 3)]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.sum(across * corners.mean(axis=1), axis=1) > 0.0).all()


def test_nodes_are_each_in_one_place_and_skinned_ones_at_the_root():
    document = Glb(data()).document
    children = [child for node in document["nodes"] for child in node.get("children", [])]
    placed = [*children, *document["scenes"][0]["nodes"]]
    assert sorted(placed) == list(range(len(document["nodes"])))
    assert all("skin" not in document["nodes"][child] for child in children)


VALIDATOR = "gltf-validator@2.0.0-dev.3.10"
"""Khronos' own (npm, Apache-2.0, 2 MB)."""
VALIDATES = """
const file = require("fs").readFileSync(process.argv[1]), validator = require(process.argv[2] + "/package");
validator.validateBytes(new Uint8Array(file)).then(r => console.log(JSON.stringify(r.issues)));
"""


@pytest.mark.slow(10)
def test_the_khronos_validator_finds_no_error(tmp_path):
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("no npm here")
    fetched = subprocess.run(["npm", "pack", VALIDATOR], cwd=tmp_path, capture_output=True, text=True, check=False)
    if fetched.returncode:
        pytest.skip("npm cannot fetch anything here")
    subprocess.run(["tar", "xzf", fetched.stdout.split()[-1]], cwd=tmp_path, check=True)
    path = tmp_path / "t.glb"
    path.write_bytes(data())

    def issues(file: Path) -> tuple[int, int]:
        words = ["node", "-e", VALIDATES, str(file), str(tmp_path)]
        found = json.loads(subprocess.run(words, stdout=subprocess.PIPE, check=True).stdout)
        return found["numErrors"], found["numWarnings"]

    assert issues(path) == (0, 0)
    content = bytearray(path.read_bytes())
    at = content.index(b'"max":[') + 7
    content[at : at + 1] = b"9"  # an accessor that does not say what is in it
    path.write_bytes(content)
    assert issues(path)[0] > 0  # it would tell

"""The GLB: what MuJoCo itself makes of its skins is what the file's bones make of it."""

import json
import struct
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.view.cast import Cast
from highfive.hil.view.skin_file import FAR, SKIN, skin_file
from highfive.model.geometry import rotations

WORST_MM = {"avatar": 1.5, "person": 5.0}
"""Weights of 8 bits; of the person, whose bodies are strewn about here, they are tenths of a body's way."""
KINDS = {5126: np.float32, 5121: np.uint8, 5123: np.uint16, 5125: np.uint32}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@cache
def seen() -> Scene:
    return build_scene(visible=True)


class Glb:
    """A glTF file, read by the letter of its specification."""

    def __init__(self, data: bytes) -> None:
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON" and size % 4 == 0
        self.document: dict[str, Any] = json.loads(data[20 : 20 + size])
        binary, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0" and binary == self.document["buffers"][0]["byteLength"]
        self.binary = data[28 + size :]
        assert len(self.binary) == binary

    def array(self, number: int) -> np.ndarray:
        accessor = self.document["accessors"][number]
        view = self.document["bufferViews"][accessor["bufferView"]]
        kind, width = KINDS[accessor["componentType"]], WIDTHS[accessor["type"]]
        count = accessor["count"] * width
        assert view["byteOffset"] % 4 == 0 and view["byteLength"] == count * np.dtype(kind).itemsize
        found = np.frombuffer(self.binary, kind, count, view["byteOffset"]).reshape(-1, width)
        return found / 255.0 if accessor.get("normalized") else found

    def placed(self, name: str, bones: np.ndarray) -> np.ndarray:
        """(V, 3) of a mesh in the world, its ``bones`` (B, 4, 4) where they are."""
        nodes = self.document["nodes"]
        number = next(i for i, node in enumerate(nodes) if node["name"] == name)
        primitive = self.document["meshes"][nodes[number]["mesh"]]["primitives"][0]
        attributes = {key: self.array(value) for key, value in primitive["attributes"].items()}
        points = np.c_[attributes["POSITION"], np.ones(len(attributes["POSITION"]))]
        if "skin" in nodes[number]:
            inverse = self.array(self.document["skins"][0]["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
            matrices = bones @ inverse
            used = matrices[attributes["JOINTS_0"].astype(int)]
            return np.einsum("vk,vkij,vj->vi", attributes["WEIGHTS_0"], used, points)[:, :3]
        bone = next(i for i, node in enumerate(nodes) if number in node.get("children", []))
        return (points @ bones[bone].T)[:, :3]


def moved(scene: Scene) -> mujoco.MjData:
    data, chance = scene.make_data(), np.random.default_rng(3)
    rest = scene.get_pose(data)
    scene.set_pose(data, Pose(rest.root_in_world, rest.hinges + chance.normal(0.0, 0.15, rest.hinges.shape)))
    data.mocap_pos[:] = chance.normal(0.0, 0.3, data.mocap_pos.shape)
    mujoco.mj_forward(scene.model, data)
    return data


def test_every_vertex_is_where_mujoco_draws_it() -> None:
    scene = seen()
    cast, data = Cast.of(scene.model), moved(scene)
    glb = Glb(skin_file(cast))
    bones = np.tile(np.eye(4), (len(cast.names), 1, 1))
    poses = cast.poses(data)
    bones[:, :3, 3], bones[:, :3, :3] = poses[:, :3], rotations.to_matrix(poses[:, 3:])
    drawn = mujoco.MjvScene(scene.model, maxgeom=500)  # pyright: ignore
    option, camera = mujoco.MjvOption(), mujoco.MjvCamera()  # pyright: ignore
    mujoco.mjv_updateScene(scene.model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, drawn)  # pyright: ignore
    for number in range(scene.model.nskin):
        name, start = scene.model.skin(number).name, int(drawn.skinvertadr[number])
        count = int(drawn.skinvertnum[number])
        theirs = np.array(drawn.skinvert).reshape(-1, 3)[start : start + count]
        ours = glb.placed(SKIN + name, bones)
        off = 1e3 * np.linalg.norm(ours - theirs, axis=1)
        assert off.max() < WORST_MM[name.split("_")[0]] and off.mean() < 1.0, (name, off.max())
        coarse = glb.placed(SKIN + name + FAR, bones)
        assert len(coarse) < 0.8 * len(ours)
        away = np.array([np.linalg.norm(theirs - point, axis=1).min() for point in coarse[::17]])
        assert away.max() < 0.03, name


def test_the_same_model_gives_the_same_bytes_and_indices_that_exist() -> None:
    cast = Cast.of(seen().model)
    data = skin_file(cast)
    assert data == skin_file(cast)
    glb = Glb(data)
    for mesh in glb.document["meshes"]:
        primitive = mesh["primitives"][0]
        count = glb.document["accessors"][primitive["attributes"]["POSITION"]]["count"]
        indices = glb.array(primitive["indices"])
        assert len(indices) % 3 == 0 and indices.max() < count
        normals = glb.array(primitive["attributes"]["NORMAL"])
        assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
        if "WEIGHTS_0" in primitive["attributes"]:
            assert np.allclose(glb.array(primitive["attributes"]["WEIGHTS_0"]).sum(axis=1), 1.0)
    assert len(glb.document["skins"][0]["joints"]) == len(cast.names)


def test_the_description_names_bodies_that_are_there() -> None:
    cast = Cast.of(seen().model)
    found = cast.description()
    assert found["bodies"] == list(cast.names)
    assert all(-1 <= geom["body"] < len(cast.names) for geom in found["geoms"])
    assert {geom["name"] for geom in found["geoms"]} >= {"floor", "avatar_left_eye", "person_left_eye"}
    assert found["palms"]["person"]["body"] == cast.names.index("person_palm")


@pytest.mark.parametrize("owner", ["avatar", "person"])
def test_palms_are_where_the_scene_has_them(owner: str) -> None:
    scene = seen()
    cast, data = Cast.of(scene.model), moved(scene)
    palm = cast.description()["palms"][owner]
    pose = cast.poses(data)[palm["body"]]
    place = pose[:3] + rotations.rotate(pose[3:], palm["position"])
    site = scene.palm_site if owner == "avatar" else scene.person_palm_site
    assert np.allclose(place, data.site_xpos[site], atol=1e-5)

"""Avatar and person as one glTF 2.0 file (GLB), which the page and other programs (Blender) open.

All skins share one skeleton of free bones: a bone is a body, its pose the body's in the world. What hangs on one bone
is a plain mesh under it. The bones lie in one node that turns z up, as here, into y up, as in glTF.
"""

from __future__ import annotations

import copy
import json
import math
import struct
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from highfive.hil.sim.sculpt import BONES
from highfive.hil.view.cast import Cast
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

SKIN = "skin_"
"""Begins the names of the meshes; bones have those of their bodies."""
FAR = "_far"
"""Ends the names of the coarse meshes, for figures that are far or machines that are slow."""
_CELLS = {"hand": 0.011, "head": 0.014, "lids": 0.008, "lips": 0.006, "brows": 0.008, "hair": 0.022, "cuff": 0.02}
_CELL = 0.034
"""m: grids of the coarse meshes, by the end of a skin's name, and of the others."""
_FLAT = 0.03
"""Of the largest curvature: below, a vertex is left where the mean of its cell is."""
FLOAT, _BYTE, SHORT, _INT = 5126, 5121, 5123, 5125
VERTICES, INDICES = 34962, 34963
_Y_UP = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # glTF quaternions are x, y, z, w


class Buffer:
    """The binary part, and the accessors into it."""

    def __init__(self) -> None:
        """Empty."""
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: NDArray[Any], kind: str, component: int, target: int | None, **more: Any) -> int:
        """Puts values (N, …) at the end; the number of their accessor."""
        self.data += b"\0" * (-len(self.data) % 4)
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes}
        if target is not None:
            view["target"] = target
        self.data += values.tobytes()
        self.views.append(view)
        count = len(values)
        self.accessors.append(
            {"bufferView": len(self.views) - 1, "componentType": component, "count": count, "type": kind, **more}
        )
        return len(self.accessors) - 1


def skin_file(cast: Cast) -> bytes:
    """The file; the same model gives the same bytes.

    Args:
        cast: of a model that was built to be seen.
    """
    return container(*skin_document(cast))


def skin_document(cast: Cast, *, coarse: bool = True) -> tuple[dict[str, Any], Buffer]:
    """The file's JSON, still without what the buffer holds, and the buffer; nodes begin with the bones.

    Args:
        cast: of a model that was built to be seen.
        coarse: with the meshes whose names end in :data:`FAR`.
    """
    model, buffer = cast.model, Buffer()
    bones = {int(number): place for place, number in enumerate(cast.ids)}
    bind = np.zeros((len(bones), 7))
    bind[:, 3] = 1.0
    nodes: list[dict[str, Any]] = [{"name": name} for name in cast.names]
    meshes: list[dict[str, Any]] = []
    skinned: list[int] = []
    for number in range(model.nskin):
        skin = _Skin(model, number, bones)
        for bone, place, turn in zip(skin.bones, skin.bind_positions, skin.bind_quaternions, strict=True):
            bind[bone] = [*place, *turn]
        rigid = len(skin.bones) == 1
        surfaces = [(SKIN + skin.name, skin)] + ([(SKIN + skin.name + FAR, skin.clustered())] if coarse else [])
        for name, surface in surfaces:
            meshes.append({"name": name, "primitives": [_primitive(surface, buffer, rigid=rigid)]})
            node: dict[str, Any] = {"name": name, "mesh": len(meshes) - 1}
            nodes.append(node)
            if rigid:
                nodes[skin.bones[0]].setdefault("children", []).append(len(nodes) - 1)
            else:
                node["skin"] = 0
                skinned.append(len(nodes) - 1)
    for bone, pose in enumerate(bind):
        w, x, y, z = pose[3:]
        nodes[bone] |= {"translation": plain(pose[:3]), "rotation": plain(np.array([x, y, z, w]))}
    inverse = np.array([_inverse(pose) for pose in bind])
    matrices = buffer.add(inverse.transpose(0, 2, 1).astype("<f4"), "MAT4", FLOAT, None)
    nodes.append({"name": "high_five", "children": [*range(len(bones)), *skinned], "rotation": list(_Y_UP)})
    document = {
        "asset": {"version": "2.0", "generator": "High Five"},
        "scene": 0,
        "scenes": [{"nodes": [len(nodes) - 1]}],
        "nodes": nodes,
        "meshes": meshes,
        "skins": [{"joints": list(range(len(bones))), "inverseBindMatrices": matrices}],
        "materials": [_material(model, number) for number in range(model.nmat)],
    }
    return document, buffer


class _Skin:
    """A skin of the model with at most four bones a vertex."""

    def __init__(self, model: mujoco.MjModel, number: int, bones: dict[int, int]) -> None:
        self.name, self.material = str(model.skin(number).name), int(model.skin_matid[number])
        start, count = int(model.skin_vertadr[number]), int(model.skin_vertnum[number])
        self.vertices: Array = model.skin_vert[start : start + count].astype(float)
        start, faces = int(model.skin_faceadr[number]), int(model.skin_facenum[number])
        self.faces = model.skin_face[start : start + faces]
        first, some = int(model.skin_boneadr[number]), int(model.skin_bonenum[number])
        chosen = slice(first, first + some)
        self.bones = [bones[int(body)] for body in model.skin_bonebodyid[chosen]]
        self.bind_positions: Array = model.skin_bonebindpos[chosen].astype(float)
        self.bind_quaternions: Array = model.skin_bonebindquat[chosen].astype(float)
        weights = np.zeros((count, some))
        for bone in range(first, first + some):
            at, many = int(model.skin_bonevertadr[bone]), int(model.skin_bonevertnum[bone])
            weights[model.skin_bonevertid[at : at + many], bone - first] = model.skin_bonevertweight[at : at + many]
        self.weights = weights

    def clustered(self) -> _Skin:
        """The same with fewer vertices, one a cell of a grid, where it keeps the surface (Lindstrom 2000)."""
        cell = next((size for end, size in _CELLS.items() if self.name.endswith(end)), _CELL)
        _, which, count = np.unique(np.floor(self.vertices / cell), axis=0, return_inverse=True, return_counts=True)
        which = which.reshape(-1)
        coarse = copy.copy(self)
        mean, coarse.weights = np.zeros((len(count), 3)), np.zeros((len(count), self.weights.shape[1]))
        np.add.at(mean, which, self.vertices)
        np.add.at(coarse.weights, which, self.weights)
        mean /= count[:, None]
        coarse.vertices = mean + np.clip(self._to_the_surface(mean, which), -0.5 * cell, 0.5 * cell)
        faces = which[self.faces]
        whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        coarse.faces = faces[whole]
        return coarse

    def _to_the_surface(self, mean: Array, which: NDArray[np.int64]) -> Array:
        """(C, 3) from the mean of each cell to the point that is nearest to the planes of all faces at its vertices."""
        across = self._across
        squares, along = np.zeros((len(mean), 3, 3)), np.zeros((len(mean), 3))
        for corner in self.faces.T:
            cells = which[corner]
            off = (across * (self.vertices[corner] - mean[cells])).sum(axis=1)
            np.add.at(squares, cells, across[:, :, None] * across[:, None, :])
            np.add.at(along, cells, across * off[:, None])
        sizes, axes = np.linalg.eigh(squares)
        certain = sizes > _FLAT * sizes[:, -1:]
        inverse = np.where(certain, 1.0 / np.where(certain, sizes, 1.0), 0.0)
        return np.einsum("cij,cj,ckj,ck->ci", axes, inverse, axes, along)

    @property
    def _across(self) -> Array:
        """(F, 3) normal of each face, twice its area long."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return np.cross(b - a, c - a)

    @property
    def normals(self) -> Array:
        """(V, 3) unit, of the faces around each vertex by their areas."""
        normals = np.zeros_like(self.vertices)
        for corner in self.faces.T:
            np.add.at(normals, corner, self._across)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.where(lengths > 0.0, normals / np.maximum(lengths, 1e-30), [0.0, 0.0, 1.0])

    def strongest(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """(V, 4) bones and (V, 4) weights that sum to 255."""
        count = min(BONES, len(self.bones))
        order = np.argsort(-self.weights, axis=1, kind="stable")[:, :count]
        weights = np.take_along_axis(self.weights, order, axis=1)
        whole = np.floor(255.0 * weights / weights.sum(axis=1, keepdims=True)).astype(int)
        whole[:, 0] += 255 - whole.sum(axis=1)
        bones = np.array(self.bones)[order]
        bones[whole == 0] = 0
        padding = [(0, 0), (0, BONES - count)]
        return np.pad(bones, padding).astype(np.uint8), np.pad(whole, padding).astype(np.uint8)


def _primitive(skin: _Skin, buffer: Buffer, *, rigid: bool) -> dict[str, Any]:
    vertices, normals = skin.vertices, skin.normals
    if rigid:  # in the frame of its bone
        axes = rotations.to_matrix(skin.bind_quaternions[0])
        vertices, normals = (vertices - skin.bind_positions[0]) @ axes, normals @ axes
    extent = {"min": plain(vertices.astype("<f4").min(axis=0)), "max": plain(vertices.astype("<f4").max(axis=0))}
    attributes = {
        "POSITION": buffer.add(vertices.astype("<f4"), "VEC3", FLOAT, VERTICES, **extent),
        "NORMAL": buffer.add(normals.astype("<f4"), "VEC3", FLOAT, VERTICES),
    }
    if not rigid:
        bones, weights = skin.strongest()
        attributes["JOINTS_0"] = buffer.add(bones, "VEC4", _BYTE, VERTICES)
        attributes["WEIGHTS_0"] = buffer.add(weights, "VEC4", _BYTE, VERTICES, normalized=True)
    few = len(vertices) < 1 << 16
    indices = skin.faces.ravel().astype("<u2" if few else "<u4")
    return {
        "attributes": attributes,
        "indices": buffer.add(indices, "SCALAR", SHORT if few else _INT, INDICES),
        "material": skin.material,
    }


def _material(model: mujoco.MjModel, number: int) -> dict[str, Any]:
    return material(model.mat(number).name, model.mat_rgba[number].astype(float), float(model.mat_specular[number]))


def material(name: str, colour: Array, gloss: float) -> dict[str, Any]:
    """Colours (4,) of glTF are linear, MuJoCo's are as a display has them."""
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    rough = 1.0 - 0.7 * gloss
    return {
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": plain(np.array([*linear[:3], colour[3]])),
            "metallicFactor": 0.0,
            "roughnessFactor": round(rough, 4),
        },
    }


def _inverse(pose: Array) -> Array:
    """(4, 4) from the world into the frame of a pose (7,)."""
    axes = rotations.to_matrix(pose[3:])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes.T, -axes.T @ pose[:3]
    return matrix


def plain(values: NDArray[Any]) -> list[float]:
    """As JSON has them."""
    return [float(value) for value in values]


def container(document: dict[str, Any], buffer: Buffer) -> bytes:
    """The file: a document as :func:`skin_document` gives it, and what its accessors are of."""
    binary = bytes(buffer.data)
    binary += b"\0" * (-len(binary) % 4)
    held = {"buffers": [{"byteLength": len(binary)}], "bufferViews": buffer.views, "accessors": buffer.accessors}
    text = json.dumps({**document, **held}, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

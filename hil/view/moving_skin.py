"""A recorded high five as one animated glTF 2.0 file (GLB): both people with their skins, for Blender and the web.

The skins, bones and materials are the page's (``skin_file.py``); each bone has a track of its place and turn in the
scene. Bones are free of each other, as bodies are in a recording: a tool that wants a hierarchy
of joints is given the BVH file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.hil.recording.exports.export_file import ExportFile, of_bytes
from highfive.hil.recording.exports.trial_arrays import ExportTrial, TrialArrays
from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.view.cast import Cast
from highfive.hil.view.recorded import person_of, placed_bodies
from highfive.hil.view.skin_file import (
    FLOAT,
    INDICES,
    SHORT,
    VERTICES,
    Buffer,
    container,
    material,
    plain,
    skin_document,
)
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

_RINGS, _SPOKES = 8, 12
"""Of the spheres of the eyes."""


def moving_skin(cast: Cast, bodies: Array, times: Array, name: str) -> bytes:
    """The file; the same motion gives the same bytes.

    Args:
        cast: of a model that was built to be seen.
        bodies: (T, B, 7) position, m, and quaternion of each body in the world.
        times: (T,) s, increasing.
        name: of the animation.
    """
    document, buffer = skin_document(cast, coarse=False)
    _stand_at(document, bodies[0])
    _add_eyes(document, buffer, cast)
    _free_skinned(document)
    document["animations"] = [_animation(buffer, bodies, times, name)]
    return container(document, buffer)


def _stand_at(document: dict[str, Any], bodies: Array) -> None:
    """Who does not play the animation sees its first pose."""
    for node, pose in zip(document["nodes"], bodies, strict=False):
        node |= {"translation": plain(pose[:3]), "rotation": plain(pose[[4, 5, 6, 3]])}


def _free_skinned(document: dict[str, Any]) -> None:
    """Skinned meshes go by their bones alone: their nodes lie at the scene's root, as glTF advises."""
    nodes, (root,) = document["nodes"], document["scenes"][0]["nodes"]
    skinned = [place for place, node in enumerate(nodes) if "skin" in node]
    nodes[root]["children"] = [child for child in nodes[root]["children"] if child not in skinned]
    document["scenes"][0]["nodes"] = [root, *skinned]


def _add_eyes(document: dict[str, Any], buffer: Buffer, cast: Cast) -> None:
    """The spheres on the people's bodies, which MuJoCo has as shapes and not as skins."""
    around = _unit_sphere()
    for geom in cast.description()["geoms"]:
        if geom["body"] < 0 or geom["shape"] != "sphere":
            continue
        document["materials"].append(material(geom["name"], np.array(geom["colour"]), geom["gloss"]))
        primitive = _sphere(buffer, *around, geom["size"][0]) | {"material": len(document["materials"]) - 1}
        document["meshes"].append({"name": geom["name"], "primitives": [primitive]})
        document["nodes"].append(
            {"name": geom["name"], "mesh": len(document["meshes"]) - 1, "translation": geom["position"]}
        )
        document["nodes"][geom["body"]].setdefault("children", []).append(len(document["nodes"]) - 1)


def _unit_sphere() -> tuple[Array, NDArray[np.int64]]:
    """Vertices (V, 3), which are their own normals, and triangles (F, 3), of a unit sphere by rings and spokes."""
    polar = np.linspace(0.0, np.pi, _RINGS + 1)[:, None]
    turn = np.linspace(0.0, 2.0 * np.pi, _SPOKES, endpoint=False)
    ones = np.ones_like(turn)
    vertices = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) * ones], axis=-1)
    here = np.arange(_RINGS)[:, None] * _SPOKES + np.arange(_SPOKES)
    beside = np.arange(_RINGS)[:, None] * _SPOKES + (np.arange(_SPOKES) + 1) % _SPOKES
    below, across = here + _SPOKES, beside + _SPOKES
    upper, lower = np.stack([here, below, across], axis=-1)[:-1], np.stack([here, across, beside], axis=-1)[1:]
    return vertices.reshape(-1, 3), np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)])


def _sphere(buffer: Buffer, vertices: Array, faces: NDArray[np.int64], radius: float) -> dict[str, Any]:
    places = (radius * vertices).astype("<f4")
    extent = {"min": plain(places.min(axis=0)), "max": plain(places.max(axis=0))}
    attributes = {
        "POSITION": buffer.add(places, "VEC3", FLOAT, VERTICES, **extent),
        "NORMAL": buffer.add(vertices.astype("<f4"), "VEC3", FLOAT, VERTICES),
    }
    return {"attributes": attributes, "indices": buffer.add(faces.ravel().astype("<u2"), "SCALAR", SHORT, INDICES)}


def _animation(buffer: Buffer, bodies: Array, times: Array, name: str) -> dict[str, Any]:
    """A track of place and one of turn for each bone, all at the same times from 0."""
    seconds = (times - times[0]).astype("<f4")
    at = buffer.add(seconds, "SCALAR", FLOAT, None, min=[float(seconds[0])], max=[float(seconds[-1])])
    turns = _without_jumps(bodies[..., 3:])[..., [1, 2, 3, 0]]
    samplers, channels = [], []
    for bone in range(bodies.shape[1]):
        for path, kind, values in (("translation", "VEC3", bodies[:, bone, :3]), ("rotation", "VEC4", turns[:, bone])):
            output = buffer.add(np.ascontiguousarray(values).astype("<f4"), kind, FLOAT, None)
            samplers.append({"input": at, "output": output, "interpolation": "LINEAR"})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": bone, "path": path}})
    return {"name": name, "samplers": samplers, "channels": channels}


def _without_jumps(quaternions: Array) -> Array:
    """The same rotations (T, B, 4) of unit length, each with the sign that is nearer to the one before."""
    flips = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=-1) < 0.0, -1.0, 1.0)
    signs = np.concatenate([np.ones_like(flips[:1]), np.cumprod(flips, axis=0)])
    return quaternions * (signs / np.linalg.norm(quaternions, axis=-1))[..., None]


def glb_files(trials: Sequence[ExportTrial], names: Sequence[str]) -> list[ExportFile]:
    """Both people, a file a high five; the scene is built when the first is written."""
    scene = cache(partial(build_scene, visible=True))
    return [
        of_bytes(name, partial(_glb, scene, trial, name), trial.span.ticks)
        for trial, name in zip(trials, names, strict=True)
    ]


def _glb(scene: Callable[[], Scene], of: ExportTrial, name: str) -> bytes:
    trial = of.load()
    if len(trial) < 2:
        raise HighFiveError(f"{name}: a high five of one tick does not move; two or more are needed")
    poses = [Pose.from_quaternions(*pair) for pair in zip(trial.root, trial.quaternions, strict=True)]
    people = [person_of(_said(trial, tick), round(1e9 * float(time))) for tick, time in enumerate(trial.times)]
    bodies, _ = placed_bodies(scene(), poses, people)
    return moving_skin(Cast.of(scene().model), bodies, trial.times, name.removesuffix(".glb"))


def _said(trial: TrialArrays, tick: int) -> dict[str, Any]:
    """The person of a tick, as a ``/person`` message has her."""
    points = {point: values[tick] for point, values in trial.points.items()}
    turned = {"head_orientation": trial.head_orientation[tick], "palm_normal": trial.palm_normal[tick]}
    return {**points, **turned, "valid": trial.valid[tick], "age_ns": 0}

"""Our own simulated person before a camera: pictures of which the truth is known, and where her joints really are."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from PIL import Image as Pillow

from highfive.hil.sim.avatar import Pose, avatar_skeleton, right_palm
from highfive.hil.sim.people.actors import PairTrial, simulate_pair
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.rendering import Image
from highfive.hil.sim.scene import Scene, build_scene
from highfive.mocap_bridge.sources.camera_person import TO_ROOM, looking_up
from highfive.model.geometry.rotations import Array

STANDS_AT = 0.98
"""m, of the person from the avatar."""
TRUTH = (
    "right_shoulder", "right_elbow", "right_wrist", "right_middle_1", "left_shoulder", "head",
)  # fmt: skip
"""Joints of the skeleton, in the order of :data:`highfive.mocap_bridge.sources.camera_settings.JOINTS`."""
EARS_ABOVE_HEAD = 0.07
"""m, of the middle of the ears over the joint."""
AFTERWARDS = 90
"""Frames of 120 Hz that are filmed after contact."""
SEED, CHOICE_SEED = 20, 21
"""Of the people on whom figures are measured, and of those on whom settings are chosen."""
_SENSOR_NOISE = 3.0  # of 255, standard deviation of a pixel


@dataclass(frozen=True)
class FilmCamera:
    """A camera that looks towards the person, from where the avatar stands or behind it.

    Attributes:
        size: width and height, pixels.
        field_of_view: across the picture, °.
        distance: from the person, m.
        height: over the floor, m.
        tilt: by which it looks up, °.
    """

    size: tuple[int, int] = (1280, 720)
    field_of_view: float = 70.0
    distance: float = 2.0
    height: float = 1.25
    tilt: float = 0.0

    @property
    def place(self) -> Array:
        """(3,) m in the world of the pair."""
        return np.array([STANDS_AT - self.distance, 0.0, self.height])

    def seen(self, points: Array) -> Array:
        """Points (..., 3), m, of that world in the camera's axes."""
        return (points - self.place) @ TO_ROOM @ looking_up(self.tilt)


def filmed_pair(emotion: str, cell: str, seed: int = SEED) -> PairTrial:
    """The pair whose person is filmed. She is of the avatar's size, as skins are."""
    rng = np.random.default_rng([seed, list(EMOTIONS).index(emotion), CELLS.index(cell)])
    return simulate_pair(emotion, cell, 0, rng, avatar_skeleton())


def truth(trial: PairTrial, camera: FilmCamera) -> tuple[Array, Array]:
    """Joints (T, 6, 3) and palm (T, 3) of the person at 120 Hz, m, in the camera's axes."""
    person = trial.person
    positions, orientations = person.skeleton.forward_kinematics(person.root_in_world, person.quaternions)
    joints = positions[:, [person.skeleton.index(name) for name in TRUTH]].copy()
    joints[:, -1, 2] += EARS_ABOVE_HEAD
    return camera.seen(joints), camera.seen(right_palm(person.skeleton, positions, orientations)[0])


class Film:
    """Takes pictures of a person, who wears the avatar's body; close it, or use it in ``with``."""

    def __init__(self, camera: FilmCamera) -> None:
        """Opens a drawing context."""
        self.camera = camera
        self._scene = _scene_of_one()
        model = self._scene.model
        width, height = camera.size
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        across = math.tan(0.5 * math.radians(camera.field_of_view))
        model.vis.global_.fovy = math.degrees(2.0 * math.atan(across * height / width))
        self._renderer = mujoco.Renderer(model, height, width)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        self._option = mujoco.MjvOption()
        self._option.geomgroup[3] = 0
        self._option.sitegroup[:] = 0
        self._view = mujoco.MjvCamera()
        self._view.lookat[:] = camera.place + camera.distance * (TO_ROOM @ looking_up(camera.tilt))[:, 2]
        self._view.distance, self._view.azimuth, self._view.elevation = camera.distance, 0.0, camera.tilt
        self._data = self._scene.make_data()

    def pictures(self, trial: PairTrial, step: int, noise: np.random.Generator) -> Iterator[tuple[int, bytes]]:
        """Every ``step``-th frame of 120 Hz as (its number, a JPEG), until shortly after contact."""
        person = trial.person
        hinges = person.skeleton.to_hinges(person.quaternions)
        for frame in range(0, min(len(hinges), trial.contact_frame + AFTERWARDS), step):
            image = self._picture(Pose(person.root_in_world[frame], hinges[frame]))
            grainy = image + noise.normal(0.0, _SENSOR_NOISE, image.shape)
            yield frame, jpeg(np.clip(grainy, 0, 255).astype(np.uint8))

    def _picture(self, pose: Pose) -> Image:
        model, data = self._scene.model, self._data
        self._scene.set_pose(data, pose)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        self._renderer.update_scene(data, self._view, self._option)
        return self._renderer.render()

    def close(self) -> None:
        """Frees the drawing context."""
        self._renderer.close()

    def __enter__(self) -> Film:
        """Self."""
        return self

    def __exit__(self, *_: object) -> None:
        """Frees the drawing context."""
        self.close()


def jpeg(image: Image) -> bytes:
    """A picture as a webcam sends it."""
    buffer = io.BytesIO()
    Pillow.fromarray(image).save(buffer, "JPEG", quality=90)
    return buffer.getvalue()


def _scene_of_one() -> Scene:
    """The scene without its person: the avatar plays her."""
    scene = build_scene(visible=True)
    model = scene.model
    for geom in range(model.ngeom):
        if model.body(model.geom_bodyid[geom]).name.startswith("person"):
            model.geom_rgba[geom, 3] = 0.0
    for skin in range(model.nskin):
        if model.skin(skin).name.startswith("person"):
            model.skin_rgba[skin, 3] = 0.0
    return scene

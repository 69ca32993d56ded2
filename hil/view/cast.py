"""Everything that moves on the page, and where it is in a MuJoCo state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.person import MOCAP_BODIES, PALM_BODY, PALM_TARGET
from highfive.model.geometry.rotations import Array

PERSON = (*(name for name in MOCAP_BODIES if name != PALM_TARGET), PALM_BODY)
SHAPES = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}
_HIDDEN_GROUP = 3


@dataclass(frozen=True)
class Cast:
    """The bodies that a page is shown, in the order of its messages.

    Attributes:
        model: of the scene that they are in.
        names: of the bodies: the avatar's joints, then the person's.
    """

    model: mujoco.MjModel
    names: tuple[str, ...]

    @classmethod
    def of(cls, model: mujoco.MjModel) -> Cast:
        """Avatar and person of a scene's model."""
        return cls(model, (*avatar_skeleton().names, *PERSON))

    @cached_property
    def ids(self) -> NDArray[np.int64]:
        """(B,) of the bodies in the model."""
        return np.array([self.model.body(name).id for name in self.names])

    def poses(self, data: mujoco.MjData) -> Array:
        """(B, 7) position, m, and quaternion in the world, after ``mujoco.mj_kinematics``."""
        return np.concatenate([data.xpos[self.ids], data.xquat[self.ids]], axis=1)

    def description(self) -> dict[str, Any]:
        """Bodies, and the shapes on them and in the room, as the page draws them: m; colours as a display has them."""
        numbers = {int(number): place for place, number in enumerate(self.ids)}
        geoms = drawn_geoms(self.model, numbers)
        palms = {"avatar": self._site("right_palm", numbers), "person": self._site(PALM_BODY, numbers)}
        return {"bodies": list(self.names), "geoms": geoms, "palms": palms}

    def _site(self, name: str, bodies: Mapping[int, int]) -> dict[str, Any]:
        number = self.model.site(name).id
        return {
            "body": bodies[int(self.model.site_bodyid[number])],
            "position": self.model.site_pos[number].round(5).tolist(),
            "quaternion": self.model.site_quat[number].round(6).tolist(),
        }


def drawn_geoms(model: mujoco.MjModel, bodies: Mapping[int, int]) -> list[dict[str, Any]]:
    """The shapes that are seen, of the world and of ``bodies``: ids in the model → numbers on the page."""
    return [
        _geom(model, number, bodies)
        for number in range(model.ngeom)
        if model.geom_group[number] < _HIDDEN_GROUP
        and (model.geom_bodyid[number] == 0 or int(model.geom_bodyid[number]) in bodies)
    ]


def _geom(model: mujoco.MjModel, number: int, bodies: Mapping[int, int]) -> dict[str, Any]:
    material = int(model.geom_matid[number])
    colour = model.geom_rgba[number] if material < 0 else model.mat_rgba[material]
    return {
        "name": model.geom(number).name,
        "shape": SHAPES[mujoco.mjtGeom(int(model.geom_type[number]))],
        "body": bodies.get(int(model.geom_bodyid[number]), -1),
        "size": model.geom_size[number].round(5).tolist(),
        "position": model.geom_pos[number].round(5).tolist(),
        "quaternion": model.geom_quat[number].round(6).tolist(),
        "colour": colour.round(4).tolist(),
        "gloss": 0.0 if material < 0 else round(float(model.mat_specular[material]), 3),
    }

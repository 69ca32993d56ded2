"""The servo arm on the page: where its joints are, and as a ghost where they were wanted."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.sim.arm_body import PREFIX, arm_alone
from highfive.hil.view.cast import drawn_geoms
from highfive.model.geometry.rotations import Array

GHOST = "wanted_"
"""Begins the names of the ghost's bodies."""


class ArmCast:
    """Bodies of the arm, twice: as measured, then as wanted."""

    def __init__(self, arm: str = DEFAULT_ARM) -> None:
        """An arm, by its name or folder, on its column.

        Raises:
            HighFiveError: there is none.
        """
        folder = find_arm(arm)
        self._twin = arm_alone(folder.mount, folder)
        self._data = mujoco.MjData(self._twin.model)

    @cached_property
    def _own(self) -> tuple[str, ...]:
        model = self._twin.model
        return tuple(name for i in range(model.nbody) if (name := model.body(i).name).startswith(PREFIX))

    @property
    def joints(self) -> int:
        """How many."""
        return len(self._twin.qpos)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the bodies, in the order of :meth:`poses`."""
        return (*self._own, *(GHOST + name for name in self._own))

    def poses(self, measured: Array, wanted: Array) -> Array:
        """(2 A, 7) position, m, and quaternion in the world, of joints (J,), rad."""
        return np.concatenate([self._placed(measured), self._placed(wanted)])

    def plate(self, joints: Array) -> Array:
        """(3,) m, of the middle of the plate, of joints (J,), rad."""
        self._placed(joints)
        return self._data.site_xpos[self._twin.plate_site].copy()

    def geoms(self, first: int) -> list[dict[str, Any]]:
        """Shapes, as :meth:`highfive.hil.view.cast.Cast.description` gives them, of bodies numbered from ``first``."""
        model = self._twin.model
        numbers = {int(model.body(name).id): first + place for place, name in enumerate(self._own)}
        own = drawn_geoms(model, numbers)
        ghosts = [
            {**geom, "name": GHOST + geom["name"], "body": geom["body"] + len(self._own), "ghost": True}
            for geom in own
            if geom["body"] >= 0
        ]
        return own + ghosts

    def _placed(self, joints: Array) -> Array:
        data, ids = self._data, [self._twin.model.body(name).id for name in self._own]
        data.qpos[self._twin.qpos] = joints
        mujoco.mj_kinematics(self._twin.model, data)
        return np.concatenate([data.xpos[ids], data.xquat[ids]], axis=1)

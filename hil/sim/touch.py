"""What touches what in the scene, read from MuJoCo's contacts."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from highfive.hil.sim.scene import Scene
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class Touch:
    """Two shapes in contact.

    Attributes:
        first: shape of the avatar, such as ``'right_palm'``.
        second: shape of the person (``'person_…'``), or of the avatar's own body.
        expected: a hand met the person's hand; all else is a finding.
        distance: m, negative where the shapes overlap.
        force: N along the normal; 0 in kinematic play-out.
        position: (3,) m in the world.
        normal: (3,) unit vector in the world from ``first`` to ``second``.
    """

    first: str
    second: str
    expected: bool
    distance: float
    force: float
    position: Array
    normal: Array


class TouchReader:
    """Reads the touches of a state; the most forceful, then deepest, where a pair touches in several points."""

    def __init__(self, scene: Scene) -> None:
        """Looks up the names of the scene's shapes once."""
        self._model = scene.model
        self._names = [scene.model.geom(i).name for i in range(scene.model.ngeom)]
        self._hand = frozenset(scene.hand_geoms.tolist())
        self._person_hand = frozenset(scene.person_hand_geoms.tolist())

    def read(self, data: mujoco.MjData, *, forces: bool) -> list[Touch]:
        """Touches in ``data``, whose collisions have been computed; forces need its constraints solved as well."""
        if data.ncon == 0:
            return []
        deepest: dict[tuple[int, int], Touch] = {}
        force, contact = np.zeros(6), data.contact
        distances, positions, frames = contact.dist.tolist(), contact.pos.copy(), contact.frame.copy()
        for i, geoms in enumerate(contact.geom.tolist()):
            (first, second), normal = geoms, frames[i, :3]
            # MuJoCo orders a pair by type of shape.
            if first in self._person_hand or (second in self._hand and first not in self._hand):
                first, second, normal = second, first, -normal
            if forces:
                mujoco.mj_contactForce(self._model, data, i, force)
            expected = first in self._hand and second in self._person_hand
            names = self._names[first], self._names[second]
            touch = Touch(*names, expected, distances[i], float(force[0]), positions[i], normal)
            known = deepest.get((first, second))
            if known is None or (touch.force, -touch.distance) > (known.force, -known.distance):
                deepest[first, second] = touch
        return list(deepest.values())

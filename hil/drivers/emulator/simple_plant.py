"""A body for emulated servos that needs no physics engine: every joint is an inertia with friction, and no gravity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from highfive.hil.drivers.values import Array


class SimplePlant:
    """Joints that do not know of each other. A :class:`~highfive.hil.drivers.values.Plant`."""

    def __init__(
        self, joints: int, inertia: float | Sequence[float] = 0.05, friction: float | Sequence[float] = 0.1
    ) -> None:
        """All at rest at angle 0; ``inertia`` in kg·m² and ``friction`` in N·m, one for all or one a joint."""
        self._inertia = np.broadcast_to(np.asarray(inertia, dtype=float), joints)
        self._friction = np.broadcast_to(np.asarray(friction, dtype=float), joints)
        self._positions, self._velocities = np.zeros(joints), np.zeros(joints)

    def step(self, torques: Array, seconds: float) -> tuple[Array, Array]:
        """Positions, rad, and velocities, rad/s, ``seconds`` later. Friction stops a joint, and never pushes it."""
        free = self._velocities + torques * (seconds / self._inertia)
        brake = self._friction * (seconds / self._inertia)
        self._velocities = np.sign(free) * np.maximum(0.0, np.abs(free) - brake)
        self._positions = self._positions + self._velocities * seconds
        return self._positions, self._velocities

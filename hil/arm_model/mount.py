"""Where an arm stands."""

from __future__ import annotations

from dataclasses import dataclass

from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class Mount:
    """Where the arm stands.

    Attributes:
        position: (x, y, z) m of the base's underside in the world.
        yaw: rad about the vertical; 0 points the arm to the person (+x).
        tilt: rad, the base pitched forward after the yaw.
        roll: rad, the base rolled about its own x after both.
    """

    position: tuple[float, float, float]
    yaw: float = 0.0
    tilt: float = 0.0
    roll: float = 0.0

    @staticmethod
    def of(position: Array, quaternion: Array) -> Mount:
        """A mount at (3,), m, turned by a quaternion (4,)."""
        yaw, tilt, roll = rotations.to_euler("zyx", quaternion)
        x, y, z = position
        return Mount((float(x), float(y), float(z)), float(yaw), float(tilt), float(roll))

    @property
    def quaternion(self) -> Array:
        """(4,) orientation of the base in the world."""
        yawed = rotations.multiply(rotations.from_axis_angle("z", self.yaw), rotations.from_axis_angle("y", self.tilt))
        return rotations.multiply(yawed, rotations.from_axis_angle("x", self.roll))

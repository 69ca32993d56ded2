"""Postures of an arm and what was seen of the markers on its plate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class ArmPoses:
    """N postures of J joints, and M markers in the motion capture's frame.

    Attributes:
        encoders: (N, J) rad, what the servos said; never what was commanded.
        sides: (N, J) from which side each joint was approached: 1 rising, −1 falling, 0 not known.
        markers: (N, M, 3) m, where they were seen; zero where not.
        seen: (N, M).
    """

    encoders: Array
    sides: Array
    markers: Array
    seen: NDArray[np.bool_]

    def __len__(self) -> int:
        """Number of postures."""
        return len(self.encoders)

    def only(self, chosen: NDArray[np.bool_]) -> ArmPoses:
        """Those chosen (N,)."""
        return ArmPoses(self.encoders[chosen], self.sides[chosen], self.markers[chosen], self.seen[chosen])

"""Where and when the palms will meet, as the online response says it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class ContactForecast:
    """Where and when the palms will meet.

    Attributes:
        point: (3,) m, in the world.
        time: s from now, negative where contact is past.
        covariance: (4, 4) of both: m², m s, s².
    """

    point: Array
    time: float
    covariance: Array

    @property
    def deviation(self) -> float:
        """Standard deviation of the time, s."""
        return float(np.sqrt(self.covariance[3, 3]))

    def later(self, seconds: float) -> ContactForecast:
        """The same forecast, its time counted from some ``seconds`` later."""
        return replace(self, time=self.time - seconds)

"""Where and when the palms will meet, as the online response says it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from highfive.model.compiled import compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.contact_layer import ContactLayer
from highfive.model.linear_algebra import cholesky, cholesky_solve


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


def contact_forecast(
    knuckles: Array, speed: float, left: Array, covariance: Array, layer: ContactLayer
) -> ContactForecast:
    """The forecast for a hand whose ``knuckles`` (3,), m, have ``left`` (4,) way and time, as ``layer`` is calibrated.

    Args:
        knuckles: in the world.
        speed: m/s, of theirs.
        left: m and s.
        covariance: (4, 4), as a layer says it.
        layer: whose calibration says what time and covariance must be.
    """
    return ContactForecast(knuckles + left[:3], *layer.calibrated(float(left[3]), speed, covariance))


@compiled_entry
def believed(beyond: Array, variance: float, covariance: Array) -> Array:
    """``variance`` (``variance`` I + ``covariance``)⁻¹ ``beyond``: what is believed of a forecast (3,), m, of a
    ``covariance`` (3, 3), m², that lies so far beyond an estimate of a ``variance``, m², in each direction."""
    both, part = covariance.copy(), beyond.copy()
    for i in range(3):
        both[i, i] += variance
        part[i] *= variance
    if variance == 0.0 or not cholesky(both, both):
        return np.zeros(3)
    cholesky_solve(both, part)
    return part

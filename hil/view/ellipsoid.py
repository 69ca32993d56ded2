"""How sure a forecast is, as it is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np

from highfive.model.geometry.rotations import Array


def ellipsoid(point: Array, covariance: Array) -> dict[str, Any]:
    """Its centre, and its half axes of one standard deviation, a row each, m."""
    spread, axes = np.linalg.eigh(covariance[:3, :3])
    return {"point": point, "axes": (axes * np.sqrt(np.maximum(spread, 1e-8))).T}

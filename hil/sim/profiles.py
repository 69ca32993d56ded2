"""Smooth movements from 0 to 1."""

from __future__ import annotations

from typing import Any

import numpy as np


def minimum_jerk(fraction: Any) -> Any:
    """Position along a minimum-jerk movement from 0 to 1 (Flash & Hogan 1985, eq. A1); constant outside.

    Args:
        fraction: share of the duration that has passed, a number or an array.
    """
    s = min(max(fraction, 0.0), 1.0) if isinstance(fraction, float) else np.clip(fraction, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)

"""Style weights: a point on the simplex over a model's emotions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

TOLERANCE = 1e-6


def style_weights(weights: str | Mapping[str, float] | ArrayLike, emotions: Sequence[str]) -> Array:
    """Weights (K,) in the order of ``emotions``, from one emotion's name, a mapping of names, or K numbers.

    Raises:
        HighFiveError: an unknown emotion, a weight that is negative or above one, or weights that do not sum to one
            within 1e-6.
    """
    if isinstance(weights, str):
        weights = {weights: 1.0}
    if isinstance(weights, Mapping):
        if unknown := [str(name) for name in weights if name not in emotions]:
            raise HighFiveError(f"the model knows no emotion {', '.join(unknown)}; it knows {', '.join(emotions)}")
        values = np.array([float(weights.get(name, 0.0)) for name in emotions])
    else:
        values = np.asarray(weights, dtype=float)
    if values.shape != (len(emotions),):
        raise HighFiveError(f"style weights of shape {values.shape}; expected one for each of {', '.join(emotions)}")
    if not np.all(np.isfinite(values)):
        raise HighFiveError(f"style weights {_named(values, emotions)}; all have to be finite numbers")
    if np.any(values < 0.0):
        raise HighFiveError(f"style weights {_named(values, emotions)}; none may be negative")
    if np.any(values > 1.0 + TOLERANCE):
        raise HighFiveError(f"style weights {_named(values, emotions)}; none may be above 1, for they must sum to 1")
    if abs(values.sum() - 1.0) > TOLERANCE:
        raise HighFiveError(f"style weights {_named(values, emotions)} sum to {values.sum():.6g}; they must sum to 1")
    return values


def _named(values: Array, emotions: Sequence[str]) -> str:
    """The weights that are not 0 under their names, as they are written."""
    return ",".join(f"{name}={value:g}" for name, value in zip(emotions, values, strict=True) if value != 0.0) or "0"

"""What a source hands over is looked at before it is believed: a plug-in may give anything."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError

_NUMBERS: dict[str, Callable[[np.ndarray], bool]] = {
    "floats": lambda values: values.dtype.kind in "fiu",
    "booleans": lambda values: values.dtype.kind == "b",
}


def check_frame(frame: Any, title: str) -> None:
    """Refuses what is no frame, and arrays that do not fit its names: one marker would stand in another's place.

    Raises:
        HighFiveError: something of it is of another type or shape; the message names the source and says what was
            expected.
    """
    if not isinstance(frame, MarkerFrame):
        raise HighFiveError(f"{title} gives a {type(frame).__name__}; expected a MarkerFrame")
    if not isinstance(frame.names, tuple) or not all(isinstance(name, str) for name in frame.names):
        raise HighFiveError(f"{title} gives names that are not a tuple of strings: {frame.names!r:.60}")
    for name in ("number", "source_time_ns", "latency_ns"):
        value = getattr(frame, name)
        if not isinstance(value, int | np.integer) or isinstance(value, bool):
            raise HighFiveError(f"{title} gives {name} {value!r}; expected a whole number")
    count = len(frame.names)
    _check_array(title, "positions", frame.positions, (count, 3), "floats")
    _check_array(title, "valid", frame.valid, (count,), "booleans")
    if frame.covariance is not None:
        _check_array(title, "covariance", frame.covariance, (count, 3, 3), "floats")
    loose = frame.unlabelled
    _check_array(title, "unlabelled", loose, (len(loose) if np.ndim(loose) else 0, 3), "floats")
    if not np.isfinite(loose).all():
        raise HighFiveError(f"{title} gives unlabelled points with NaN or infinity; leave those points out")


def checked_rate(rate_hz: Any, title: str) -> float:
    """The frames per second that a connection says, 0 where it says none.

    Raises:
        HighFiveError: it is no number, not finite, or negative.
    """
    number = isinstance(rate_hz, int | float | np.number) and not isinstance(rate_hz, bool)
    if not number or not math.isfinite(rate_hz) or rate_hz < 0.0:
        raise HighFiveError(f"{title} gives rate_hz {rate_hz!r}; expected frames per second, 0 if unknown")
    return float(rate_hz)


def _check_array(title: str, name: str, values: Any, shape: tuple[int, ...], what: str) -> None:
    if not isinstance(values, np.ndarray) or not _NUMBERS[what](values):
        kind = values.dtype if isinstance(values, np.ndarray) else type(values).__name__
        raise HighFiveError(f"{title} gives {name} of type {kind}; expected an array of {what} of shape {shape}")
    if values.shape != shape:
        raise HighFiveError(f"{title} gives {name} of shape {values.shape}; expected {shape}")

"""Points by name from text files of other programs: read whole, in the file's own unit and axes, then put into ours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.files.recording import FARTHEST_M, Recording, make_recording
from highfive.mocap_bridge.wire.plausible import spans
from highfive.model.errors import HighFiveError
from highfive.model.files import read_bounded
from highfive.model.geometry.rotations import Array

MAX_BYTES = 1 << 28
"""Largest text file that is read, bytes."""
MOST_LINES = 5_000_000
"""Eleven hours at 120 Hz."""
_LINE_ENDS = "\n\r\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029"
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
"""m a unit."""
PERSON_SPANS = {"m": (0.5, 3.0), "cm": (90.0, 300.0), "mm": (500.0, 3000.0)}
"""A person's points extend so far along some axis, in each unit: the ranges do not meet, nor that of an adult in
inches, 50 to 85."""
UPS = ("y", "z")
_UNEVEN = 0.3
"""Of a frame, by which a time stamp may be off."""
_SPARSE = 10
"""Frames for each one that is there, from which on a file is not believed."""
_RATES = (5.0, 2000.0)


@dataclass(frozen=True)
class NamedPoints:
    """T frames of M points.

    Attributes:
        source: the file's name, for messages.
        rate_hz: frames a second.
        names: M labels.
        points: (T, M, 3) in the file's unit and axes, NaN where missing.
        unit: what the file says, one of :data:`UNITS`; None where it says nothing.
        centres: they are joint centres of a skeleton.
    """

    source: str
    rate_hz: float
    names: tuple[str, ...]
    points: Array
    unit: str | None
    centres: bool = False


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        HighFiveError: it is not there, cannot be read, is empty, too large, or no text.
    """
    try:
        content = read_bounded(path, MAX_BYTES)
    except OSError as error:
        raise HighFiveError(f"cannot read {path}: {error.strerror}") from None
    if not content.strip():
        raise HighFiveError(f"{path.name} is empty")
    if b"\0" in content:
        raise HighFiveError(f"{path.name} is no text; BVH, TRC and CSV are text files")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    if sum(map(text.count, _LINE_ENDS)) > MOST_LINES:
        raise HighFiveError(f"{path.name} has more than {MOST_LINES} lines; cut it into trials")
    return text


def number(text: str, what: str) -> float:
    """A finite number, or NaN where the text is empty or says that none was measured.

    Raises:
        HighFiveError: the text is neither; ``what`` says where it stands.
    """
    if text.strip().lower() in ("", "na", "n/a", "null", "none", "-"):
        return np.nan
    try:
        value = float(text)
    except ValueError:
        raise HighFiveError(f"{what}: {text.strip()[:40]!r} is no number") from None
    return value if np.isfinite(value) else np.nan


def frames_of(times: Array, source: str) -> tuple[float, NDArray[np.int64]]:
    """Rate, Hz, and the number (T,) of each frame from 0, of stamps (T,), s; numbers that are left out are lost frames.

    Raises:
        HighFiveError: the stamps are missing, do not go on, or belong to no rate.
    """
    if len(times) < 2:
        raise HighFiveError(f"{source} holds {len(times)} frames; two or more are needed")
    steps = np.diff(times)
    if not (steps > 0.0).all():
        at = int(np.flatnonzero(~(steps > 0.0))[0]) + 1
        raise HighFiveError(f"{source}: the time of frame {at} ({times[at]:g} s) does not come after the one before")
    period = float(np.median(steps))
    if not _RATES[0] <= 1.0 / period <= _RATES[1]:
        raise HighFiveError(
            f"{source}: times go on by {period:g}, which would be {1.0 / period:g} Hz; expected seconds, "
            f"{_RATES[0]:g} to {_RATES[1]:g} Hz"
        )
    period = float(steps[steps < 1.5 * period].mean())  # of frames that follow each other: jitter evens out
    longest = int(np.argmax(steps))
    if steps[longest] > _SPARSE * len(times) * period:  # a quotient of more may have no room
        raise _uneven(source, steps, longest, period)
    ahead = np.maximum(np.rint(steps / period), 1.0)
    off = np.abs(steps / period - ahead)
    if off.max() > _UNEVEN or ahead.sum() > _SPARSE * len(times):
        raise _uneven(source, steps, int(np.argmax(off)), period)
    frames = np.concatenate([[0], np.cumsum(ahead)]).astype(np.int64)
    return round(float(frames[-1] / (times[-1] - times[0])), 3), frames


def at_frames(points: Array, frames: NDArray[np.int64]) -> Array:
    """Points (T, M, 3) at their frames (T,); lost frames are missing."""
    spread = np.full((int(frames[-1]) + 1, *points.shape[1:]), np.nan)
    spread[frames] = points
    return spread


def in_world(found: NamedPoints, metres: float, up: str) -> Recording:
    """Metres, z up, right-handed.

    Args:
        found: as read.
        metres: of one unit of the file.
        up: one of :data:`UPS`, the file's vertical; y goes to z, z to −y, x stays.

    Raises:
        HighFiveError: not one point is there.
    """
    with np.errstate(over="ignore"):
        points = metres * found.points
    points = np.where(np.abs(points) <= FARTHEST_M, points, np.nan)
    if up == "y":
        points = np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)
    valid = np.asarray(np.isfinite(points).all(axis=-1))
    if not valid.any():
        raise HighFiveError(f"{found.source} has labels, but not one measured point; check the export")
    return replace(make_recording(found.rate_hz, found.names, points, valid), source=found.source)


def people_of(found: NamedPoints) -> list[list[int]]:
    """Columns of each person: labels with the same word before the colon."""
    prefixes = [name.rpartition(":")[0] for name in found.names]
    return [[m for m, own in enumerate(prefixes) if own == prefix] for prefix in dict.fromkeys(prefixes)]


def unit_by_size(found: NamedPoints) -> str | None:
    """The unit in which each person of the file is as large as people are; None where that is in doubt."""
    units: set[str | None] = set()
    for columns in people_of(found):
        points = found.points[:, columns]
        valid = np.asarray(np.isfinite(points).all(axis=-1))
        extents = spans(np.where(valid[..., None], points, 0.0), valid)
        extents = extents[np.isfinite(extents)]
        if len(extents):
            units.add(_unit_of_size(float(np.median(extents))))
    return units.pop() if len(units) == 1 else None


def _unit_of_size(extent: float) -> str | None:
    return next((unit for unit, (least, most) in PERSON_SPANS.items() if least <= extent <= most), None)


def unique(names: Sequence[str], source: str) -> tuple[str, ...]:
    """The names.

    Raises:
        HighFiveError: one is there twice, or empty.
    """
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice or "" in names:
        which = f"{', '.join(twice[:3])} there twice" if twice else "a point without a name"
        raise HighFiveError(
            f"{source} has {which}; name each point, and two people's by a prefix each (human:, avatar:)"
        )
    return tuple(names)


def _uneven(source: str, steps: Array, before: int, period: float) -> HighFiveError:
    return HighFiveError(
        f"{source}: times are uneven (a step of {steps[before]:g} s before frame {before + 1}, {period:g} s is usual); "
        "resample them to one rate"
    )

"""A recorded stretch of labelled markers, of one person or several."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

FARTHEST_M = 1e6
"""A coordinate beyond is none that was measured, m, and in mm it would not fit into a C3D file."""


@dataclass(frozen=True)
class Recording:
    """T frames of M labelled markers, and points without a label.

    Attributes:
        rate_hz: frames per second.
        names: M labels; a person's name stands before a colon (``'human:RSHO'``) unless :meth:`person` took it off.
        points: (T, M, 3) m, finite; zero where not ``valid``.
        valid: (T, M) bool, the marker was seen.
        unlabelled: (T, U, 3) m, points without a label, finite; zero where not ``unlabelled_valid``.
        unlabelled_valid: (T, U) bool.
        source: where it came from, for messages.
    """

    rate_hz: float
    names: tuple[str, ...]
    points: Array
    valid: NDArray[np.bool_]
    unlabelled: Array
    unlabelled_valid: NDArray[np.bool_]
    source: str = "recording"

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.points)

    @property
    def prefixes(self) -> tuple[str, ...]:
        """Names of the persons (what stands before the colon), in the order of the file; ``''`` where there is none."""
        return tuple(dict.fromkeys(name.rpartition(":")[0] for name in self.names))

    def person(self, prefix: str | None = None) -> Recording:
        """The markers of one person, the prefix taken off; unlabelled points stay with everyone.

        Args:
            prefix: name of the person, with or without the colon. None takes the only one there is.

        Raises:
            HighFiveError: there is no such person, or more than one to choose from.
        """
        columns = columns_of_person(self.names, prefix, self.source)
        names = tuple(self.names[m].rpartition(":")[2] for m in columns)
        return replace(self, names=names, points=self.points[:, columns], valid=self.valid[:, columns])

    def frame(self, index: int, number: int, rate_hz: float, start_ns: int = 0) -> MarkerFrame:
        """Frame ``index`` as number ``number`` of a source with ``rate_hz`` that began at ``start_ns``."""
        time_ns = round(number * 1e9 / rate_hz)
        return MarkerFrame(
            names=self.names,
            positions=self.points[index],
            valid=self.valid[index],
            number=number,
            source_time_ns=time_ns,
            arrival_time_ns=start_ns + time_ns,
            unlabelled=self.unlabelled[index, self.unlabelled_valid[index]],
        )


EVERYBODY = "*"
"""In place of a person's prefix: all that the system labels, such as a plate beside the people in the room."""


class SeveralPersons(HighFiveError):
    """There are several persons, and nobody said which one is meant: waiting does not help."""


def prefixes_listed(prefixes: Iterable[str]) -> str:
    """Whose labels there are, for people; '' for nobody's."""
    return ", ".join(prefix or "(labels without a prefix)" for prefix in prefixes)


def columns_of_person(names: Sequence[str], prefix: str | None, source: str, beside: Collection[str] = ()) -> list[int]:
    """Columns of the labels ``names`` that are one person's; see :meth:`Recording.person`.

    A subject with no other labels than those in ``beside``, such as the plate of an arm, is no person.

    Raises:
        SeveralPersons: there is more than one to choose from.
        HighFiveError: there is no such person, or none at all.
    """
    own = {name.rpartition(":")[0] for name in names if name.rpartition(":")[2] not in beside}
    prefixes = tuple(one for one in dict.fromkeys(name.rpartition(":")[0] for name in names) if one in own)
    known = prefixes_listed(prefixes) or "(no labels)"
    if prefix is None:
        if not prefixes:
            raise HighFiveError(f"{source} has no labels; label the markers of a person there")
        if len(prefixes) != 1:
            raise SeveralPersons(
                f"{source} holds several persons: {known}; say which one (--person, in a session --human)"
            )
        prefix = prefixes[0]
    if prefix == EVERYBODY:
        return list(range(len(names)))
    prefix = prefix.removesuffix(":")
    columns = [m for m, name in enumerate(names) if name.rpartition(":")[0] == prefix]
    if not columns:
        raise HighFiveError(f"{source} has no labels of {prefix!r}; the persons in it are: {known}")
    return columns


def labels_without_prefix(names: Sequence[str]) -> tuple[str, ...]:
    """Labels without their prefix; those that two persons have keep it."""
    bare = [name.rpartition(":")[2] for name in names]
    return tuple(name if bare.count(short) > 1 else short for name, short in zip(names, bare, strict=True))


def make_recording(rate_hz: float, names: Sequence[str], points: Array, valid: NDArray[np.bool_]) -> Recording:
    """A recording of labelled points (T, M, 3), m, seen where ``valid`` (T, M), without unlabelled points."""
    seen = valid & np.all(np.isfinite(points), axis=-1)
    none = np.zeros((len(points), 0, 3))
    return Recording(
        rate_hz,
        tuple(names),
        np.where(seen[..., None], points, 0.0),
        seen,
        none,
        np.zeros((len(points), 0), dtype=bool),
    )


def resample(recording: Recording, rate_hz: float) -> Recording:
    """The recording at another rate, by cubic Hermite splines inside runs of seen frames; gaps stay gaps.

    Linear interpolation would be 0.6 mm off between frames of a 100 Hz recording at the 50 m/s² of a fast arm.
    Unlabelled points, which have no identity from frame to frame, come from the nearest frame.
    """
    if abs(recording.rate_hz - rate_hz) < 1e-3 * rate_hz:
        return recording
    count = int(np.floor((len(recording) - 1) * rate_hz / recording.rate_hz + 1e-9)) + 1
    at = np.arange(count) * recording.rate_hz / rate_hz
    last = len(recording) - 1
    left = np.minimum(at.astype(int), max(last - 1, 0))
    right, u = np.minimum(left + 1, last), (at - left)[:, None, None]
    slopes = _slopes(recording.points, recording.valid)
    p0, p1, m0, m1 = recording.points[left], recording.points[right], slopes[left], slopes[right]
    points = (
        (2 * u**3 - 3 * u**2 + 1) * p0 + (u**3 - 2 * u**2 + u) * m0 + (3 * u**2 - 2 * u**3) * p1 + (u**3 - u**2) * m1
    )
    exact = u[..., 0] < 1e-9  # a frame that lies on a recorded one needs no neighbour
    valid = recording.valid[left] & (recording.valid[right] | exact)
    nearest = np.minimum(np.rint(at).astype(int), last)
    return replace(
        recording,
        rate_hz=float(rate_hz),
        points=np.where(valid[..., None], points, 0.0),
        valid=valid,
        unlabelled=recording.unlabelled[nearest],
        unlabelled_valid=recording.unlabelled_valid[nearest],
    )


def _slopes(points: Array, valid: NDArray[np.bool_]) -> Array:
    """Slopes a frame (T, M, 3): central differences, one-sided at the ends of a run of seen frames."""
    forward = np.zeros_like(points)
    forward[:-1] = points[1:] - points[:-1]
    usable = np.zeros_like(valid)
    usable[:-1] = valid[1:] & valid[:-1]
    forward *= usable[..., None]
    backward, usable_back = np.roll(forward, 1, axis=0), np.roll(usable, 1, axis=0)
    count = usable.astype(float) + usable_back
    return (forward + backward) / np.maximum(count, 1.0)[..., None]


def check_scale(recording: Recording, unit: str) -> None:
    """Refuses a recording whose bodies are a thousand times too large or too small.

    Raises:
        HighFiveError: the labelled points span less than 2 cm or more than 30 m.
    """
    seen = recording.valid[..., None]
    low = np.where(seen, recording.points, np.inf).min(axis=1, initial=np.inf)
    high = np.where(seen, recording.points, -np.inf).max(axis=1, initial=-np.inf)
    enough = recording.valid.sum(axis=1) >= 2
    if not enough.any():
        return
    span = float(np.median(np.linalg.norm(high[enough] - low[enough], axis=-1)))
    if not 0.02 <= span <= 30.0:
        really = "millimetres" if span > 30.0 else "metres"
        raise HighFiveError(
            f"the markers of {recording.source} span {span:.3g} m, a person spans about 2 m: the unit is given "
            f"as {unit!r} but the numbers look like {really}; correct POINT:UNITS"
        )

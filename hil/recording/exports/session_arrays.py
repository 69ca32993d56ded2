"""A recording as arrays, checked: what every export is made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.hil.recording.recording import SessionRecording
from highfive.hil.recording.trial_spans import TrialSpan, trial_spans
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

POINTS = ("head", "shoulder", "elbow", "wrist", "knuckles", "palm")
"""Of the person, as the session saw them."""
NEVER_S = 1e6
"""An age beyond which a marker was never seen."""
_UNIT = 0.01
"""How far a rotation's length may be from 1: recordings are rounded."""
_TIED = ("times", "trials", "phases", "palm_normal", "head_orientation", "valid", "age", "root", "quaternions",
         "positions", "orientations", "markers", "seen")  # fmt: skip


@dataclass(frozen=True)
class SessionArrays:
    """T ticks in which both person and avatar were recorded.

    Attributes:
        times: (T,) s of the recording.
        trials: (T,) number of the high five.
        phases: (T,) what the avatar was about, such as ``reach``; '' where that was not recorded.
        points: the person's :data:`POINTS`, each (T, 3) m.
        palm_normal: (T, 3) unit, out of the person's palm.
        head_orientation: (T, 4) of the person's head.
        valid: (T,) all of the person rests on usable markers.
        age: (T,) s, of the oldest marker that the hand rests on; NaN where none was ever seen.
        root: (T, 3) m, the avatar's pelvis.
        quaternions: (T, 53, 4), joints relative to their parents.
        positions, orientations: (T, 53, 3) m and (T, 53, 4) of the joints in the world.
        names: of M markers of the person, as they were tracked; none in recordings of before 0.2.0.
        markers: (T, M, 3) m.
        seen: (T, M) measured in that tick.
        spans: the high fives, in order.
        rows: for each of them its ticks.
        complete: the recording has its end.
    """

    times: Array
    trials: NDArray[np.int64]
    phases: NDArray[np.str_]
    points: Mapping[str, Array]
    palm_normal: Array
    head_orientation: Array
    valid: NDArray[np.bool_]
    age: Array
    root: Array
    quaternions: Array
    positions: Array
    orientations: Array
    names: tuple[str, ...]
    markers: Array
    seen: NDArray[np.bool_]
    spans: tuple[TrialSpan, ...]
    rows: tuple[slice, ...]
    complete: bool

    def __len__(self) -> int:
        """Number of ticks, T."""
        return len(self.times)

    def trial(self, place: int) -> SessionArrays:
        """One high five by itself, by its place among them; times stay those of the recording."""
        rows = self.rows[place]
        return replace(
            self,
            **{name: getattr(self, name)[rows] for name in _TIED},
            points={name: values[rows] for name, values in self.points.items()},
            spans=(self.spans[place],),
            rows=(slice(0, rows.stop - rows.start),),
        )

    def place_of(self, number: int) -> int:
        """The place of the high five with a number; of several, which were broken off, the last.

        Raises:
            HighFiveError: there is none.
        """
        numbers = [span.number for span in self.spans]
        if number not in numbers:
            known = ", ".join(map(str, numbers))
            raise HighFiveError(f"no high five {number} in the recording; it holds {known}; --trial takes one of these")
        return len(numbers) - 1 - numbers[::-1].index(number)


def session_arrays(recording: SessionRecording, name: str) -> SessionArrays:
    """The arrays of a recording, as far as it goes.

    Args:
        recording: as read.
        name: of its file, for messages.

    Raises:
        HighFiveError: it is of another avatar or version, or holds no tick of person and avatar.
    """
    skeleton = avatar_skeleton()
    if recording.joints != tuple(skeleton.names):
        raise HighFiveError(
            f"{name} is the recording of another avatar: {len(recording.joints)} joints, this one has "
            f"{len(skeleton.names)}; export it with the version that recorded it"
        )
    both = _in_both(recording)
    if not both:
        cut = "" if recording.complete else "; it is cut short"
        raise HighFiveError(f"{name} holds no high five: no ticks of avatar and person in it{cut}")
    reader = _Reader(recording, name, both)
    root, quaternions = reader.numbers("/avatar", "root", 3), reader.rotations("/avatar", "quaternions", 53, 4)
    positions, orientations = skeleton.forward_kinematics(root, quaternions)
    age = 1e-9 * reader.numbers("/person", "age_ns")
    names, markers, seen = reader.markers()
    spans, trials = trial_spans(recording), reader.whole("/tick", "trial")
    times = 1e-9 * np.array(both, dtype=float)
    kept = [(span, rows) for span in spans if (rows := _rows(both, span)).stop > rows.start]
    return SessionArrays(
        times=times,
        trials=trials,
        phases=reader.texts("/tick", "phase"),
        points={point: reader.numbers("/person", point, 3) for point in POINTS},
        palm_normal=reader.numbers("/person", "palm_normal", 3),
        head_orientation=reader.rotations("/person", "head_orientation", 4),
        valid=reader.flags("/person", "valid"),
        age=np.where(age < NEVER_S, age, np.nan),
        root=root,
        quaternions=quaternions,
        positions=positions,
        orientations=orientations,
        names=names,
        markers=markers,
        seen=seen,
        spans=tuple(span for span, _ in kept),
        rows=tuple(rows for _, rows in kept),
        complete=recording.complete,
    )


def _in_both(recording: SessionRecording) -> list[int]:
    """Times, ns, at which person, avatar and tick were recorded."""
    person, avatar = ({m.time_ns for m in recording.channels[topic]} for topic in ("/person", "/avatar"))
    return sorted({m.time_ns for m in recording.channels["/tick"]} & person & avatar)


def _rows(both: list[int], span: TrialSpan) -> slice:
    return slice(int(np.searchsorted(both, span.start_ns)), int(np.searchsorted(both, span.end_ns, side="right")))


class _Reader:
    """Fields of the messages at some times, checked: a recording is a file, and may hold anything."""

    def __init__(self, recording: SessionRecording, name: str, times: list[int]) -> None:
        self._name, self._times = name, times
        self._rows = {
            topic: {message.time_ns: message.data for message in recording.channels[topic]}
            for topic in ("/person", "/avatar", "/tick", "/markers")
        }

    def numbers(self, topic: str, field: str, *shape: int) -> Array:
        """(T, …) finite."""
        try:
            values = np.array(self._values(topic, field), dtype=float)
        except (TypeError, ValueError):
            raise self._wrong(topic, f"{field} is not made of numbers, or of different numbers of them") from None
        if values.shape[1:] != shape:
            raise self._wrong(topic, f"{field} has the shape {values.shape[1:]}, expected {shape}")
        if not np.isfinite(values).all():
            raise self._wrong(topic, f"{field} has a number that is not finite")
        return values

    def rotations(self, topic: str, field: str, *shape: int) -> Array:
        """Unit quaternions (T, …)."""
        values = self.numbers(topic, field, *shape)
        lengths = np.linalg.norm(values, axis=-1, keepdims=True)
        if (np.abs(lengths - 1.0) > _UNIT).any():
            raise self._wrong(topic, f"{field} is no rotation: its length is not 1")
        return values / lengths

    def whole(self, topic: str, field: str) -> NDArray[np.int64]:
        values = self._values(topic, field)
        if not all(isinstance(value, int) for value in values):
            raise self._wrong(topic, f"{field} is no whole number")
        return np.array(values, dtype=np.int64)

    def flags(self, topic: str, field: str) -> NDArray[np.bool_]:
        return np.array([value is True for value in self._values(topic, field)])

    def texts(self, topic: str, field: str) -> NDArray[np.str_]:
        return np.array([str(value or "") for value in self._values(topic, field)])

    def markers(self) -> tuple[tuple[str, ...], Array, NDArray[np.bool_]]:
        """Names, (T, M, 3) and (T, M); a tick without a message saw none."""
        rows = self._rows["/markers"]
        first = next(iter(rows.values()), {"names": []})
        names = first.get("names") if isinstance(first, dict) else None
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise self._wrong("/markers", "names is no list of texts")
        points, seen = np.zeros((len(self._times), len(names), 3)), np.zeros((len(self._times), len(names)), dtype=bool)
        try:
            for i, time in enumerate(self._times):
                if (row := rows.get(time)) is not None:
                    if row["names"] != names:
                        raise self._wrong("/markers", "the names change within the recording")
                    points[i], seen[i] = row["positions"], row["seen"]
        except (KeyError, TypeError, ValueError):
            raise self._wrong("/markers", "positions and seen do not fit the names") from None
        seen &= np.isfinite(points).all(axis=-1)
        return tuple(names), np.where(seen[..., None], points, 0.0), seen

    def _values(self, topic: str, field: str) -> list[Any]:
        try:
            return [self._rows[topic][time][field] for time in self._times]
        except (KeyError, TypeError):
            raise self._wrong(topic, f"{field} is missing") from None

    def _wrong(self, topic: str, what: str) -> HighFiveError:
        return HighFiveError(f"{self._name} is a recording of another version: {topic}: {what}")

"""A recorded high five as arrays, checked: what every export is made from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.hil.recording.exports.arm_arrays import ArmArrays, arm_arrays
from highfive.hil.recording.session_reader import RecordedHighFive, SessionReader
from highfive.hil.recording.trial_spans import TrialSpan
from highfive.hil.sim.avatar import avatar_skeleton, right_palm
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

POINTS = ("head", "shoulder", "elbow", "wrist", "knuckles", "palm")
"""Of the person, as the session saw them."""
NEVER_S = 1e6
"""An age beyond which a marker was never seen."""
TOPICS = ("/trial", "/person", "/avatar", "/tick", "/markers", "/event")
_UNIT = 0.01
"""How far a rotation's length may be from 1: recordings are rounded."""


@dataclass(frozen=True)
class TrialArrays:
    """T ticks of a high five in which both person and avatar were recorded.

    Attributes:
        span: the high five.
        times: (T,) s of the recording.
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
        changes: s of the recording, and the style, at which somebody changed the answer while it went on.
    """

    span: TrialSpan
    times: Array
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
    changes: tuple[tuple[float, str], ...] = ()

    def __len__(self) -> int:
        """Number of ticks, T."""
        return len(self.times)

    @property
    def avatar_palm(self) -> Array:
        """(T, 3) m, the middle of the avatar's right palm in the world."""
        return right_palm(avatar_skeleton(), self.positions, self.orientations)[0]


@dataclass(frozen=True)
class ExportTrial:
    """A high five that is to be exported: its arrays are read when they are asked for, for an hour has no room."""

    span: TrialSpan
    load: Callable[[], TrialArrays]
    load_arm: Callable[[], ArmArrays | None]
    """Of the servo arm; None where none took part."""


def export_trials(session: SessionReader) -> list[ExportTrial]:
    """The high fives of a recording that have ticks, in order, as far as it goes; the last one read is kept.

    Raises:
        HighFiveError: it is of another avatar, or holds no tick of person and avatar.
    """
    name, joints = session.path.name, len(avatar_skeleton().names)
    if session.joints != tuple(avatar_skeleton().names):
        raise HighFiveError(
            f"{name} is the recording of another avatar: {len(session.joints)} joints, this one has {joints}; export "
            "it with the version that recorded it"
        )
    load = lru_cache(maxsize=1)(lambda place: trial_arrays(session.read(session.spans[place], TOPICS), name))
    trials = [
        ExportTrial(span, partial(load, place), partial(arm_arrays, session, place))
        for place, span in enumerate(session.spans)
        if span.ticks
    ]
    if not trials:
        cut = "" if session.complete else "; it is cut short"
        spans = session.spans
        what = f"no high five that can be exported: {spans[0].lacking}" if spans else "no high five"
        raise HighFiveError(f"{name} holds {what}{cut}")
    return trials


def trial_arrays(high_five: RecordedHighFive, name: str) -> TrialArrays:
    """The arrays of a high five.

    Args:
        high_five: with :data:`TOPICS`.
        name: of the recording, for messages.

    Raises:
        HighFiveError: it is of another version.
    """
    both = _in_both(high_five)
    if not both:
        raise HighFiveError(
            f"{name}: high five {high_five.number + 1} has no ticks of avatar and person that can be read; leave it "
            "out (--trial takes another one)"
        )
    reader = _Reader(high_five, name, both)
    root, quaternions = reader.numbers("/avatar", "root", 3), reader.rotations("/avatar", "quaternions", 53, 4)
    positions, orientations = avatar_skeleton().forward_kinematics(root, quaternions)
    age = 1e-9 * reader.numbers("/person", "age_ns")
    names, markers, seen = reader.markers()
    return TrialArrays(
        span=high_five.span,
        times=1e-9 * np.array(both, dtype=float),
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
        changes=tuple(
            (1e-9 * event.time_ns, str(event.data.get("style", "")))
            for event in high_five.of("/event")
            if event.data.get("event") == "answer_changed"
        ),
    )


def _in_both(high_five: RecordedHighFive) -> list[int]:
    """Times, ns, at which person, avatar and tick were recorded."""
    tick, person, avatar = (
        {message.time_ns for message in high_five.of(topic)} for topic in ("/tick", "/person", "/avatar")
    )
    return sorted(tick & person & avatar)


class _Reader:
    """Fields of the messages at some times, checked: a recording is a file, and may hold anything."""

    def __init__(self, high_five: RecordedHighFive, name: str, times: list[int]) -> None:
        self._name, self._times = name, times
        self._rows = {
            topic: {message.time_ns: message.data for message in high_five.of(topic)}
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
        lengths = np.linalg.norm(values.clip(-2.0, 2.0), axis=-1, keepdims=True)  # squares of more may have no room
        if (np.abs(lengths - 1.0) > _UNIT).any():
            raise self._wrong(topic, f"{field} is no rotation: its length is not 1")
        return values / lengths

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
                        raise self._wrong("/markers", "the names change within the high five")
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

"""What the high fives of a recorded session ask of a servo arm. A recording is a file: every value is checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.arm.planner_values import ExpectedContact, PalmGoal
from highfive.hil.recording.recording import RecordedMessage
from highfive.hil.recording.session_reader import SessionReader
from highfive.hil.recording.trial_spans import TrialSpan
from highfive.hil.session.session import RATE_HZ
from highfive.hil.sim.avatar import Pose, avatar_skeleton, right_palm
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

T = TypeVar("T")

_TOPICS = ("/person", "/avatar", "/trial", "/contact")

LEAD_TIME = 0.9
"""s before contact from which on the arm knows of it: a recording knows, but nobody lifts a hand earlier."""
TOGETHER = 0.06
"""s for which palms stay together."""
SURE = 0.002
"""m, deviation of a place that is known."""
FURTHEST = 5.0
"""m from the scene's origin: people who meet the arm, and their palms, are nearer."""
UNIT = 0.01
"""How far a direction's or a rotation's length may be from 1: recordings are rounded."""


class RecordedHighFives(Mapping[int, ReferenceTrajectory]):
    """What each high five of a recording asks of the arm, by the trial's number; those without contact are left out.

    The recording knows when and where palms met, so that the arm learns of it :data:`LEAD_TIME` s before. All are read
    once and checked, and each once more when it is asked for: an hour of them has no room.

    Attributes:
        ticks: of each.
    """

    def __init__(self, session: SessionReader) -> None:
        """Of a recording.

        Raises:
            HighFiveError: it is of another avatar, no palms met in it, or a value in it cannot be: it says which.
        """
        if session.joints != tuple(avatar_skeleton().names):
            raise HighFiveError(
                f"{session.path} is the recording of another avatar: {len(session.joints)} joints, this one has "
                f"{len(avatar_skeleton().names)}"
            )
        self._session, self._spans = session, dict[int, TrialSpan]()
        self._read = lru_cache(maxsize=1)(lambda span: asked_of_arm(session, span))
        self.ticks: dict[int, int] = {}
        for span in session.spans:
            if (reference := self._read(span)) is not None:
                self._spans[span.number], self.ticks[span.number] = span, len(reference.goals)
        if not self._spans:
            cut = "" if session.complete else "; it is cut short"
            raise HighFiveError(f"{session.path} holds no high five in which the palms met{cut}")

    def __getitem__(self, number: int) -> ReferenceTrajectory:
        """Of the high five of a number."""
        reference = self._read(self._spans[number])
        assert reference is not None
        return reference

    def __iter__(self) -> Iterator[int]:
        """Numbers, in order."""
        return iter(self._spans)

    def __len__(self) -> int:
        """Of the high fives."""
        return len(self._spans)


def asked_of_arm(session: SessionReader, span: TrialSpan) -> ReferenceTrajectory | None:
    """What one high five asks of the arm, a goal a tick of it; None where no palms met in it.

    Raises:
        HighFiveError: a value in it cannot be: it says which.
    """
    path, high_five = session.path, session.read(span, _TOPICS)
    people, avatars, starts, contacts = (
        [_Message(path, topic, tick, message) for tick, message in enumerate(high_five.of(topic))]
        for topic in ("/person", "/avatar", "/trial", "/contact")
    )
    times = np.array([person.time_ns for person in people])
    if not np.array_equal(times, [avatar.time_ns for avatar in avatars]):
        raise HighFiveError(
            f"{path}: high five {span.number + 1} has {len(people)} messages on /person and {len(avatars)} on "
            "/avatar, which do not belong together; a session records both in every tick"
        )
    if not starts or not contacts or len(people) < 2:
        return None
    start, contact = starts[0], contacts[-1]
    if not contact.yes("met") or contact.data.get("met_time") is None:
        return None
    due = float(contact.numbers("met_time"))
    if not 0.0 <= due <= 1e-9 * float(times[-1] - start.time_ns) + TOGETHER:  # a live person's clock jitters
        raise contact.wrong(f"met_time is {due:g} s, which is not within the trial")
    met = int(np.argmin(np.abs(times - start.time_ns - 1e9 * due)))  # a tick, wherever some came late
    return _reference(start.text("emotion"), start.text("cell"), met, _ours(avatars), _theirs(people))


@dataclass(frozen=True)
class _Message:
    """One message, whose values are checked as they are read; ``tick`` counts the topic's messages from 0."""

    path: Path
    topic: str
    tick: int
    message: RecordedMessage

    @property
    def time_ns(self) -> int:
        return self.message.time_ns

    @property
    def data(self) -> dict[str, Any]:
        if not isinstance(self.message.data, dict):
            raise self.wrong("it is no JSON object")
        return self.message.data

    def wrong(self, what: str) -> HighFiveError:
        return HighFiveError(f"{self.path}: {self.topic}, message {self.tick} ({1e-9 * self.time_ns:.3f} s): {what}")

    def numbers(self, key: str, *shape: int) -> Array:
        """Finite numbers of a shape."""
        try:
            values = np.array(self._value(key), dtype=np.float64)
        except (TypeError, ValueError):
            raise self.wrong(f"{key} is not made of numbers") from None
        if values.shape != shape:
            raise self.wrong(f"{key} has to be {' × '.join(map(str, shape)) or 'one'} numbers")
        if not np.isfinite(values).all():
            raise self.wrong(f"{key} has a number that is missing or not finite")
        return values

    def place(self, key: str) -> Array:
        """(3,) m, of somewhere in the scene."""
        place = self.numbers(key, 3)
        if (distance := float(np.linalg.norm(place))) > FURTHEST:
            raise self.wrong(
                f"{key} is {distance:.3g} m from the scene's origin, and nobody is further than {FURTHEST:g} m; "
                "are these millimetres?"
            )
        return place

    def units(self, key: str, *shape: int) -> Array:
        """Directions or rotations, of length 1 along the last axis."""
        values = self.numbers(key, *shape)
        if (np.abs(np.linalg.norm(values, axis=-1) - 1.0) > UNIT).any():
            raise self.wrong(f"{key} has not the length 1")
        return values

    def text(self, key: str) -> str:
        return self._of(str, key, "no text")

    def yes(self, key: str) -> bool:
        return self._of(bool, key, "neither true nor false")

    def _of(self, kind: type[T], key: str, otherwise: str) -> T:
        if not isinstance(value := self._value(key), kind):
            raise self.wrong(f"{key} is {otherwise}")
        return value

    def _value(self, key: str) -> Any:
        if key not in self.data:
            raise self.wrong(f"{key} is missing")
        return self.data[key]


@dataclass(frozen=True)
class _Seen:
    """The person in one tick: palm, and head (3,) m; ``valid`` where both were known."""

    palm: PalmPose
    head: Array
    valid: bool


def _ours(avatars: list[_Message]) -> list[PalmPose]:
    skeleton = avatar_skeleton()
    joints = len(skeleton.names)
    poses = [Pose.from_quaternions(it.place("root"), it.units("quaternions", joints, 4)) for it in avatars]
    placed = skeleton.forward_kinematics(
        np.array([pose.root_in_world for pose in poses]), np.array([pose.quaternions for pose in poses])
    )
    positions, normals, _ = right_palm(skeleton, *placed)
    return _moving(positions, normals)


def _theirs(people: list[_Message]) -> list[_Seen]:
    # Where a person was not seen, her place says nothing, but speeds are taken across it: it has to be near as well.
    palms = _moving(
        np.array([person.place("palm") for person in people]),
        np.array([person.units("palm_normal", 3) for person in people]),
    )
    return [_Seen(palm, it.place("head"), it.yes("valid")) for palm, it in zip(palms, people, strict=True)]


def _reference(emotion: str, cell: str, due: int, ours: list[PalmPose], theirs: list[_Seen]) -> ReferenceTrajectory:
    due = min(due, len(ours) - 1)
    goals = []
    for tick, (our, their) in enumerate(zip(ours, theirs, strict=True)):
        left = (due - tick) / RATE_HZ
        contact = None
        if their.valid and -TOGETHER <= left <= LEAD_TIME:
            at = theirs[due].palm if left > 0.0 else their.palm
            contact = ExpectedContact(at.position, SURE**2 * np.eye(3), -at.normal, max(left, 0.0))
        goals.append(PalmGoal(our, their.palm if their.valid else None, their.head if their.valid else None, contact))
    return ReferenceTrajectory(
        emotion, cell, tuple(goals), np.array([their.palm.position for their in theirs]),
        np.array([palm.position for palm in ours]), np.array([palm.normal for palm in ours]), due, due,
    )  # fmt: skip


def _moving(positions: Array, normals: Array) -> list[PalmPose]:
    """Palms (T, 3), m, with their velocities; fingers upwards, which the round plate does not care for."""
    velocities = np.array(np.gradient(positions, 1.0 / RATE_HZ, axis=0))
    up = np.array([0.0, 0.0, 1.0])
    return [PalmPose(p, n, up, v) for p, n, v in zip(positions, normals, velocities, strict=True)]

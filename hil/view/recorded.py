"""The high fives of a recording, ready to be shown: where every body was, tick by tick."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, overload

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.recording.session_reader import RecordedHighFive, SessionReader, read_session
from highfive.hil.session.contact_time import REACHING, SURE_S
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.sim.person import PersonBodies
from highfive.hil.sim.scene import Scene
from highfive.hil.view.arm_cast import ArmCast
from highfive.hil.view.cast import Cast
from highfive.hil.view.ellipsoid import ellipsoid
from highfive.mocap_bridge.frames import HumanArm, PalmPose
from highfive.mocap_bridge.sources.address import parse_address
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

_SHORTEST = 2  # ticks of a high five that can be shown
_TOPICS = ("/trial", "/person", "/avatar", "/tick", "/markers", "/forecast", "/arm", "/safety")


@dataclass(frozen=True)
class RecordedTrial:
    """A high five of T ticks.

    Attributes:
        title, style, cell: as recorded.
        times: (T,) s, from its first tick.
        bodies: (T, B, 7) position, m, and quaternion, of the bodies of :class:`Cast`, and, where a servo arm took part,
            of :class:`ArmCast`.
        markers: (T, M, 3) m; M is 0 where none were recorded.
        seen: (T, M) whether each was measured.
        weight: (T,) share of the correction.
        expected: (T,) s, time to contact as the model said; NaN where it was not sure.
        palms: (T,) m, from palm to palm.
        forecasts: of the contact, a tick each, as they are drawn; None where there was none, or it was not sure.
        contact: what was judged, as recorded; empty where nothing was.
        plates: (T,) m, from the servo arm's plate to the person's palm; None where no arm took part.
    """

    title: str
    style: str
    cell: str
    times: Float[np.ndarray, " T"]
    bodies: Float[np.ndarray, "T B 7"]
    markers: Float[np.ndarray, "T M 3"]
    seen: Bool[np.ndarray, "T M"]
    weight: Float[np.ndarray, " T"]
    expected: Float[np.ndarray, " T"]
    palms: Float[np.ndarray, " T"]
    forecasts: tuple[dict[str, Any] | None, ...]
    contact: Mapping[str, Any]
    plates: Float[np.ndarray, " T"] | None = None

    @property
    def contact_s(self) -> float | None:
        """When the palms met, s; None where they did not."""
        return met_time_of(self.contact)


class RecordedTrials(Sequence[RecordedTrial]):
    """The high fives of a recording that can be shown; the last one that was looked at is in memory.

    Attributes:
        spans: the same, as they are known without their ticks.
        lacking: of those that are left out, for they have no ticks of what is shown: number, and what was not recorded.
        rig: which servo arm took part, its name or folder; '' where none did, or it is not here.
        without_arm: why the arm that took part is not shown; '' where it is, or none did.
    """

    def __init__(self, session: SessionReader, scene: Scene) -> None:
        """See :func:`recorded_trials`."""
        joints = len(avatar_skeleton().names)
        if session.joints != tuple(avatar_skeleton().names):
            raise HighFiveError(
                f"{session.path} was recorded with another skeleton ({len(session.joints)} joints, this one has "
                f"{joints}); view it with the version that recorded it"
            )
        self._session, self._scene = session, scene
        self._read = lru_cache(maxsize=1)(self._trial)
        whole = [span for span in session.spans if not span.broken_off]
        self.spans = tuple(span for span in whole if span.ticks >= _SHORTEST)
        self.lacking = {span.number: span.lacking for span in whole if span.ticks < _SHORTEST}
        if not self.spans:
            what = "no high five" if not whole else f"no high five that can be shown: {whole[0].lacking}"
            raise HighFiveError(f"{session.path} holds {what}")
        self.rig, self.without_arm = self._arm()
        readable_from(self, 0, {})  # one of another version is refused before the page is opened

    @property
    def hand(self) -> str:
        """The hand that she gave to headset or webcam, ``right`` or ``left``: a left one was shown mirrored."""
        try:
            return parse_address(str(self._session.settings.get("source"))).options.get("hand", "right")
        except HighFiveError:  # a source that is not installed here
            return "right"

    def _arm(self) -> tuple[str, str]:
        """What ``rig`` and ``without_arm`` are."""
        if not any({"/safety", "/arm"} <= span.topics for span in self.spans):
            return "", ""
        arm = self._session.settings.get("arm_name")
        arm = arm if isinstance(arm, str) and arm else DEFAULT_ARM
        try:
            find_arm(arm)
        except HighFiveError as error:  # an arm of one's own, whose folder is elsewhere
            return "", str(error)
        return arm, ""

    def __len__(self) -> int:
        """Of the high fives."""
        return len(self.spans)

    @overload
    def __getitem__(self, place: int) -> RecordedTrial: ...
    @overload
    def __getitem__(self, place: slice) -> list[RecordedTrial]: ...
    def __getitem__(self, place: int | slice) -> RecordedTrial | list[RecordedTrial]:
        """The high five at a place.

        Raises:
            HighFiveError: it is of another version, or damaged.
        """
        if isinstance(place, slice):
            return [self._read(number) for number in range(len(self))[place]]
        return self._read(range(len(self))[place])

    def _trial(self, place: int) -> RecordedTrial:
        span = self.spans[place]
        try:
            return _trial(self._session.read(span, _TOPICS), self._scene, self.rig)
        except (KeyError, ValueError, TypeError, IndexError, AttributeError):
            raise HighFiveError(
                f"{self._session.path} is a recording of another version, or damaged: high five {span.number + 1} "
                "lacks something that is shown; view it with the version that recorded it"
            ) from None


def readable_from(trials: Sequence[RecordedTrial], place: int, damaged: dict[int, str]) -> int:
    """The high five at a place, or the next that can be read; those that are passed over go into ``damaged``, and why.

    Raises:
        HighFiveError: none can be read; why not the first that was passed over.
    """
    while True:
        try:
            trials[place]
        except HighFiveError as error:
            damaged[place] = str(error)
            if len(damaged) == len(trials):
                raise HighFiveError(next(iter(damaged.values()))) from None
            place = (place + 1) % len(trials)
        else:
            return place


def recorded_trials(path: Path, scene: Scene) -> RecordedTrials:
    """The high fives of a recording; one that was cut short is shown up to its last whole chunk.

    Args:
        path: of the MCAP file.
        scene: in which bodies are placed.

    Raises:
        HighFiveError: it cannot be read, holds no high five, or is of another version or another skeleton.
    """
    return RecordedTrials(read_session(path), scene)


def _trial(high_five: RecordedHighFive, scene: Scene, rig: str) -> RecordedTrial:
    people, poses, ticks, markers, forecasts = (
        {message.time_ns: message.data for message in high_five.of(topic)}
        for topic in ("/person", "/avatar", "/tick", "/markers", "/forecast")
    )
    times = [time for time in poses if time in people and time in ticks]
    if len(times) < _SHORTEST:
        raise ValueError("too few ticks can be read")
    played = [
        Pose.from_quaternions(np.array(poses[time]["root"]), np.array(poses[time]["quaternions"])) for time in times
    ]
    humans = [person_of(people[time], time) for time in times]
    bodies, palms = placed_bodies(scene, played, humans)
    arm, plates = _arm(high_five, times, rig), None
    if arm is not None:
        bodies = np.concatenate([bodies, arm[0]], axis=1)
        plates = np.linalg.norm(arm[1] - [human.palm.position for human in humans], axis=1)
    span = high_five.span
    expected = [_sure_contact_s(ticks[time], forecasts.get(time)) for time in times]
    points, seen = _markers([markers.get(time) for time in times])
    return RecordedTrial(
        title=span.text("title"),
        style=span.text("style"),
        cell=span.text("cell"),
        times=1e-9 * (np.array(times) - times[0]),
        bodies=bodies,
        markers=points,
        seen=seen,
        weight=_numbers([ticks[time]["weight"] for time in times]),
        expected=_numbers(expected),
        palms=palms,
        forecasts=tuple(
            None if sure is None else _forecast(forecasts.get(time)) for time, sure in zip(times, expected, strict=True)
        ),
        contact=span.contact,
        plates=plates,
    )


def met_time_of(contact: Mapping[str, Any]) -> float | None:
    """When the palms met, s from the first tick; None where they did not."""
    time = contact.get("met_time")
    return float(time) if isinstance(time, int | float) else None


def placed_bodies(scene: Scene, poses: Sequence[Pose], people: Sequence[HumanArm]) -> tuple[Array, Array]:
    """(T, B, 7) of the bodies of :class:`Cast`, and (T,) m from palm to palm, of T poses and the person in each."""
    cast, data, person = Cast.of(scene.model), scene.make_data(), PersonBodies(scene.model, scene.skeleton)
    bodies, palms = np.empty((len(poses), len(cast.names), 7)), np.empty(len(poses))
    for i, (pose, human) in enumerate(zip(poses, people, strict=True)):
        scene.set_pose(data, pose)
        person.put(data, human)
        mujoco.mj_kinematics(scene.model, data)
        bodies[i] = cast.poses(data)
        palms[i] = np.linalg.norm(data.site_xpos[scene.palm_site] - human.palm.position)
    return bodies, palms


def _arm(high_five: RecordedHighFive, times: Sequence[int], rig: str) -> tuple[Array, Array] | None:
    """(T, 2 A, 7) of the servo arm, and (T, 3) m where its plate is; None where none took part, or it is not here."""
    if not rig:
        return None
    wanted, measured = (
        [(message.time_ns, message.data[name]) for message in high_five.of(topic)]
        for topic, name in (("/safety", "wanted"), ("/arm", "positions"))
    )
    if not wanted or not measured:
        return None
    cast = ArmCast(rig)
    joints = [
        np.array(
            [np.interp(times, [time for time, _ in rows], joint) for joint in np.array([row for _, row in rows]).T]
        ).T
        for rows in (measured, wanted)
    ]
    if {one.shape[1] for one in joints} != {cast.joints}:
        raise ValueError("the arm has other joints")
    bodies = np.array([cast.poses(here, there) for here, there in zip(*joints, strict=True)])
    return bodies, np.array([cast.plate(here) for here in joints[0]])


def _numbers(values: Sequence[float | None]) -> Array:
    return np.array([np.nan if value is None else float(value) for value in values])


def _sure_contact_s(tick: dict[str, Any], forecast: dict[str, Any] | None) -> float | None:
    """As the page of the session had it. Recordings of before say nothing of it, nor of unfamiliar hands: there the
    forecast's own deviation judges.
    """
    sure = tick.get("sure")
    if sure is None:
        reaches = not tick["phase"] or tick["phase"] in [phase.value for phase in REACHING]  # some have none
        sure = forecast is not None and reaches and float(forecast["time_deviation"]) <= SURE_S
    return (forecast["time"] if forecast is not None else tick["time_to_contact"]) if sure else None


def _forecast(message: dict[str, Any] | None) -> dict[str, Any] | None:
    """As it is drawn; after its time it says nothing any more."""
    if message is None or float(message["time"]) < 0.0:
        return None
    return ellipsoid(np.array(message["point"], dtype=float), np.array(message["covariance"], dtype=float))


def _markers(rows: Sequence[dict[str, Any] | None]) -> tuple[Array, np.ndarray]:
    count = max((len(row["names"]) for row in rows if row), default=0)
    points, seen = np.zeros((len(rows), count, 3)), np.zeros((len(rows), count), dtype=bool)
    for i, row in enumerate(rows):
        if row and len(row["names"]) == count:
            points[i], seen[i] = row["positions"], row["seen"]
    return points, seen


def person_of(said: dict[str, Any], time_ns: int) -> HumanArm:
    """The person of a ``/person`` message; the fingers go on from wrist to knuckles, across the palm's normal."""
    wrist, knuckles, normal = (np.array(said[name], dtype=float) for name in ("wrist", "knuckles", "palm_normal"))
    along = knuckles - wrist
    along = along - normal * (along @ normal)
    length = float(np.linalg.norm(along))
    fingers = along / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
    head, turn, shoulder, elbow, palm = (
        np.array(said[name], dtype=float) for name in ("head", "head_orientation", "shoulder", "elbow", "palm")
    )
    return HumanArm(
        head, turn, shoulder, elbow, wrist, knuckles, PalmPose(palm, normal, fingers, np.zeros(3)),
        np.array([wrist, knuckles]), bool(said["valid"]), int(said["age_ns"]), time_ns,
    )  # fmt: skip

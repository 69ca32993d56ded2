"""The recording of a session: an MCAP file that stays readable whatever ends the session.

Messages are JSON, times are ns. Data goes to the file in whole chunks of half a second, so that a crash loses no more than the
last of them. ``/skeleton`` is a Foxglove SceneUpdate (30 Hz): Foxglove and other viewers draw it as it is.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from zstandard import ZstdError

from hil.avatar import Pose, avatar_skeleton
from hil.session import Tick
from hil.summary import SessionSettings, versions
from hil.trial import TrialResult
from mocap_bridge.frames import HumanArm, TrackedMarkers
from model.errors import HighFiveError
from model.rotations import Array

CHUNK_NS = 500_000_000
PAUSE_NS = 1_000_000_000
"""Between two trials of a simulated session, whose clocks both start at 0."""
_SKELETON_EVERY = 4
"""Ticks between two drawn skeletons."""

_NUMBER: dict[str, Any] = {"type": "number"}
_TEXT: dict[str, Any] = {"type": "string"}
_YES: dict[str, Any] = {"type": "boolean"}
_LIST: dict[str, Any] = {"type": "array", "items": _NUMBER}
_ROWS: dict[str, Any] = {"type": "array", "items": _LIST}
_NAMES: dict[str, Any] = {"type": "array", "items": _TEXT}
_UNKNOWN: dict[str, Any] = {"type": ["number", "null"]}
_POSE = {"root": _LIST, "quaternions": _ROWS}
_CHANNELS: dict[str, tuple[str, dict[str, Any]]] = {
    "/session": ("high_five.Session", {"settings": {"type": "object"}, "joints": _NAMES, "units": _TEXT}),
    "/trial": ("high_five.Trial", {"trial": _NUMBER, "title": _TEXT, "emotion": _TEXT, "cell": _TEXT, "simulated": _YES}),
    "/markers": ("high_five.Markers", {"names": _NAMES, "positions": _ROWS, "seen": {"type": "array", "items": _YES}}),
    "/person": (
        "high_five.Person",
        {"head": _LIST, "head_orientation": _LIST, "shoulder": _LIST, "elbow": _LIST, "wrist": _LIST, "knuckles": _LIST,
         "palm": _LIST, "palm_normal": _LIST, "valid": _YES, "age_ns": _NUMBER},
    ),
    "/generated": ("high_five.Pose", _POSE),
    "/avatar": ("high_five.Pose", _POSE),
    "/tick": (
        "high_five.Tick",
        {"trial": _NUMBER, "phase": _TEXT, "weight": _NUMBER, "time_to_contact": _UNKNOWN, "latency_ms": _UNKNOWN},
    ),
    "/contact": (
        "high_five.Contact",
        {"trial": _NUMBER, "met": _YES, "distance": _NUMBER, "gap": _NUMBER, "lateral": _NUMBER, "palm_angle": _NUMBER,
         "approach_speed": _NUMBER, "peak_force": _NUMBER, "where": _LIST, "out_of_reach": _YES},
    ),
    "/skeleton": ("foxglove.SceneUpdate", {"deletions": {"type": "array"}, "entities": {"type": "array"}}),
}  # fmt: skip
_RGBA = {"avatar": (0.84, 0.37, 0.0, 1.0), "person": (0.0, 0.45, 0.70, 1.0)}


class _Sink:
    """An unbuffered file that keeps count of what is whole: a buffer would try again to write what failed."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self._written = self._whole = 0

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        while left:
            count = self._file.write(left) or 0
            self._written += count
            left = left[count:]
        return len(data)

    def tell(self) -> int:
        return self._written

    def flush(self) -> None:
        """Marks a place where a reader may stop."""
        self._whole = self._written

    def cut(self) -> None:
        """Drops what is not whole, where the file can be cut, and closes."""
        with suppress(OSError):
            self._file.truncate(self._whole)
        self._file.close()

    def close(self) -> None:
        self._file.close()


class SessionRecorder:
    """Writes a session, tick by tick or trial by trial; close it, or use it in ``with``.

    Encoding a tick takes some 0.5 ms and now and then waits for the disk: in a live session, call it outside of the
    tick's thread.
    """

    def __init__(self, path: Path, settings: SessionSettings) -> None:
        """Starts the file, over any that was there, with the session's settings.

        Raises:
            HighFiveError: as from every method, the file cannot be written; what was written before stays readable.
        """
        self.path = path
        self._failure: HighFiveError | None = None
        self._chunk_start: int | None = None
        self._end = self._count = 0
        self._markers_known = False
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._sink = _Sink(path)
        except OSError as error:
            raise HighFiveError(f"cannot write the recording {path}: {error.strerror or error}") from None
        # The chunks are cut by time below; this only bounds the memory of one.
        self._writer = Writer(self._sink, chunk_size=8 * 1024 * 1024)  # pyright: ignore[reportArgumentType]
        try:
            self._writer.start(profile="", library="high-five")
        except OSError as error:
            raise self._fail(error) from None
        self._channels = {topic: self._register(topic, *entry) for topic, entry in _CHANNELS.items()}
        about = {"settings": {**asdict(settings), "versions": versions()}, "joints": list(avatar_skeleton().names)}
        self._add("/session", 0, {**about, "units": "m, rad, s; quaternions w x y z, relative to the parent joint"})
        self._flush()

    def _register(self, topic: str, name: str, properties: dict[str, Any]) -> int:
        schema = json.dumps({"title": name, "type": "object", "properties": properties}).encode()
        number = self._writer.register_schema(name, SchemaEncoding.JSONSchema, schema)
        return self._writer.register_channel(topic, MessageEncoding.JSON, number)

    def record_tick(self, trial: int, tick: Tick, played: Pose, latency_ms: float) -> None:
        """One tick of a live session; its time is the person's.

        Args:
            trial: number of the trial.
            tick: what the session made of the frame.
            played: the pose that was really shown.
            latency_ms: markers in to pose out.
        """
        now = tick.person.time_ns
        self._record_poses(now, tick.person, played, tick.generated)
        self._record_markers(now, tick.markers)
        facts = tick.target.phase.value, tick.target.weight, tick.response.time_to_contact
        self._record_tick_facts(now, trial, *facts, latency_ms)

    def record_trial(self, result: TrialResult) -> None:
        """A whole trial, a second after what came before, with its judgement at the end."""
        start = self._end + PAUSE_NS if self._count else 0
        self._add("/trial", start, _trial(result))
        for i, time in enumerate(result.times):
            now = start + round(1e9 * float(time))
            self._record_poses(now, result.people[i], result.poses[i], result.generated[i])
            weight, expected, latency = (float(values[i]) for values in (result.weight, result.expected, result.tick_ms))
            self._record_tick_facts(now, result.number, "", weight, expected, latency)
        self.record_contact(result, self._end)

    def record_contact(self, result: TrialResult, time_ns: int) -> None:
        """The judgement of a trial, and makes all of it safe."""
        self._add("/contact", time_ns, _contact(result))
        self._flush()

    def close(self) -> None:
        """Writes the index; without it the file is still readable, only slower to open."""
        if self._failure:
            return
        try:
            self._writer.finish()
            self._sink.close()
        except OSError as error:
            self._fail(error)
        self._failure = HighFiveError(f"the recording {self.path} is closed")

    def __enter__(self) -> SessionRecorder:
        """Self."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Closes."""
        self.close()

    def _record_poses(self, now: int, person: HumanArm, played: Pose, generated: Pose) -> None:
        self._add("/person", now, _person(person))
        self._add("/generated", now, _pose(generated))
        self._add("/avatar", now, _pose(played))
        if self._count % _SKELETON_EVERY == 0:
            self._add("/skeleton", now, _skeleton_update(now, person, played))

    def _record_markers(self, now: int, markers: TrackedMarkers) -> None:
        names = {} if self._markers_known else {"names": list(markers.names)}
        self._markers_known = True
        self._add("/markers", now, {**names, "positions": _rounded(markers.positions), "seen": markers.seen.tolist()})

    def _record_tick_facts(
        self, now: int, trial: int, phase: str, weight: float, expected: float, latency_ms: float
    ) -> None:
        facts = {"trial": trial, "weight": round(weight, 5), "time_to_contact": _known(expected)}
        self._add("/tick", now, {**facts, "phase": phase, "latency_ms": _known(latency_ms)})
        self._count += 1
        self._end = now
        if self._chunk_start is None:
            self._chunk_start = now
        elif now - self._chunk_start >= CHUNK_NS or now < self._chunk_start:
            self._flush()

    def _add(self, topic: str, time_ns: int, message: Mapping[str, Any]) -> None:
        if self._failure:
            raise self._failure
        data = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
        try:
            self._writer.add_message(self._channels[topic], time_ns, data, time_ns, self._count)
        except OSError as error:
            raise self._fail(error) from None

    def _flush(self) -> None:
        self._chunk_start = None
        try:
            self._writer.flush()
        except OSError as error:
            raise self._fail(error) from None

    def _fail(self, error: OSError) -> HighFiveError:
        self._sink.cut()
        self._failure = HighFiveError(
            f"cannot write the recording {self.path}: {error.strerror or error}; what it holds up to {1e-9 * self._end:.1f} s "
            "can be read, make room for the rest"
        )
        return self._failure


@dataclass(frozen=True)
class RecordedMessage:
    """One message: when, ns, and what."""

    time_ns: int
    data: dict[str, Any]


@dataclass(frozen=True)
class SessionRecording:
    """What a recording holds.

    Attributes:
        settings: of the session, as :class:`hil.summary.SessionSettings` names them, and the versions.
        joints: names of the skeleton's joints.
        channels: messages of each topic, in order.
        complete: the file was closed; otherwise its end is missing and this is all up to the last whole chunk.
    """

    settings: dict[str, Any]
    joints: tuple[str, ...]
    channels: Mapping[str, tuple[RecordedMessage, ...]]
    complete: bool

    def poses(self, topic: str = "/avatar") -> tuple[Array, tuple[Pose, ...]]:
        """Times (T,), s, and poses of ``/avatar`` or ``/generated``."""
        messages = self.channels[topic]
        poses = (Pose.from_quaternions(np.array(m.data["root"]), np.array(m.data["quaternions"])) for m in messages)
        return np.array([1e-9 * m.time_ns for m in messages]), tuple(poses)


def read_recording(path: Path) -> SessionRecording:
    """Reads a recording, also one whose end is missing.

    Raises:
        HighFiveError: there is no such file, or it holds no session.
    """
    channels: dict[str, list[RecordedMessage]] = {topic: [] for topic in _CHANNELS}
    complete = False
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            if size == 0:
                raise HighFiveError(f"{path} is empty; a recording of a session starts with its settings")
            reader = StreamReader(file, validate_crcs=True, record_size_limit=size)
            with suppress(*_CUT_SHORT):
                for topic, message in _messages(reader):
                    if topic in channels:
                        channels[topic].append(RecordedMessage(message.log_time, json.loads(message.data)))
                complete = True
    except OSError as error:
        raise HighFiveError(f"cannot read the recording {path}: {error.strerror or error}") from None
    if not channels["/session"]:
        raise HighFiveError(f"{path} is not the recording of a session: no readable MCAP chunk with a /session message in it")
    about = channels["/session"][0].data
    kept = {topic: tuple(messages) for topic, messages in channels.items()}
    return SessionRecording(about["settings"], tuple(about["joints"]), kept, complete)


# What a file that ends anywhere, or is no MCAP at all, makes the library raise.
_CUT_SHORT = (McapError, CRCValidationError, struct.error, zlib.error, ValueError, KeyError, ZstdError)


def _messages(reader: StreamReader) -> Iterator[tuple[str, Message]]:
    topics: dict[int, str] = {}
    for record in reader.records:
        if isinstance(record, Channel) and record.message_encoding == MessageEncoding.JSON:
            topics[record.id] = record.topic
        elif isinstance(record, Message) and record.channel_id in topics:
            yield topics[record.channel_id], record


def _rounded(values: Array, digits: int = 5) -> list[Any]:
    """As nested lists, to 10 µm or 10 µrad: a fifth of the size of full floats."""
    return np.round(values, digits).tolist()


def _known(value: float) -> float | None:
    return round(value, 5) if np.isfinite(value) else None


def _pose(pose: Pose) -> dict[str, Any]:
    return {"root": _rounded(pose.root_in_world), "quaternions": _rounded(pose.quaternions)}


def _person(arm: HumanArm) -> dict[str, Any]:
    return {
        "head": _rounded(arm.head_position),
        "head_orientation": _rounded(arm.head_orientation),
        "shoulder": _rounded(arm.shoulder),
        "elbow": _rounded(arm.elbow),
        "wrist": _rounded(arm.wrist),
        "knuckles": _rounded(arm.knuckles),
        "palm": _rounded(arm.palm.position),
        "palm_normal": _rounded(arm.palm.normal),
        "valid": bool(arm.valid),
        "age_ns": int(arm.age_ns),
    }


def _trial(result: TrialResult) -> dict[str, Any]:
    names = {"emotion": result.emotion, "cell": result.cell, "notes": list(result.notes)}
    return {"trial": result.number, "title": result.title, "simulated": result.simulated, **names}


def _contact(result: TrialResult) -> dict[str, Any]:
    contact = result.contact
    return {
        "trial": result.number,
        "met": contact.met,
        "met_time": _known(result.contact_time),
        "distance": _known(contact.distance),
        "gap": _known(contact.gap),
        "lateral": _known(contact.lateral),
        "palm_angle": _known(contact.palm_angle),
        "approach_speed": _known(contact.approach_speed),
        "peak_force": _known(contact.peak_force),
        "where": _rounded(contact.where),
        "out_of_reach": bool(result.out_of_reach),
        "uncorrected_error": _known(result.uncorrected_error),
        "unwanted": [{"first": u.first, "second": u.second, "deepest": _known(u.deepest)} for u in contact.unwanted],
    }


def _skeleton_update(now: int, person: HumanArm, pose: Pose) -> dict[str, Any]:
    """A ``foxglove.SceneUpdate``: the avatar's bones, and the person's head, arm and hand, as lines."""
    skeleton = avatar_skeleton()
    joints, _ = skeleton.forward_kinematics(pose.root_in_world, pose.quaternions)
    bones = [joints[[parent, joint]] for joint, parent in enumerate(skeleton.parents) if parent >= 0]
    arm = np.array([person.head_position, person.shoulder, person.elbow, person.wrist, person.knuckles])
    lines = {"avatar": np.concatenate(bones), "person": np.repeat(arm, 2, axis=0)[1:-1]}
    return {"deletions": [], "entities": [_entity(now, name, points) for name, points in lines.items()]}


def _entity(now: int, name: str, points: Array) -> dict[str, Any]:
    origin = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    line = {
        "type": 2,  # a list of segments
        "pose": origin,
        "thickness": 0.012,
        "scale_invariant": False,
        "points": [dict(zip("xyz", point, strict=True)) for point in _rounded(points, 3)],
        "color": dict(zip("rgba", _RGBA[name], strict=True)),
        "colors": [],
        "indices": [],
    }
    others = {kind: [] for kind in ("metadata", "arrows", "cubes", "spheres", "cylinders", "triangles", "texts", "models")}
    stamp = {"sec": now // 1_000_000_000, "nsec": now % 1_000_000_000}
    return {"timestamp": stamp, "frame_id": "world", "id": name, "lifetime": {"sec": 0, "nsec": 0},
            "frame_locked": False, "lines": [line], **others}  # fmt: skip

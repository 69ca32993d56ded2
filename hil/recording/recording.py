"""The recording of a session: an MCAP file that stays readable whatever ends the session.

Messages are JSON, times are ns. Data goes to the file in whole chunks of half a second: a crash loses no more than the
last of them. ``/skeleton`` is a Foxglove SceneUpdate (30 Hz): Foxglove and other viewers draw it as it is.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from numpy.typing import NDArray
from zstandard import ZstdError

from highfive.hil.recording import messages
from highfive.hil.recording.arrays import message_arrays, message_table
from highfive.hil.session.session import Tick
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.trials.summary import SessionSettings, versions
from highfive.hil.trials.trial_result import TrialResult
from highfive.mocap_bridge.frames import HumanArm, TrackedMarkers
from highfive.model.errors import HighFiveError
from highfive.model.files import unfinished
from highfive.model.geometry.rotations import Array
from highfive.model.online.contact_forecast import ContactForecast
from highfive.model.online.reaction import current_forecast

if TYPE_CHECKING:
    from pandas import DataFrame  # pyright: ignore[reportMissingImports]

    from highfive.hil.arm.arm_trial import ArmTrial

CHUNK_NS = 500_000_000
PAUSE_NS = 1_000_000_000
"""Between two trials of a simulated session, whose clocks both start at 0."""
_SKELETON_EVERY = 4
"""Ticks between two drawn skeletons."""


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

    A recording that has that name already stays until this one is closed.

    Encoding a tick takes some 0.5 ms and now and then waits for the disk: in a live session, call it outside of the
    tick's thread.
    """

    def __init__(self, path: Path, settings: SessionSettings) -> None:
        """Starts the file with the session's settings.

        Raises:
            HighFiveError: as from every method, the file cannot be written; what was written before stays readable.
        """
        self.path = path
        self._file = unfinished(path) if path.is_file() else path
        self._failure: HighFiveError | None = None
        self._chunk_start: int | None = None
        self._end = self._count = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._sink = _Sink(self._file)
        except OSError as error:
            raise HighFiveError(f"cannot write the recording {path}: {error.strerror or error}") from None
        # The chunks are cut by time below; this only bounds the memory of one.
        self._writer = Writer(self._sink, chunk_size=8 * 1024 * 1024)  # pyright: ignore[reportArgumentType]
        try:
            self._writer.start(profile="", library="high-five")
        except OSError as error:
            raise self._fail(error) from None
        self._channels = {topic: self._register(topic, *entry) for topic, entry in messages.CHANNELS.items()}
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
        if self._count % _SKELETON_EVERY == 0:
            self._add("/skeleton", now, messages.skeleton_update(now, tick.person, messages.joints_of([played])[0]))
        self._record_markers(now, tick.markers)
        self._record_forecast(now, current_forecast(tick.response))
        facts = tick.target.phase.value, tick.target.weight, tick.response.time_to_contact
        self._record_tick_facts(now, trial, *facts, latency_ms)

    def record_trial(self, result: TrialResult, arm: ArmTrial | None = None) -> None:
        """A whole trial, a second after what came before, with its judgement at the end; and what the arm did in it."""
        start = self._end + PAUSE_NS if self._count else 0
        self._add("/trial", start, messages.trial(result))
        drawn = messages.joints_of(result.poses[::_SKELETON_EVERY])
        for i, time in enumerate(result.times):
            now = start + round(1e9 * float(time))
            self._record_poses(now, result.people[i], result.poses[i], result.generated[i])
            self._record_markers(now, result.markers[i])
            self._record_forecast(now, result.forecasts[i])
            if i % _SKELETON_EVERY == 0:
                self._add(
                    "/skeleton", now, messages.skeleton_update(now, result.people[i], drawn[i // _SKELETON_EVERY])
                )
            weight, expected, latency = (
                float(values[i]) for values in (result.weight, result.expected, result.tick_ms)
            )
            self._record_tick_facts(now, result.number, "", weight, expected, latency)
        if arm is not None:
            self._record_arm(start, arm)
        self.record_contact(result, self._end)

    def record_played(self, arm: ArmTrial) -> None:
        """What the arm did in a high five that was recorded before, a second after what came before."""
        start = self._end + PAUSE_NS if self._count else 0
        self._count += 1
        self._record_arm(start, arm)
        self._end = start + arm.ticks[-1].frame_ns - arm.ticks[0].frame_ns
        self._flush()

    def _record_arm(self, start: int, arm: ArmTrial) -> None:
        """Ticks and cycles of the arm, at their time after the trial's first frame."""
        first = arm.ticks[0].frame_ns
        for tick in arm.ticks:
            self._add("/safety", start + tick.frame_ns - first, messages.safety(tick))
        for cycle in arm.cycles:
            self._add("/arm", max(start, start + cycle.state.time_ns - first), messages.arm_cycle(cycle))

    def record_contact(self, result: TrialResult, time_ns: int) -> None:
        """The judgement of a trial, and makes all of it safe."""
        self._add("/contact", time_ns, messages.contact(result))
        self._flush()

    def close(self) -> None:
        """Writes the index; without it the file is still readable, only slower to open."""
        if self._failure:
            return
        try:
            self._writer.finish()
            self._sink.close()
            self._take_name()
        except OSError as error:
            self._fail(error)
        self._failure = HighFiveError(f"the recording {self.path} is closed")

    def discard(self) -> None:
        """Leaves nothing of this recording, and closes."""
        self._sink.close()
        self._file.unlink(missing_ok=True)
        self._failure = HighFiveError(f"the recording {self.path} is closed")

    def __enter__(self) -> SessionRecorder:
        """Self."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes."""
        self.close()

    def _record_poses(self, now: int, person: HumanArm, played: Pose, generated: Pose) -> None:
        self._add("/person", now, messages.person(person))
        self._add("/generated", now, messages.pose(generated))
        self._add("/avatar", now, messages.pose(played))

    def _record_markers(self, now: int, markers: TrackedMarkers) -> None:
        positions, seen = messages.rounded(markers.positions), markers.seen.tolist()
        self._add("/markers", now, {"names": list(markers.names), "positions": positions, "seen": seen})

    def _record_forecast(self, now: int, forecast: ContactForecast | None) -> None:
        if forecast is not None:
            self._add("/forecast", now, messages.forecast(forecast))

    def _record_tick_facts(
        self, now: int, trial: int, phase: str, weight: float, expected: float, latency_ms: float
    ) -> None:
        facts = {"trial": trial, "weight": round(weight, 5), "time_to_contact": messages.known(expected)}
        self._add("/tick", now, {**facts, "phase": phase, "latency_ms": messages.known(latency_ms)})
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
        with self._writing():
            self._writer.add_message(self._channels[topic], time_ns, data, time_ns, self._count)

    def _flush(self) -> None:
        self._chunk_start = None
        with self._writing():
            self._writer.flush()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """The file stays readable whatever happens meanwhile."""
        try:
            yield
        except OSError as error:
            raise self._fail(error) from None
        except KeyboardInterrupt:
            self._abandon()
            raise

    def _abandon(self) -> None:
        # Inside the writer, half a record may be in the chunk: the file ends before it.
        self._sink.cut()
        self._failure = HighFiveError(f"the recording {self.path} was interrupted")
        self._take_name()

    def _take_name(self) -> None:
        if self._file != self.path:
            os.replace(self._file, self.path)

    def _fail(self, error: OSError) -> HighFiveError:
        self._sink.cut()
        if self._file != self.path and not self._count:
            self._file.unlink(missing_ok=True)
        self._failure = HighFiveError(
            f"cannot write the recording {self._file}: {error.strerror or error}; "
            f"what it holds up to {1e-9 * self._end:.1f} s can be read, make room for the rest"
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
        settings: of the session, as :class:`highfive.hil.trials.summary.SessionSettings` names them, and the versions.
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

    def arrays(self, topic: str) -> dict[str, NDArray[Any]]:
        """A topic's messages as one array per field; see :func:`highfive.hil.recording.arrays.message_arrays`.

        Raises:
            HighFiveError: recordings have no such topic.
        """
        if topic not in self.channels:
            raise HighFiveError(f"no topic {topic!r} in a recording; there are {', '.join(self.channels)}")
        messages = self.channels[topic]
        return message_arrays([m.time_ns for m in messages], [m.data for m in messages])

    def table(self, topic: str) -> DataFrame:
        """A topic's messages as a pandas table, a row a message.

        Raises:
            HighFiveError: recordings have no such topic, or pandas is not installed.
        """
        return message_table(self.arrays(topic))


def read_recording(path: Path | str) -> SessionRecording:
    """Reads a recording, also one whose end is missing.

    Raises:
        HighFiveError: there is no such file, or it holds no session. Other values than the session's are not checked.
    """
    path = Path(path)
    channels: dict[str, list[RecordedMessage]] = {topic: [] for topic in messages.CHANNELS}
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
        raise HighFiveError(
            f"{path} is not the recording of a session: no readable MCAP chunk with a /session message in it"
        )
    about = channels["/session"][0].data
    if not (
        isinstance(about, dict) and isinstance(about.get("settings"), dict) and isinstance(about.get("joints"), list)
    ):
        raise HighFiveError(f"{path}: /session holds no settings and joints")
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

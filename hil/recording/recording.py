"""Reading the recording of a session: an MCAP file (:mod:`highfive.hil.recording.recorder` writes it)."""

from __future__ import annotations

import json
import logging
import struct
import zlib
from collections.abc import Collection, Generator, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.well_known import MessageEncoding
from numpy.typing import NDArray
from zstandard import ZstdError

from highfive.hil.recording import schemas
from highfive.hil.recording.arrays import message_arrays, message_table
from highfive.hil.recording.viewer_messages import cloud_points
from highfive.hil.sim.avatar import Pose
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

if TYPE_CHECKING:
    from pandas import DataFrame  # pyright: ignore[reportMissingImports]

LOG = logging.getLogger(__name__)

MARKERS = "/markers"
"""The one topic of points that is read back; the others are for viewers."""


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
        channels: messages of each topic, in order; ``/lsl/NAME`` is what was recorded beside the session.
        complete: the file was closed; otherwise its end is missing and this is all up to the last whole chunk.
        chain: settings of pose and tracker, by field; None where they were not recorded.
    """

    settings: dict[str, Any]
    joints: tuple[str, ...]
    channels: Mapping[str, tuple[RecordedMessage, ...]]
    complete: bool
    chain: Mapping[str, dict[str, Any]] | None = None

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
    channels: dict[str, list[RecordedMessage]] = {topic: [] for topic in (*schemas.TOPICS, MARKERS)}
    messages = recorded_messages(Path(path))
    while True:
        try:
            topic, message = next(messages)
        except StopIteration as end:
            complete = bool(end.value)
            break
        channels.setdefault(topic, []).append(message)
    about = channels["/session"][0].data
    kept = {topic: tuple(messages) for topic, messages in channels.items()}
    return SessionRecording(about["settings"], tuple(about["joints"]), kept, complete, about.get("chain"))


def recorded_messages(path: Path) -> Generator[tuple[str, RecordedMessage], None, bool]:
    """Topic and message, one after the other as they stand in the file, the session's settings first.

    A message that cannot be decoded is left out.

    Returns:
        whether the file was closed; otherwise its end is missing.

    Raises:
        HighFiveError: there is no such file, or it holds no session.
    """
    begun = complete = False
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            if size == 0:
                raise HighFiveError(f"{path} is empty; a recording of a session starts with its settings")
            reader = StreamReader(file, validate_crcs=True, record_size_limit=size)
            with suppress(*_CUT_SHORT):
                for topic, time_ns, data in _messages(reader, (*schemas.TOPICS, MARKERS)):
                    if not begun and topic == "/session":
                        begun = _says_settings(data, path)
                    yield topic, RecordedMessage(time_ns, data)
                complete = True
    except OSError as error:
        raise HighFiveError(f"cannot read the recording {path}: {error.strerror or error}") from None
    if not begun:
        raise HighFiveError(
            f"{path} is not the recording of a session: no readable MCAP chunk with a /session message in it"
        )
    return complete


def _says_settings(about: object, path: Path) -> bool:
    """That a ``/session`` message says what it has to."""
    if not (
        isinstance(about, dict) and isinstance(about.get("settings"), dict) and isinstance(about.get("joints"), list)
    ):
        raise HighFiveError(f"{path}: /session holds no settings and joints")
    return True


# What a file that ends anywhere, or is no MCAP at all, makes the library raise.
_CUT_SHORT = (
    McapError, CRCValidationError, DecodeError, struct.error, zlib.error, ValueError, KeyError, ZstdError,
)  # fmt: skip

# What one message that is not as it should be makes its decoding raise: it is left out, and reading goes on.
_MALFORMED = (DecodeError, struct.error, ValueError, KeyError, RecursionError)


def _messages(reader: StreamReader, topics: Collection[str]) -> Iterator[tuple[str, int, dict[str, Any]]]:
    """Topic, time and content of each message on ``topics`` and of every other program's stream; rows are rows, and
    points and channels have their names.
    """
    found: dict[int, tuple[str, str]] = {}
    names: list[str] = []
    labels: dict[str, list[str]] = {}
    malformed = 0
    for record in reader.records:
        if isinstance(record, Channel) and (record.topic in topics or record.topic.startswith(schemas.STREAMS)):
            found[record.id] = record.topic, record.message_encoding
        elif isinstance(record, Message) and record.channel_id in found:
            topic, encoding = found[record.channel_id]
            try:
                if encoding == MessageEncoding.JSON:
                    data = _json_object(record.data)
                    if topic in schemas.TOPICS:
                        data = schemas.restored(topic, data)
                        names = data.get("markers", names) if topic == "/trial" else names
                    elif topic not in topics:
                        data["labels"] = labels[topic] = data.get("labels", labels.get(topic, []))
                elif topic == MARKERS:
                    data = {"names": names, **cloud_points(record.data)}
                else:
                    continue
            except _MALFORMED:
                malformed += 1
                continue
            yield topic, record.log_time, data
    if malformed:
        LOG.warning("malformed messages left out of the recording: %d", malformed)


def _json_object(content: bytes) -> dict[str, Any]:
    """A message's JSON object; ValueError where it is something else."""
    data = json.loads(content)
    if not isinstance(data, dict):
        raise ValueError("no JSON object")
    return data

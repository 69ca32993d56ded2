"""Reading the recording of a session: an MCAP file (:mod:`highfive.hil.recording.recorder` writes it)."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from highfive.hil.recording import schemas
from highfive.hil.recording.arrays import message_arrays, message_table
from highfive.hil.recording.decoding import MARKERS, Decoder, say_what_is_left_out
from highfive.hil.recording.mcap_file import McapFile
from highfive.hil.recording.newer_session import tell_of_newer
from highfive.hil.recording.one_recording import one_recording
from highfive.hil.sim.avatar import Pose
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

if TYPE_CHECKING:
    from pandas import DataFrame  # pyright: ignore[reportMissingImports]


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
    """Reads a recording, also one whose end is missing: all of it, some 17 GB of an hour. A folder may hold the file.

    :func:`highfive.hil.recording.session_reader.read_session` takes as much memory as one high five.

    Raises:
        HighFiveError: the folder holds none, or several; there is no such file, it holds no session, or it is of a
            newer version. Other values than the session's are not checked.
    """
    channels: dict[str, list[RecordedMessage]] = {topic: [] for topic in (*schemas.TOPICS, MARKERS)}
    path = one_recording(Path(path))
    tell_of_newer(path)
    messages = recorded_messages(path)
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

    What cannot be read is left out; how much that is, is said in the end.

    Returns:
        whether the file was closed; otherwise its end is missing.

    Raises:
        HighFiveError: there is no such file, it holds no session, or it is of a newer version.
    """
    file, decode, begun = McapFile(path), Decoder(), False
    for place, channel, message in file.messages():
        if (data := decode(place, channel, message)) is None:
            continue
        if not begun and channel.topic == "/session":
            begun = True
            check_session(data, path)
        yield channel.topic, RecordedMessage(message.log_time, data)
    if not begun:
        raise no_session(path)
    say_what_is_left_out(file, decode.malformed)
    return file.ended


def no_session(path: Path) -> HighFiveError:
    """That a file holds no readable ``/session``."""
    return HighFiveError(
        f"{path} is not the recording of a session: no readable MCAP chunk with a /session message in it"
    )


def check_session(about: Mapping[str, Any], path: Path) -> None:
    """That a ``/session`` message says what it has to, and is of no newer format.

    Raises:
        HighFiveError: it does not.
    """
    settings, number = about.get("settings"), about.get("format")
    if isinstance(number, int) and number > schemas.FORMAT:
        versions = settings.get("versions") if isinstance(settings, dict) else None
        by = versions.get("high-five") if isinstance(versions, dict) else None
        raise HighFiveError(
            f"{path} is a recording of format {number}, and this version reads up to {schemas.FORMAT}; open it with "
            f"the version that made it{f' ({by})' if isinstance(by, str) else ''}, or a newer one"
        )
    joints = about.get("joints")
    if not (isinstance(settings, dict) and isinstance(joints, list) and all(isinstance(one, str) for one in joints)):
        raise HighFiveError(f"{path}: /session holds no settings and joints")

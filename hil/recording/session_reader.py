"""A recorded session, a high five at a time: as much of the file is in memory as one of them takes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from highfive.hil.recording.arrays import message_arrays, message_table
from highfive.hil.recording.recording import RecordedMessage, recorded_messages
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from pandas import DataFrame  # pyright: ignore[reportMissingImports]


@dataclass(frozen=True)
class RecordedHighFive:
    """One high five of a recording.

    Attributes:
        number: counted from 0.
        about: its ``/trial`` message: ``emotion``, ``style``, ``cell``, ``utc`` and so on.
        contact: its judgement, ``/contact``; None where it was broken off, or the recording ends before.
        messages: by topic, in order.
    """

    number: int
    about: Mapping[str, Any]
    contact: Mapping[str, Any] | None
    messages: Mapping[str, tuple[RecordedMessage, ...]]

    def arrays(self, topic: str) -> dict[str, NDArray[Any]]:
        """One array per field, (T,) or (T, …); ``time`` is in s from the high five's first tick.

        Raises:
            HighFiveError: it has no such topic.
        """
        if topic not in self.messages:
            raise HighFiveError(f"high five {self.number} has no topic {topic!r}; there are {', '.join(self.messages)}")
        messages, begin = self.messages[topic], self.messages["/trial"][0].time_ns
        return message_arrays([message.time_ns - begin for message in messages], [m.data for m in messages])

    def table(self, topic: str) -> DataFrame:
        """The same as a pandas table, a row a message.

        Raises:
            HighFiveError: it has no such topic, or pandas is not installed.
        """
        return message_table(self.arrays(topic))


class SessionReader:
    """A recording of a session; iterate over it, as often as you like.

    Attributes:
        path: of the file.
        settings: of the session, and the versions that it was recorded with.
        joints: names of the avatar's joints.
    """

    def __init__(self, path: Path | str) -> None:
        """Reads its settings.

        Raises:
            HighFiveError: there is no such file, or it holds no session.
        """
        self.path = Path(path)
        for topic, message in recorded_messages(self.path):
            if topic == "/session":
                self.settings: Mapping[str, Any] = message.data["settings"]
                self.joints: tuple[str, ...] = tuple(message.data["joints"])
                return

    def __iter__(self) -> Iterator[RecordedHighFive]:
        """Its high fives in order, with those that were broken off; one that does not say its number is left out."""
        found: dict[str, list[RecordedMessage]] = {}
        for topic, message in recorded_messages(self.path):
            if topic == "/trial":
                yield from _whole(found)
                found = {}
            found.setdefault(topic, []).append(message)
        yield from _whole(found)


def _whole(found: Mapping[str, list[RecordedMessage]]) -> Iterator[RecordedHighFive]:
    if "/trial" in found and isinstance(found["/trial"][0].data.get("trial"), int):
        about, contact = found["/trial"][0].data, found.get("/contact")
        messages = {topic: tuple(messages) for topic, messages in found.items()}
        yield RecordedHighFive(int(about["trial"]), about, contact[-1].data if contact else None, messages)


def read_session(path: Path | str) -> SessionReader:
    """A recorded session, a high five at a time; also one whose end is missing.

    Raises:
        HighFiveError: there is no such file, or it holds no session.
    """
    return SessionReader(path)

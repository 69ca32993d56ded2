"""A recorded session, a high five at a time: as much of the file is in memory as one of them takes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from numpy.typing import NDArray

from highfive.hil.recording.arrays import message_arrays, message_table
from highfive.hil.recording.decoding import ALL, Decoder, say_what_is_left_out
from highfive.hil.recording.mcap_file import McapFile, Place
from highfive.hil.recording.newer_session import tell_of_newer
from highfive.hil.recording.one_recording import one_recording
from highfive.hil.recording.recording import RecordedMessage, check_session, no_session
from highfive.hil.recording.trial_spans import HEADS, StoredMessage, TrialSpan, high_fives, span_of
from highfive.hil.runtime.console import counted
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from pandas import DataFrame  # pyright: ignore[reportMissingImports]


@dataclass(frozen=True)
class RecordedHighFive:
    """One high five of a recording.

    Attributes:
        span: where in the recording it is, and what is known of it before its messages are read.
        messages: by topic, in order.
    """

    span: TrialSpan
    messages: Mapping[str, tuple[RecordedMessage, ...]]

    def __repr__(self) -> str:
        """What is in it, not the messages themselves: a notebook shows this where nothing else is asked for."""
        counts = ", ".join(f"{topic} {len(found)}" for topic, found in self.messages.items())
        return f"<high five {self.number + 1}: {counts}>"

    @property
    def number(self) -> int:
        """The session's own, counted from 0; one that was broken off has the number of the next."""
        return self.span.number

    @property
    def about(self) -> Mapping[str, Any]:
        """Its ``/trial`` message: ``emotion``, ``style``, ``cell``, ``utc`` and so on; empty if that cannot be read."""
        return self.span.about

    @property
    def contact(self) -> Mapping[str, Any] | None:
        """Its judgement, ``/contact``; None where it was broken off, or the recording ends before."""
        return self.span.contact or None

    def of(self, topic: str) -> tuple[RecordedMessage, ...]:
        """A topic's messages; none where there are none."""
        return self.messages.get(topic, ())

    def arrays(self, topic: str) -> dict[str, NDArray[Any]]:
        """One array per field, (T,) or (T, …); ``time`` is in s from the high five's first tick.

        Raises:
            HighFiveError: it has no such topic.
        """
        if topic not in self.messages:
            raise HighFiveError(
                f"high five {self.number + 1} has no topic {topic!r}; there are {', '.join(self.messages)}"
            )
        messages = self.messages[topic]
        times = [message.time_ns - self.span.start_ns for message in messages]
        return message_arrays(times, [message.data for message in messages])

    def table(self, topic: str) -> DataFrame:
        """The same as a pandas table, a row a message.

        Raises:
            HighFiveError: it has no such topic, or pandas is not installed.
        """
        return message_table(self.arrays(topic))


class SessionReader(Sequence[RecordedHighFive]):
    """A recording of a session: its high fives, with those that were broken off, read as they are asked for.

    The first is ``[0]``. One that does not say its number is left out.

    Attributes:
        path: of the file.
        settings: of the session, and the versions that it was recorded with.
        joints: names of the avatar's joints.
        chain: settings of pose and tracker, by field; None where they were not recorded.
    """

    def __init__(self, path: Path | str) -> None:
        """Reads its settings.

        Raises:
            HighFiveError: there is no such file, it holds no session, or it is of a newer version.
        """
        self.path = one_recording(Path(path))
        tell_of_newer(self.path)
        self._file, self._malformed, self._said = McapFile(self.path), set[Place](), (0, 0)
        decode = Decoder(("/session",))
        for found in self._file.messages():
            if (about := decode(*found)) is not None:
                check_session(about, self.path)
                self.settings: Mapping[str, Any] = about["settings"]
                self.joints: tuple[str, ...] = tuple(about["joints"])
                chain = about.get("chain")
                self.chain: Mapping[str, Any] | None = chain if isinstance(chain, dict) else None
                return
        raise no_session(self.path)

    @cached_property
    def spans(self) -> tuple[TrialSpan, ...]:
        """Its high fives in order, without their messages: the file is read once through for them."""
        decode, spans = Decoder(HEADS), list[TrialSpan | None]()
        known = decode.names, dict(decode.labels)
        for found in high_fives(self._stored(decode)):
            # By now the first message of the next one is decoded, which is its /trial.
            before, known = known, (decode.names, dict(decode.labels))
            spans.append(span_of(found, *before))
        return tuple(span for span in spans if span is not None)

    @property
    def complete(self) -> bool:
        """It was closed; otherwise its end is missing, and there is what comes before."""
        _ = self.spans  # reads it once through
        return self._file.ended

    def read(self, span: TrialSpan, topics: Collection[str] = ALL) -> RecordedHighFive:
        """One of its high fives, with the messages of some topics."""
        decode = Decoder(topics, span.names, span.labels)
        messages: dict[str, list[RecordedMessage]] = {}
        for place, channel, message in self._file.messages(span.first[0]):
            if place > span.last:
                break
            if place >= span.first and (data := decode(place, channel, message)) is not None:
                messages.setdefault(channel.topic, []).append(RecordedMessage(message.log_time, data))
        self._say(decode)
        return RecordedHighFive(span, {topic: tuple(found) for topic, found in messages.items()})

    def __repr__(self) -> str:
        """Where it is, and how many high fives are in it."""
        return f"<{self.path}: {counted(len(self), 'high five')}>"

    def __len__(self) -> int:
        """Of its high fives."""
        return len(self.spans)

    @overload
    def __getitem__(self, place: int) -> RecordedHighFive: ...
    @overload
    def __getitem__(self, place: slice) -> list[RecordedHighFive]: ...
    def __getitem__(self, place: int | slice) -> RecordedHighFive | list[RecordedHighFive]:
        """The high five at a place, the first at 0."""
        if isinstance(place, slice):
            return [self.read(span) for span in self.spans[place]]
        return self.read(self.spans[place])

    def __iter__(self) -> Iterator[RecordedHighFive]:
        """One after the other; as often as you like."""
        return (self.read(span) for span in self.spans)

    def _stored(self, decode: Decoder) -> Iterator[StoredMessage]:
        for place, channel, message in self._file.messages():
            data = decode(place, channel, message)
            if data is not None or channel.topic not in HEADS:
                yield StoredMessage(channel.topic, message.log_time, data or {}, place)
        self._say(decode)

    def _say(self, decode: Decoder) -> None:
        """What is left out, of which nothing was said yet."""
        self._malformed |= decode.malformed
        if (found := (len(self._malformed), len(self._file.damaged))) != self._said:
            say_what_is_left_out(self._file, self._malformed, self._said)
            self._said = found


def read_session(path: Path | str) -> SessionReader:
    """A recorded session, a high five at a time; also one whose end is missing. ``path`` may be a folder with one.

    Raises:
        HighFiveError: the folder holds none, or several; there is no such file, it holds no session, or it is of a
            newer version.
    """
    return SessionReader(path)

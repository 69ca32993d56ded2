"""Where each high five of a recording begins and ends."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any

from highfive.hil.recording.recording import RecordedMessage, SessionRecording
from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class TrialSpan:
    """One high five.

    Attributes:
        number: the recording's own, as in a session's figures.
        start_ns, end_ns: its first and its last tick.
        about: its ``/trial`` message; empty where there is none.
        contact: its ``/contact`` message; empty where it was not judged.
    """

    number: int
    start_ns: int
    end_ns: int
    about: dict[str, Any]
    contact: dict[str, Any]

    def text(self, name: str) -> str:
        """What ``/trial`` says of it (``emotion``, ``style``, ``cell``, ``title``); '' where it says nothing."""
        value = self.about.get(name)
        return value if isinstance(value, str) else ""


def trial_spans(recording: SessionRecording) -> tuple[TrialSpan, ...]:
    """The high fives, in the order in which they were played: ticks of one number that follow each other.

    Raises:
        HighFiveError: ticks say of no high five which one it is.
    """
    about, contacts = _by_number(recording.channels["/trial"]), _by_number(recording.channels["/contact"])
    spans = []
    for number, ticks in groupby(recording.channels["/tick"], key=_number):
        if number is None:
            raise HighFiveError("the recording is of another version: its ticks do not say of which trial they are")
        times = [tick.time_ns for tick in ticks]
        spans.append(TrialSpan(number, times[0], times[-1], about.get(number, {}), contacts.get(number, {})))
    return tuple(spans)


def _by_number(messages: tuple[RecordedMessage, ...]) -> dict[int | None, dict[str, Any]]:
    return {_number(message): message.data for message in messages}


def _number(message: RecordedMessage) -> int | None:
    value = message.data.get("trial") if isinstance(message.data, dict) else None
    return value if isinstance(value, int) else None

"""Where each high five of a recording begins and ends."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from highfive.hil.recording.recording import RecordedMessage, SessionRecording
from highfive.model.errors import HighFiveError

PAUSE_NS = 900_000_000
"""Between ticks, from which on another attempt begins: one that was broken off has the number of the one after it."""


@dataclass(frozen=True)
class TrialSpan:
    """One high five.

    Attributes:
        number: the recording's own, as in a session's figures.
        start_ns, end_ns: its first and its last tick.
        about: its ``/trial`` message; empty where there is none.
        contact: its ``/contact`` message; empty where it was not judged, as where it was broken off.
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
    runs = _runs(recording.channels["/tick"], {message.time_ns for message in recording.channels["/trial"]})
    starts: list[int | None] = [ticks[0].time_ns for _, ticks in runs]
    spans = []
    for (number, ticks), end in zip(runs, [*starts, None][1:], strict=True):
        start = ticks[0].time_ns
        about = _last_of(recording.channels["/trial"], number, None, end)
        contact = _last_of(recording.channels["/contact"], number, start, end)
        spans.append(TrialSpan(number, start, ticks[-1].time_ns, about, contact))
    return tuple(spans)


def _runs(ticks: Sequence[RecordedMessage], begins_ns: Collection[int]) -> list[tuple[int, list[RecordedMessage]]]:
    """Ticks of one number, with neither a pause between them nor the beginning of another high five."""
    runs: list[tuple[int, list[RecordedMessage]]] = []
    for tick in ticks:
        number = _number(tick)
        if number is None:
            raise HighFiveError("the recording is of another version: its ticks do not say of which trial they are")
        goes_on = runs and runs[-1][0] == number and tick.time_ns - runs[-1][1][-1].time_ns < PAUSE_NS
        if goes_on and tick.time_ns not in begins_ns:
            runs[-1][1].append(tick)
        else:
            runs.append((number, [tick]))
    return runs


def _last_of(messages: Sequence[RecordedMessage], number: int, start: int | None, end: int | None) -> dict[str, Any]:
    """The last message of a number from ``start`` on and before ``end``, ns; empty if there is none."""
    found = [
        message.data
        for message in messages
        if _number(message) == number
        and (start is None or message.time_ns >= start)
        and (end is None or message.time_ns < end)
    ]
    return found[-1] if found else {}


def _number(message: RecordedMessage) -> int | None:
    value = message.data.get("trial") if isinstance(message.data, dict) else None
    return value if isinstance(value, int) else None

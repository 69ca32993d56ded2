"""Where each high five of a recording begins and ends: the one rule of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from highfive.hil.recording.mcap_file import Place

HEADS = ("/session", "/trial", "/tick", "/contact", "/event")
"""Topics that say where high fives are, and of which kind."""


@dataclass(frozen=True)
class StoredMessage:
    """A message and its place in the file; ``data`` is empty where it was not asked for."""

    topic: str
    time_ns: int
    data: Mapping[str, Any]
    place: Place

    @property
    def number(self) -> int | None:
        """Of the high five that it says to be of."""
        value = self.data.get("trial")
        return value if type(value) is int else None


@dataclass(frozen=True, eq=False)
class TrialSpan:
    """One high five; one is the same as itself alone.

    Attributes:
        number: the recording's own, from 0, as in a session's figures.
        start_ns, end_ns: its first and its last tick.
        about: its ``/trial`` message; empty where there is none, or it cannot be read.
        contact: its ``/contact`` message; empty where it was not judged, as where it was broken off.
        broken_off: it was not played to its end.
        ticks: times at which tick, person and avatar were recorded.
        topics: on which it has messages.
        first, last: places of its first and last message.
        names, labels: what is to be known when its messages are decoded.
    """

    number: int
    start_ns: int
    end_ns: int
    about: Mapping[str, Any]
    contact: Mapping[str, Any]
    broken_off: bool
    ticks: int
    topics: frozenset[str]
    first: Place
    last: Place
    names: tuple[str, ...] = ()
    labels: Mapping[str, list[str]] | None = None

    @property
    def lacking(self) -> str:
        """Why avatar and person cannot be shown, where they have next to no ticks in common."""
        missing = [topic for topic in ("/tick", "/person", "/avatar") if topic not in self.topics]
        return f"{' and '.join(missing)} not recorded" if missing else "too few ticks of avatar and person together"

    def text(self, name: str) -> str:
        """What ``/trial`` says of it (``emotion``, ``style``, ``cell``, ``title``); '' where it says nothing.

        The style is the one by which it was judged: in which palms met, or in which it ended where they did not.
        """
        value = (self.contact.get(name) if name == "style" else None) or self.about.get(name)
        return value if isinstance(value, str) else ""


def high_fives(messages: Iterable[StoredMessage]) -> Iterator[list[StoredMessage]]:
    """The messages of each high five; of the first are those before it, too: nobody knew yet what they would be of.

    A high five begins with its ``/trial``, and where that is missing (an older recording, a damaged chunk) with the
    first tick of another number and what was recorded at the same time. All that follows in the file is of it, until
    the next begins.
    """
    found: list[StoredMessage] = []
    begun, number = False, None
    for message in messages:
        if message.topic == "/trial":
            if begun or _has_ticks(found):
                yield found
                found = []
            begun, number = True, message.number
        elif message.topic == "/tick" and message.number is not None:
            if (number is not None and message.number != number) or (number is None and _has_ticks(found)):
                yield [one for one in found if one.time_ns < message.time_ns]
                found = [one for one in found if one.time_ns >= message.time_ns]
            number = message.number
        found.append(message)
    yield found


def _has_ticks(found: Sequence[StoredMessage]) -> bool:
    return any(one.topic == "/tick" for one in found)


def span_of(
    found: Sequence[StoredMessage], names: tuple[str, ...] = (), labels: Mapping[str, list[str]] | None = None
) -> TrialSpan | None:
    """Of the messages of one high five; None where neither ``/trial`` nor a tick says its number."""
    heads = [one for one in found if one.topic == "/trial"]
    ticks = [one for one in found if one.topic == "/tick"]
    number = next((one.number for one in (*heads, *ticks) if one.number is not None), None)
    if number is None:
        return None
    times = [{one.time_ns for one in found if one.topic == topic} for topic in ("/tick", "/person", "/avatar")]
    judged = [one.data for one in found if one.topic == "/contact" and one.number in (number, None)]
    ends = [one for one in found if one.topic == "/event" and one.data.get("event") == "trial_broken_off"]
    played = ticks or heads
    return TrialSpan(
        number=number,
        start_ns=played[0].time_ns,
        end_ns=played[-1].time_ns,
        about=heads[0].data if heads else {},
        contact=judged[-1] if judged else {},
        broken_off=not judged and any(one.number in (number, None) for one in ends),
        ticks=len(times[0] & times[1] & times[2]),
        topics=frozenset(one.topic for one in found),
        first=found[0].place,
        last=found[-1].place,
        names=names,
        labels=labels,
    )

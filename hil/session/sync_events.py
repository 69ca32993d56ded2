"""What happens to streams: each is told once, in one line, to whoever records it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any


class Happened(Enum):
    """What an event says."""

    RESYNCHRONISED = "resynchronised"
    STOPPED = "stopped"
    RESUMED = "resumed"
    BACK = "went back"
    RATE = "changed its rate"
    LAYOUT = "changed its channels"
    UNIT = "counts in another unit"
    ASTRAY = "is of another time"


@dataclass(frozen=True)
class SyncEvent:
    """Something that happened to a stream.

    Attributes:
        happened: what.
        stream: its name.
        time_ns: when it was found, by this computer's clock.
        text: one line for people.
        moved_ns: by how much the time of the stream moved, where it did.
    """

    happened: Happened
    stream: str
    time_ns: int
    text: str
    moved_ns: int = 0

    def record(self) -> dict[str, Any]:
        """For a recording: the event's name and what it says."""
        return {
            "event": self.happened.value, "stream": self.stream, "text": self.text, "moved_ms": 1e-6 * self.moved_ns,
        }  # fmt: skip


Told = Callable[[SyncEvent], None]
"""Is told of each event, in the thread that finds it: a receiver's or the tick's. It must neither wait nor raise."""

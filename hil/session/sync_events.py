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

    def about(self) -> dict[str, Any]:
        """What a recording's ``/event`` says of it beside its name; ``moved_ms`` where its time moved."""
        moved = {"moved_ms": round(1e-6 * self.moved_ns, 6)} if self.moved_ns else {}
        return {"stream": self.stream, "detail": self.text, **moved}


Told = Callable[[SyncEvent], None]
"""Is told of each event, in the thread that finds it: a receiver's or the tick's. It must neither wait nor raise."""

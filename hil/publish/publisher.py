"""What a publisher is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.session.shown import Shown
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class SessionEvent:
    """Something happened.

    Attributes:
        name: as in the recording: ``session_start``, ``trial_start``, ``contact``, …
        at_ns: when, ns on the session's clock.
        about: ``trial``, ``emotion``, ``style``, ``detail``, as far as there are such.
    """

    name: str
    at_ns: int
    about: Mapping[str, Any] = field(default_factory=dict)

    def record(self) -> dict[str, Any]:
        """As JSON; what is not known is left out."""
        return {"event": self.name, **{name: value for name, value in self.about.items() if value is not None}}


@dataclass(frozen=True)
class ShownPicture:
    """A picture that a page or headset says it has shown.

    Attributes:
        page: its number.
        shown: which picture, and when.
        bound_ns: how far off the page's clock may be.
    """

    page: int
    shown: Shown
    bound_ns: int


@dataclass(frozen=True)
class ArmPosture:
    """Where a servo arm is.

    Attributes:
        time_ns: when that was measured, ns on the session's clock.
        joints: (J,) rad.
    """

    time_ns: int
    joints: Array


News = RecordedTick | SessionEvent | ShownPicture | ArmPosture
"""What a publisher is given."""


class Publisher(Protocol):
    """Sends a session on. All but its construction happens in one thread of its own; nothing of it waits for whoever
    listens.
    """

    @property
    def name(self) -> str:
        """In a line to the user."""
        ...

    @property
    def waiting(self) -> int:
        """Ticks that may wait to be sent; of more the oldest is left out."""
        ...

    def tick(self, tick: RecordedTick) -> None:
        """A tick."""
        ...

    def event(self, event: SessionEvent) -> None:
        """An event."""
        ...

    def shown(self, picture: ShownPicture) -> None:
        """A picture that was shown."""
        ...

    def arm(self, posture: ArmPosture) -> None:
        """The servo arm, as often as a recording draws it."""
        ...

    def close(self) -> None:
        """No more comes; may be called when it has failed, too."""
        ...

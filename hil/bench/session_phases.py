"""When the parts of a session under faults began, and who waits for that. In virtual time."""

from __future__ import annotations

from dataclasses import dataclass

from highfive.hil.bench.fault_schedule import Happening
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler


@dataclass(frozen=True)
class Occurrence:
    """A happening that came to pass.

    Attributes:
        happening: what.
        at_ns: when, on the clock.
        until_ns: its end; ``at_ns`` of an instant or of what stays.
    """

    happening: Happening
    at_ns: int
    until_ns: int


class SessionPhases:
    """The times at which phases began."""

    def __init__(self, clock: VirtualClock) -> None:
        """None has begun."""
        self._clock, self._begun, self._over = clock, dict[str, int](), False
        self._changed = VirtualScheduler(clock).condition()

    def begin(self, phase: str) -> None:
        """Now."""
        self._begun[phase] = self._clock.now()
        self._changed.notify_all()

    def begun(self, phase: str) -> int | None:
        """When it began, ns; None for not yet."""
        return self._begun.get(phase)

    def end(self) -> None:
        """The session is over: no other phase begins."""
        self._over = True
        self._changed.notify_all()

    def wait(self, phase: str) -> int | None:
        """When it began, once it has; None where it never does."""
        self._changed.wait_for(lambda: self._over or phase in self._begun)
        return self.begun(phase)

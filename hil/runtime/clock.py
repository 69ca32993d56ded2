"""Time as a value: what a loop asks for the time, and waits by.

There are two clocks: the machine's (:data:`MACHINE`), and a virtual one
(:class:`highfive.hil.runtime.virtual_clock.VirtualClock`) under which all parts of a rig run in one process, one at a
time, in the order of their times. The same code runs under both.
"""

from __future__ import annotations

import select
import time
from typing import Protocol


class Event(Protocol):
    """What can be waited for: an emergency stop, bytes on a line."""

    def fileno(self) -> int:
        """Readable once it has happened: what the machine's clock waits for."""
        ...

    @property
    def due_ns(self) -> int | None:
        """When it happened, or will of its own accord, ns: what a virtual clock waits for; None where nobody knows."""
        ...


class Clock(Protocol):
    """Monotonic time, ns, and ways to let it pass."""

    def now(self) -> int:
        """ns"""
        ...

    def wait_until(self, time_ns: int) -> None:
        """Returns at that time, or at once if it is over."""
        ...

    def wait_for(self, event: Event, until_ns: int) -> bool:
        """Returns once ``event`` has happened, at the latest at ``until_ns``. Has it?"""
        ...


class MachineClock:
    """The computer's monotonic clock, one for all of its processes."""

    def now(self) -> int:
        """ns"""
        return time.monotonic_ns()

    def wait_until(self, time_ns: int) -> None:
        """Sleeps until then."""
        left = time_ns - time.monotonic_ns()
        if left > 0:
            time.sleep(1e-9 * left)

    def wait_for(self, event: Event, until_ns: int) -> bool:
        """Sleeps until the system says that there is something to read, or until then."""
        left = max(0, until_ns - time.monotonic_ns())
        return bool(select.select([event], [], [], 1e-9 * left)[0])


MACHINE = MachineClock()
"""The one that is used where no other is passed."""


def utc_ns() -> int:
    """ns since 1970: when in the day a recording was made. Nothing goes by it: it may be set."""
    return time.time_ns()

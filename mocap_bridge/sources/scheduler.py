"""What a source runs by: the time, and tasks beside whoever reads it. Threads, unless another is passed.

The other is virtual time, where tasks run one at a time in the order of their times
(:class:`highfive.hil.runtime.virtual_scheduler.VirtualScheduler`).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Protocol


class Condition(Protocol):
    """What tasks wait for and wake each other by; see ``threading.Condition``."""

    def __enter__(self) -> object:
        """Nobody else is in here meanwhile."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> object:
        """Lets the others in."""
        ...

    def wait_for(self, predicate: Callable[[], bool], timeout: float | None = None) -> bool:
        """Waits until ``predicate`` holds, which is looked at whenever it was notified, for so many s at most."""
        ...

    def notify_all(self) -> None:
        """Wakes all that wait."""
        ...


class Task(Protocol):
    """What was started."""

    def join(self, timeout: float | None = None) -> object:
        """Waits until it has ended, for so many s at most."""
        ...


class Scheduler(Protocol):
    """Time, and what runs beside the caller."""

    def now(self) -> int:
        """Monotonic time, ns."""
        ...

    def condition(self) -> Condition:
        """A new one."""
        ...

    def start(self, name: str, run: Callable[[], object]) -> Task:
        """Runs that beside the caller."""
        ...


class ThreadScheduler:
    """Threads, by the machine's monotonic clock. They do not keep the program from ending."""

    def now(self) -> int:
        """ns"""
        return time.monotonic_ns()

    def condition(self) -> Condition:
        """A new one."""
        return threading.Condition()

    def start(self, name: str, run: Callable[[], object]) -> Task:
        """Runs that in a thread."""
        thread = threading.Thread(target=run, name=name, daemon=True)
        thread.start()
        return thread


THREADS = ThreadScheduler()
"""The one that is used where no other is passed."""

Now = Callable[[], int]
"""A monotonic clock, ns: a scheduler's ``now``."""


def in_seconds(now: Now) -> Callable[[], float]:
    """That clock, s."""
    return lambda: 1e-9 * now()

"""Tasks in virtual time for what would run in threads: see :mod:`highfive.mocap_bridge.sources.scheduler`."""

from __future__ import annotations

from collections.abc import Callable

from highfive.hil.runtime.virtual_clock import VirtualClock, VirtualTask

_FOR_EVER_NS = 10**18


class VirtualScheduler:
    """Starts tasks of a virtual clock.

    Attributes:
        tasks: those that were started, for who lets something happen to the process that they belong to.
    """

    def __init__(self, clock: VirtualClock) -> None:
        """By that clock."""
        self._clock = clock
        self.tasks: list[VirtualTask] = []

    def now(self) -> int:
        """ns"""
        return self._clock.now()

    def condition(self) -> VirtualCondition:
        """A new one."""
        return VirtualCondition(self._clock)

    def start(self, name: str, run: Callable[[], object]) -> StartedTask:
        """A task that begins once the others wait."""
        started = StartedTask(self._clock, name, run)
        self.tasks.append(started.task)
        return started


class VirtualCondition:
    """``threading.Condition`` in virtual time; whoever is within may wait for nothing else."""

    def __init__(self, clock: VirtualClock) -> None:
        """Nobody waits."""
        self._clock = clock
        self._waiting: list[_Notice] = []

    def __enter__(self) -> VirtualCondition:
        """Others do not run anyway."""
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing was locked."""

    def wait_for(self, predicate: Callable[[], bool], timeout: float | None = None) -> bool:
        """Lets the others go on until ``predicate`` holds, for so many s at most."""
        until = self._clock.now() + (_FOR_EVER_NS if timeout is None else round(1e9 * timeout))
        while not (found := predicate()) and self._clock.now() < until:
            notice = _Notice()
            self._waiting.append(notice)
            try:
                self._clock.wait_for(notice, until)
            finally:
                self._waiting.remove(notice)
        return found

    def notify_all(self) -> None:
        """Wakes all that wait."""
        for notice in self._waiting:
            notice.due_ns = 0


class _Notice:
    """That one who waits was notified."""

    due_ns: int | None = None

    def fileno(self) -> int:
        """There is none: only a virtual clock waits for it."""
        raise OSError


class StartedTask:
    """A task whose end can be waited for.

    Attributes:
        task: of the clock.
    """

    def __init__(self, clock: VirtualClock, name: str, run: Callable[[], object]) -> None:
        """Started."""
        self._changed, self._ended = VirtualCondition(clock), False
        self.task = clock.start(name, run)
        self.task.at_end = self._end

    def join(self, timeout: float | None = None) -> None:
        """Waits until it has ended, for so many s at most."""
        self._changed.wait_for(lambda: self._ended, timeout)

    def _end(self) -> None:
        self._ended = True
        self._changed.notify_all()

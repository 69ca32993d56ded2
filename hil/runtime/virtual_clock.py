"""Virtual time: tasks of one process run one at a time, in the order of the times that they wait for.

This is deterministic simulation as FoundationDB and TigerBeetle are tested by: what runs is the program itself, and a
seed decides what is left to chance. Tasks are greenlets, so that code that blocks (the servo maker's SDK, too) runs
unchanged. Computing takes no time, but for :data:`LOOK_NS` a look at the clock and what :meth:`VirtualClock.spend`
says.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType

import numpy as np
from greenlet import greenlet

from highfive.hil.runtime.clock import Event

LOOK_NS = 1_000
"""A look at the clock takes so long, ns: who polls gets on."""

START_NS = 1_000_000_000
"""When time begins: 0 means never in much of what is measured by the clock."""


class TaskKilled(BaseException):
    """Raised in a task that was killed, wherever it waits. No ``except Exception`` holds it up."""


class VirtualTask:
    """What runs in virtual time.

    Attributes:
        name: for messages.
        error: what ended it, if anything did but its own end or a kill.
        at_end: is called as it ends, also where it was killed before it began.
    """

    def __init__(self, name: str, run: greenlet) -> None:
        """Not begun."""
        self.name, self.run = name, run
        self.event: Event | None = None
        self.until = 0
        self.order = 0.0
        self._held_until = 0
        self._killed = False
        self._interrupt: BaseException | None = None
        self.error: BaseException | None = None
        self.at_end: Callable[[], object] = lambda: None
        self.looks_left = 0
        self._call: Callable[[], object] | None = None

    @property
    def alive(self) -> bool:
        """It has not ended."""
        return not self.run.dead and not self._killed

    @property
    def killed(self) -> bool:
        """It does no more than leave."""
        return self._killed

    def kill(self) -> None:
        """Ends it where it waits, as SIGKILL does: nothing that it would do on its way out gets through a wait, or past
        a look at the clock."""
        self._killed = True

    def interrupt(self, error: BaseException) -> None:
        """Raises ``error`` where it waits, as a signal's handler does."""
        self._interrupt = error

    def after_looks(self, looks: int, call: Callable[[], object]) -> None:
        """Has ``call`` happen when this task has looked at the clock so often (1 or more): in the midst of what it
        does between two waits, where :meth:`kill` and :meth:`interrupt` then take effect."""
        self.looks_left, self._call = looks, call

    def looked(self) -> None:
        """Called in the task at each look while :attr:`looks_left`.

        Raises:
            TaskKilled: it was killed at this one; or the error by which it was interrupted.
        """
        self.looks_left -= 1
        if not self.looks_left and self._call is not None:
            self._call()
            self.resumed()

    def hold(self, until_ns: int) -> None:
        """Keeps it from going on before then, as a machine that stands still does."""
        self._held_until = max(self._held_until, until_ns)

    def wake_ns(self) -> int:
        """When it goes on, as far as is known now."""
        if self._killed:
            return 0
        wake = self.until if self._interrupt is None else 0
        if self.event is not None and (due := self.event.due_ns) is not None and due < wake:
            wake = due
        return wake if wake > self._held_until else self._held_until

    def resumed(self) -> None:
        """Called in the task after a wait.

        Raises:
            TaskKilled: it was killed.
        """
        if self._killed:
            raise TaskKilled
        if self._interrupt is not None:
            error, self._interrupt = self._interrupt, None
            raise error


class VirtualClock:
    """A clock that stands still until every task waits; then it is the time of the one that waits the shortest.

    Whoever makes it is its first task. Of tasks that wait for one time a seeded draw decides who goes first. At the end
    of its context all tasks but the first are killed.
    """

    def __init__(self, seed: int = 0) -> None:
        """At :data:`START_NS`."""
        self._now = START_NS
        self._rng = np.random.default_rng(seed)
        self._tasks = [VirtualTask("main", greenlet.getcurrent())]
        self._running = self._tasks[0]
        self._after_an_end = greenlet(self._go_on)

    @property
    def first(self) -> VirtualTask:
        """Whoever made the clock."""
        return self._tasks[0]

    def __enter__(self) -> VirtualClock:
        """Runs already."""
        return self

    def __exit__(self, *_: object) -> None:
        """Kills the tasks that are left; what would interrupt the first meanwhile is raised once they are."""
        first = self.first
        interrupt, first._interrupt, first._killed = first._interrupt, None, False
        for task in self._tasks[1:]:
            task.kill()
        while len(self._tasks) > 1:
            try:
                self._wait(None, self._now)
            except BaseException as error:  # a signal came upon the first
                interrupt = interrupt or error
        if interrupt is not None:
            raise interrupt

    def now(self) -> int:
        """ns"""
        self._now += LOOK_NS
        if self._running.killed:
            raise TaskKilled
        if self._running.looks_left:
            self._running.looked()
        return self._now

    def wait_until(self, time_ns: int) -> None:
        """Lets the others go on until then."""
        self._wait(None, time_ns)

    def wait_for(self, event: Event, until_ns: int) -> bool:
        """Lets the others go on until ``event`` has happened, at the latest until then. Has it?"""
        self._wait(event, until_ns)
        return event.due_ns is not None and event.due_ns <= self._now

    def spend(self, nanoseconds: int) -> None:
        """What the caller computes takes so long."""
        self._wait(None, self._now + nanoseconds)

    @contextmanager
    def signals_to_first(self, numbers: Iterable[signal.Signals]) -> Iterator[None]:
        """In here what a signal's handler raises is raised in the first task, whichever one the signal came upon."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        first = self.first
        before = {number: handler for number in numbers if callable(handler := signal.getsignal(number))}

        def handle(number: int, frame: FrameType | None) -> None:
            try:
                before[signal.Signals(number)](number, frame)
            except BaseException as error:
                if first.run is greenlet.getcurrent():
                    raise
                first.interrupt(error)

        for number in before:
            signal.signal(number, handle)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def start(self, name: str, call: Callable[[], object]) -> VirtualTask:
        """A task that begins once the others wait."""

        def run(*_: object) -> None:
            try:
                task.resumed()
                call()
            except TaskKilled:
                pass
            except BaseException as error:  # whoever waits for the task is told
                task.error = error
            self._tasks.remove(task)
            task.at_end()

        task = VirtualTask(name, greenlet(run, self._after_an_end))
        task.until, task.order = self._now, self._rng.random()
        self._tasks.append(task)
        return task

    def _go_on(self, *_: object) -> None:
        """Where a task goes that has ended."""
        while True:
            self._next().run.switch()

    def _wait(self, event: Event | None, until: int) -> None:
        task = self._running
        task.resumed()
        task.event, task.until, task.order = event, max(until, self._now), self._rng.random()
        following = self._next()
        if following is not task:
            following.run.switch()
        task.event = None
        task.resumed()

    def _next(self) -> VirtualTask:
        """The task that goes on next, to which whoever asks switches; it is its time."""
        now, found, first = self._now, None, 0
        for task in self._tasks:
            wake = task.wake_ns()
            wake = wake if wake > now else now
            if found is None or wake < first or (wake == first and task.order < found.order):
                found, first = task, wake
        assert found is not None
        self._now, self._running = first, found
        return found

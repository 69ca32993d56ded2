"""Records a session that keeps time in a thread of its own: neither encoding nor a disk that is slow, or hangs, holds a
tick up.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.recording.recorder import SessionRecorder, TrialHead
from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import LOGGER, counted, say_aside
from highfive.hil.session.shown import Shown
from highfive.hil.session.stream import StreamState
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.arm.loop import ArmTick
    from highfive.hil.drivers.bus.cycle_ring import Cycle

WAITING = 4096
"""Calls that may wait to be written: at two calls a tick, 17 s of a session at 120 Hz."""
RESERVE = 4096
"""So many more of those without which the rest says little: where a high five begins and how it ended, events, log."""
SAFE_NS = 750_000_000
"""What no whole chunk holds after so long is written all the same: between high fives nothing else cuts them, and a
kill loses a second at the most."""
PATIENCE_NS = 5_000_000_000
"""At its end a session waits for a disk as long as something gets done; after so long without that, no more."""
_LOOK_S = 0.05


class BackgroundRecorder:
    """What :class:`SessionRecorder` does: later, or, where the session keeps no time, at once. Close it, or use it in
    ``with``.

    A recording that cannot be written any more ends; the session goes on, and is told once.

    Attributes:
        trouble: why no more is recorded, in one line; '' as long as it is.
        lost: calls that were left out because the disk was too slow; only of a session that keeps time.
    """

    def __init__(self, recorder: SessionRecorder, *, paced: bool, clock: Clock = MACHINE) -> None:
        """Begins.

        Args:
            recorder: which nobody else uses from now on.
            paced: the session keeps time: rather than wait, it leaves out.
            clock: by which that thread waits.
        """
        self._recorder, self._clock = recorder, clock
        self.trouble, self.lost = "", 0
        self._said = False  # that there is something lost
        self._calls: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._done = 0  # calls, by the thread
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True) if paced else None
        if self._thread is not None:
            self._thread.start()

    def begin_trial(self, head: TrialHead) -> None:
        """See :meth:`SessionRecorder.begin_trial`."""
        self._give(lambda: self._recorder.begin_trial(head), always=True)

    def record_tick(self, tick: RecordedTick) -> None:
        """See :meth:`SessionRecorder.record_tick`."""
        self._give(lambda: self._recorder.record_tick(tick))
        if self.lost and not self._said:  # not where it is lost: there whoever says it may hold a lock that this needs
            self._said = True
            say_aside("the disk is too slow: parts of the recording are left out from now on", logging.WARNING)

    def record_arm(self, ticks: Sequence[ArmTick], cycles: Sequence[Cycle]) -> None:
        """See :meth:`SessionRecorder.record_arm`."""
        self._give(lambda: self._recorder.record_arm(ticks, cycles))

    def begin_played(self, at_ns: int) -> None:
        """See :meth:`SessionRecorder.begin_played`."""
        self._give(lambda: self._recorder.begin_played(at_ns), always=True)

    def end_trial(self, result: TrialResult) -> None:
        """See :meth:`SessionRecorder.end_trial`."""
        self._give(lambda: self._recorder.end_trial(result), always=True)

    def record_event(self, event: str, at_ns: int | None = None, **about: Any) -> None:
        """See :meth:`SessionRecorder.record_event`."""
        self._give(lambda: self._recorder.record_event(event, at_ns, **about), always=True)

    def record_shown(self, page: int, shown: Shown, bound_ns: int) -> None:
        """See :meth:`SessionRecorder.record_shown`."""
        self._give(lambda: self._recorder.record_shown(page, shown, bound_ns))

    def record_stream(self, samples: StreamSamples) -> None:
        """See :meth:`SessionRecorder.record_stream`; the first ones of a stream, which name its channels, always."""
        self._give(lambda: self._recorder.record_stream(samples), always=samples.begins)

    def record_streams(self, states: Sequence[StreamState], at_ns: int) -> None:
        """See :meth:`SessionRecorder.record_streams`."""
        self._give(lambda: self._recorder.record_streams(states, at_ns))

    def record_log(self, level: str, text: str) -> None:
        """See :meth:`SessionRecorder.record_log`."""
        self._give(lambda: self._recorder.record_log(level, text), always=True)

    def close(self) -> None:
        """Returns once all is written, or after :data:`PATIENCE_NS` in which nothing was."""
        if not self._stop():
            return
        try:
            self._recorder.close()
        except HighFiveError as error:
            self.trouble = str(error)
            say_aside(f"{error}; the end of the session is not recorded", logging.WARNING)

    def discard(self) -> None:
        """Leaves nothing of this recording, where the disk answers; what comes after that is of none."""
        if self._stop():
            self._recorder.discard()
            self.trouble = f"nothing is kept of the recording {self._recorder.path}"

    def __enter__(self) -> BackgroundRecorder:
        """Self."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes."""
        self.close()

    def _give(self, call: Callable[[], None], *, always: bool = False) -> None:
        if self.trouble:  # what is said of it comes from the thread that would have to make room
            return
        if self._thread is None:
            self._do(call)
            return
        if self._calls.qsize() >= WAITING + always * RESERVE:
            self.lost += 1
        else:
            self._calls.put(call)

    def _stop(self) -> bool:
        """Whether the recorder is free again: its thread has done all that was given."""
        if self._thread is not None:
            self._calls.put(None)
            if not self._joined(self._thread):
                self.trouble = (
                    f"the disk under {self._recorder.path} has not answered for {1e-9 * PATIENCE_NS:g} s: "
                    f"the recording lacks {counted(self._calls.qsize() + self.lost, 'part')}; what it held until then "
                    "can be read"
                )
                say_aside(self.trouble, logging.WARNING)
                return False
            self._thread = None
        if self.lost:
            say_aside(f"the disk was too slow: the recording lacks {counted(self.lost, 'part')}", logging.WARNING)
            self.lost = 0
        return True

    def _joined(self, thread: threading.Thread) -> bool:
        """The thread has ended; not where it does nothing for too long."""
        done, since = self._done, self._clock.now()
        while thread.is_alive() and self._clock.now() - since < PATIENCE_NS:
            thread.join(_LOOK_S)
            if self._done != done:
                done, since = self._done, self._clock.now()
        return not thread.is_alive()

    def _run(self) -> None:
        since_ns: int | None = None  # when the oldest of what no chunk holds yet was recorded
        while (call := self._next(since_ns)) is not None:
            begun_ns = self._clock.now()
            self._do(call)
            self._done += 1
            since_ns = None if self._recorder.safe or self.trouble else since_ns or begun_ns

    def _next(self, since_ns: int | None) -> Callable[[], None] | None:
        """What is to be done next; None where nothing comes any more."""
        if since_ns is None:
            return self._calls.get()
        left_ns = since_ns + SAFE_NS - self._clock.now()
        try:
            return self._calls.get(timeout=1e-9 * left_ns) if left_ns > 0 else self._recorder.make_safe
        except Empty:
            return self._recorder.make_safe

    def _do(self, call: Callable[[], None]) -> None:
        if self.trouble:
            return
        try:
            call()
        except HighFiveError as error:
            if self.trouble:  # it hung until now, and that was said
                return
            self.trouble = str(error)
            say_aside(f"{error}; no more is recorded", logging.WARNING)


class KeepsLog(Protocol):
    """What is said to the user goes there."""

    def record_log(self, level: str, text: str) -> None:
        """See :meth:`SessionRecorder.record_log`."""
        ...


class _Said(logging.Handler):
    """Hands on what is said to the user."""

    def __init__(self, recorder: KeepsLog) -> None:
        super().__init__()
        self._recorder = recorder

    def emit(self, record: logging.LogRecord) -> None:
        level = (
            "ERROR" if record.levelno >= logging.ERROR else "WARNING" if record.levelno >= logging.WARNING else "INFO"
        )
        self._recorder.record_log(level, record.getMessage())


@contextmanager
def said_in(recorder: KeepsLog) -> Iterator[None]:
    """What is said to the user meanwhile is in the recording, too."""
    handler = _Said(recorder)
    LOGGER.addHandler(handler)
    try:
        yield
    finally:
        LOGGER.removeHandler(handler)

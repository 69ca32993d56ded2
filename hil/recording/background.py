"""Records a session that keeps time in a thread of its own: neither encoding nor a slow disk holds a tick up."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from queue import Full, Queue
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.recording.recorder import SessionRecorder, TrialHead
from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.runtime.console import LOGGER, counted, say_aside
from highfive.hil.session.shown import Shown
from highfive.hil.session.stream import StreamState
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.arm.loop import ArmTick
    from highfive.hil.drivers.bus.cycle_ring import Cycle

WAITING = 4096
"""So much may wait to be written: at two calls a tick, 17 s of a session at 120 Hz."""


class BackgroundRecorder:
    """What :class:`SessionRecorder` does: later, or, where the session keeps no time, at once. Close it, or use it in
    ``with``.

    A recording that cannot be written any more ends; the session goes on, and is told once.

    Attributes:
        trouble: why no more is recorded, in one line; '' as long as it is.
        lost: calls that were left out because the disk was too slow; only of a session that keeps time.
    """

    def __init__(self, recorder: SessionRecorder, *, paced: bool) -> None:
        """Begins.

        Args:
            recorder: which nobody else uses from now on.
            paced: the session keeps time: rather than wait, it leaves out.
        """
        self._recorder = recorder
        self.trouble, self.lost = "", 0
        self._calls: Queue[Callable[[], None] | None] = Queue(WAITING)
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True) if paced else None
        if self._thread is not None:
            self._thread.start()

    def begin_trial(self, head: TrialHead) -> None:
        """See :meth:`SessionRecorder.begin_trial`."""
        self._give(lambda: self._recorder.begin_trial(head), always=True)

    def record_tick(self, tick: RecordedTick) -> None:
        """See :meth:`SessionRecorder.record_tick`."""
        self._give(lambda: self._recorder.record_tick(tick))

    def record_arm(self, ticks: Sequence[ArmTick], cycles: Sequence[Cycle]) -> None:
        """See :meth:`SessionRecorder.record_arm`."""
        self._give(lambda: self._recorder.record_arm(ticks, cycles))

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
        """Returns once all is written."""
        self._stop()
        try:
            self._recorder.close()
        except HighFiveError as error:
            self.trouble = str(error)
            say_aside(f"{error}; the end of the session is not recorded", logging.WARNING)

    def discard(self) -> None:
        """Leaves nothing of this recording."""
        self._stop()
        self._recorder.discard()

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
        try:
            self._calls.put(call, block=always)
        except Full:
            self.lost += 1

    def _stop(self) -> None:
        if self._thread is not None:
            self._calls.put(None)
            self._thread.join()
            self._thread = None
        if self.lost:
            say_aside(f"the disk was too slow: {self.lost} parts of the recording are missing", logging.WARNING)
        for name, count in self._recorder.dropped.items():
            what = f"{counted(count, 'sample')} of before the first high five are not in the recording"
            say_aside(f"the LSL stream {name}: the first {what}", logging.WARNING)

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            self._do(call)

    def _do(self, call: Callable[[], None]) -> None:
        if self.trouble:
            return
        try:
            call()
        except HighFiveError as error:
            self.trouble = str(error)
            say_aside(f"{error}; the session goes on without a recording", logging.WARNING)


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

"""Where a session goes: into its recording, and to whoever else hears it; and whom else it records."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from types import TracebackType
from typing import TYPE_CHECKING, Any

from highfive.hil.publish.background import BackgroundPublisher
from highfive.hil.publish.publisher import ArmPosture, SessionEvent, ShownPicture
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.recording.recorder import DRAWN_EVERY, TrialHead
from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.session.session_streams import SessionStreams
from highfive.hil.session.shown import Shown
from highfive.hil.session.stream import StreamSettings, StreamState
from highfive.hil.session.sync_events import SyncEvent
from highfive.hil.trials.trial_result import TrialResult

if TYPE_CHECKING:
    from highfive.hil.arm.loop import ArmTick
    from highfive.hil.drivers.bus.cycle_ring import Cycle
    from highfive.hil.recording.lsl_inlets import LslInlets


LOOKED_NS = 1_000_000_000
"""So often all streams are asked for one time, and how they stand is recorded and shown."""


class SessionOutputs:
    """Takes what :class:`BackgroundRecorder` takes, and hands ticks and events to publishers as well.

    Use it in ``with``: streams of others are recorded meanwhile.

    Attributes:
        streams: all that come, are recorded or are shown, on one synchroniser.
        on_streams: is given how they stand, each second.
        stood: how they stood when that was last.
    """

    def __init__(
        self,
        recorder: BackgroundRecorder,
        publishers: Sequence[BackgroundPublisher] = (),
        streams: Sequence[str] = (),
        *,
        local_only: bool = True,
        clock: Clock = MACHINE,
        known: Mapping[str, StreamSettings] | None = None,
    ) -> None:
        """Of one session.

        Args:
            recorder: which nobody else uses from now on.
            publishers: likewise.
            streams: names of the LSL streams that are recorded beside it.
            local_only: those of this machine alone.
            clock: of the session, where it has publishers or streams.
            known: what is known of streams beforehand, by name.
        """
        self._recorder, self._publishers, self._clock = recorder, tuple(publishers), clock
        self._streams, self._local_only = tuple(streams), local_only
        self._inlets: LslInlets | None = None
        self.streams = SessionStreams(self._synchronised, known)
        self.on_streams: Callable[[list[StreamState]], None] = lambda states: None
        self.stood: list[StreamState] = []
        self._changing = threading.RLock()  # the recorder, to which other threads give, too; what it says comes back
        self._trial: int | None = None
        self._look_ns: int | None = None  # when streams are looked at next
        self._end_ns = 0  # of the last tick

    def go_on_in(self, recorder: BackgroundRecorder) -> None:
        """Records into another file from now on, and closes the one before; who listens hears nothing of it."""
        self.streams.end()
        self._recorder.record_event("session_end")
        with self._changing:
            over, self._recorder = self._recorder, recorder
        recorder.record_event("session_start")
        over.close()

    @property
    def paced(self) -> bool:
        """Others hear the session, or are heard by it: it goes at the pace of the clock."""
        return bool(self._publishers or self._streams)

    def begin_trial(self, head: TrialHead) -> None:
        """See :meth:`BackgroundRecorder.begin_trial`."""
        self._trial, self._look_ns = head.number, None
        self._recorder.begin_trial(head)

    def record_tick(self, tick: RecordedTick) -> None:
        """See :meth:`BackgroundRecorder.record_tick`."""
        self._end_ns = tick.at_ns
        self._recorder.record_tick(tick)
        for publisher in self._publishers:
            publisher.give(tick)
        self._look()

    def record_arm(self, ticks: Sequence[ArmTick], cycles: Sequence[Cycle]) -> None:
        """See :meth:`BackgroundRecorder.record_arm`."""
        for cycle in cycles:
            self.streams.arm(cycle.state.time_ns, cycle.state.positions)
            if cycle.number % DRAWN_EVERY == 0:
                for publisher in self._publishers:
                    publisher.give(ArmPosture(cycle.state.time_ns, cycle.state.positions))
        self._recorder.record_arm(ticks, cycles)

    def end_trial(self, result: TrialResult) -> None:
        """See :meth:`BackgroundRecorder.end_trial`."""
        self._recorder.end_trial(result)

    def record_event(self, event: str, at_ns: int | None = None, **about: Any) -> None:
        """See :meth:`BackgroundRecorder.record_event`; from any thread."""
        with self._changing:
            self._recorder.record_event(event, at_ns, **about)
        self._publish(event, at_ns if at_ns is not None else self._end_ns or self._clock.now(), about)

    def end(self) -> None:
        """The session is over; nothing of others' streams is recorded any more."""
        self._leave_streams()
        self.streams.end()
        self.record_event("session_end")

    def record_shown(self, page: int, shown: Shown, bound_ns: int, *, tracks: bool = False) -> None:
        """See :meth:`BackgroundRecorder.record_shown`; ``tracks``: the person comes through that page."""
        self.streams.shown(page, shown, bound_ns, tracks=tracks)
        self._recorder.record_shown(page, shown, bound_ns)
        for publisher in self._publishers:
            publisher.give(ShownPicture(page, shown, bound_ns))

    def record_log(self, level: str, text: str) -> None:
        """See :meth:`BackgroundRecorder.record_log`; from any thread."""
        with self._changing:
            self._recorder.record_log(level, text)

    def record_stream(self, samples: StreamSamples) -> None:
        """See :meth:`BackgroundRecorder.record_stream`; from any thread."""
        with self._changing:
            self._recorder.record_stream(samples)

    def discard(self) -> None:
        """Leaves nothing of the recording."""
        self._leave_streams()
        self._recorder.discard()

    def __enter__(self) -> SessionOutputs:
        """Self; the session begins."""
        if self._streams:
            from highfive.hil.recording.lsl_inlets import LslInlets  # noqa: PLC0415  (loads the library)

            self._inlets = LslInlets(self._streams, self, self.streams, local_only=self._local_only, clock=self._clock)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """The session is over."""
        self._leave_streams()
        for publisher in self._publishers:
            publisher.close()
        self._recorder.close()

    def _leave_streams(self) -> None:
        if self._inlets is not None:
            self._inlets.close()
            self._inlets = None

    def _look(self) -> None:
        """How all streams stand, a second after the last look, or after the high five began."""
        now = self._clock.now()
        if self._look_ns is not None and now >= self._look_ns:
            self.stood = states = self.streams.states(now)
            self._recorder.record_streams(states, now)
            self.on_streams(states)
        elif self._look_ns is not None:
            return
        self._look_ns = now + LOOKED_NS

    def _synchronised(self, event: SyncEvent) -> None:
        say_aside(event.text)
        self.record_event(event.happened.value, event.time_ns, trial=self._trial, **event.about())

    def stream_rows(self) -> list[dict[str, Any]]:
        """The streams for a summary: how each stood at the last look, and what each page has shown."""
        pages = self.streams.pages()
        return [asdict(state) | {"shown": pages.get(state.stream)} for state in self.stood]

    def _publish(self, event: str, at_ns: int, about: dict[str, Any]) -> None:
        for publisher in self._publishers:
            publisher.give(SessionEvent(event, at_ns, about))

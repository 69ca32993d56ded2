"""Streams of the Lab Streaming Layer that are recorded beside a session: markers of PsychoPy, an EEG, an eye tracker.

Nothing waits for them. Each has a thread of its own, which looks for it, follows it, and looks again when it is gone.
Meanwhile it is one of the session's streams. LSL asks the sender for the time by eight packets every two seconds and
keeps the one with the least round trip: each of these goes into a :class:`PingClock`, by which the samples are put on
the session's clock; the sender's own stamps are kept beside that.
"""

from __future__ import annotations

import ctypes
import logging
import threading
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import pylsl
from pylsl.lib import lib as library

from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import counted, say_aside
from highfive.hil.session.kinds import EVENTS, VECTORS
from highfive.hil.session.session_streams import SessionStreams
from highfive.hil.session.stream import Stream
from highfive.mocap_bridge.sources.lsl import clock_minus_lsl, configure
from highfive.mocap_bridge.sources.ping_clock import PingClock
from highfive.mocap_bridge.sources.scheduler import in_seconds
from highfive.mocap_bridge.wire.lsl import channel_labels, checked_times

RENEWED_NS = 500_000_000
"""So often it is looked whether LSL has measured anew how far the sender's clock is off."""
PATIENCE_NS = 5_000_000_000
"""A stream that is not found for so long is said to be absent."""
_SEARCH_S, _PAUSE_S = 1.2, 1.8
"""A search takes so long, and the next one comes so much later. The library asks this machine's ports one by one only
after half a second; and it asks from ports of the range in which streams announce themselves: three searches without a
pause leave none for a stream that begins."""
_STEP_S, _OPEN_S, _KEPT_S, _MOST = 0.01, 3.0, 60, 4096
"""A stream that is asked for the present is valid within 25 ms of its newest sample: looked at each 50 ms, it was so in
every other moment only. Of 32 channels at 1 kHz a look each 10 ms takes 0.6 % of a core."""
LSL = "lsl/"
"""Before the name of such a stream among those of the session."""

_offset = library.lsl_time_correction_ex  # the C interface says when and how well it was measured
_offset.restype = ctypes.c_double
_offset.argtypes = [
    ctypes.c_void_p, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_double), ctypes.c_double,
    ctypes.POINTER(ctypes.c_int),
]  # fmt: skip


class StreamTaker(Protocol):
    """What takes the samples and is told what happens, from any thread."""

    def record_stream(self, samples: StreamSamples) -> None:
        """Samples that have come."""
        ...

    def record_event(self, event: str, at_ns: int | None = None, *, detail: str) -> None:
        """Something happened to a stream."""
        ...


class LslInlets:
    """Follows the streams of these names from now on; close it."""

    def __init__(
        self, names: Sequence[str], taker: StreamTaker, streams: SessionStreams, *, local_only: bool = False,
        clock: Clock = MACHINE,
    ) -> None:  # fmt: skip
        """Looks for each, on this machine alone where ``local_only``; those that are there are among ``streams``."""
        configure(local_only)
        self._closing = threading.Event()
        self._streams = {name: _Stream(name, taker, streams, clock, self._closing) for name in names}
        jobs = [self._search, *(stream.run for stream in self._streams.values())]
        self._threads = [threading.Thread(target=job, name="lsl-inlets", daemon=True) for job in jobs]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Returns once all is handed over that has come; one that is just being opened is left at its next step."""
        self._closing.set()
        for thread in self._threads:
            thread.join(_OPEN_S + 1.0)

    def _search(self) -> None:
        wanted = " or ".join(f"name='{name}'" for name in self._streams)
        while not self._closing.is_set():
            # More than there are: the search goes on for its whole time.
            found = pylsl.resolve_bypred(wanted, minimum=1024, timeout=_SEARCH_S)
            for name, stream in self._streams.items():
                stream.found([info for info in found if info.name() == name])
            self._closing.wait(_PAUSE_S)


class _Stream:
    """One name, and whatever stream has it."""

    def __init__(
        self, name: str, taker: StreamTaker, streams: SessionStreams, clock: Clock, closing: threading.Event
    ) -> None:
        self._name, self._taker, self._streams, self._clock, self._closing = name, taker, streams, clock, closing
        self._there: dict[str, pylsl.StreamInfo] = {}  # those of the name, by uid, the oldest first
        self._refused: set[str] = set()
        self._recorded = False  # since it was followed last
        self._known: tuple[int, bool] | None = None  # channels, and whether they are texts, when it was there last
        self._doubles: set[str] = set()

    def found(self, infos: Sequence[pylsl.StreamInfo]) -> None:
        """Takes what a search found; tells once of each that is one too many."""
        there = {info.uid(): info for info in sorted(infos, key=lambda info: (info.created_at(), info.uid()))}
        if len(there) > 1 and not self._doubles >= there.keys():
            self._doubles |= there.keys()
            hosts = ", ".join(info.hostname() for info in there.values())
            self._tell("lsl_double", f"is the name of {len(there)} streams ({hosts}); one is recorded", logging.WARNING)
        self._there = there

    def run(self) -> None:
        """Until it is told to close."""
        absent_since: int | None = self._clock.now()
        while not self._closing.is_set():
            info = next((info for uid, info in self._there.items() if uid not in self._refused), None)
            if info is not None:
                if self._follow(info):
                    absent_since = None  # it was told that it is gone
            elif absent_since is not None and self._clock.now() - absent_since > PATIENCE_NS:
                self._tell("lsl_absent", "is not there; it is recorded as soon as it is", logging.WARNING)
                absent_since = None
            self._closing.wait(_STEP_S)

    def _follow(self, info: pylsl.StreamInfo) -> bool:
        """Records a stream until it is gone; whether what became of it was told."""
        self._recorded = False
        try:
            self._record(info)
        except (pylsl.util.LostError, pylsl.util.TimeoutError):
            self._there = {}  # whether it is still there, the next search says
            if self._recorded:  # else a search that was under way found it as it went
                self._tell("lsl_lost", "is gone; it is recorded again when it is back", logging.WARNING)
            return self._recorded
        except Exception as error:  # whatever a stranger sends: the session goes on
            self._refused.add(info.uid())
            reason = " ".join(str(error).split()) or type(error).__name__
            self._tell("lsl_refused", f"cannot be recorded: {reason}", logging.WARNING)
        return True

    def _record(self, info: pylsl.StreamInfo) -> None:
        # recover: to wait for an outlet that died is done here, where it can be told.
        inlet = pylsl.StreamInlet(info, max_buflen=_KEPT_S, recover=False)
        full = inlet.info(_OPEN_S)
        count, text = full.channel_count(), full.channel_format() == pylsl.cf_string
        labels = channel_labels(full.as_xml(), count)
        if self._closing.is_set():
            return
        inlet.open_stream(_OPEN_S)
        theirs = _SenderClock(inlet, clock_minus_lsl(in_seconds(self._clock.now)))
        kind = f"{counted(count, 'channel')}, {'text' if text else 'numbers'}, type {full.type() or '(none)'}"
        if self._known is not None and self._known != (count, text):
            self._tell("lsl_changed", f"is another than before: {kind}", logging.WARNING)
        else:
            self._tell("lsl_found", f"is recorded: {kind}")
        self._known, self._recorded = (count, text), True
        # What comes irregularly holds until the next one.
        held = text or full.nominal_srate() == pylsl.IRREGULAR_RATE
        stream = self._streams.open(f"{LSL}{self._name}", EVENTS if held else VECTORS, theirs.clock)
        try:
            self._take(inlet, theirs, stream, labels, text)
        finally:
            self._streams.close(stream)

    def _take(
        self, inlet: pylsl.StreamInlet, theirs: _SenderClock, stream: Stream[Any], labels: tuple[str, ...], text: bool
    ) -> None:
        begins, closing, renewed = True, False, self._clock.now()
        while not closing:
            closing = self._closing.wait(_STEP_S)  # what has come until then is taken once more
            while samples := _pulled(inlet):
                values, stamps = samples
                came = StreamSamples(self._name, labels, text, values, stamps, (), self._clock.now(), begins)
                self._taker.record_stream(on_session_clock(came, stream))
                begins = False
            if self._clock.now() - renewed > RENEWED_NS:
                renewed = self._clock.now()
                theirs.learn(0.0)

    def _tell(self, event: str, what: str, level: int = logging.INFO) -> None:
        if self._closing.is_set():  # what becomes of it is the session's no more
            return
        say_aside(f"the LSL stream {self._name} {what}", level)
        self._taker.record_event(event, self._clock.now(), detail=f"{self._name} {what}")


class _SenderClock:
    """How far the sender's clock is off, as LSL measures it."""

    def __init__(self, inlet: pylsl.StreamInlet, from_lsl_s: float) -> None:
        """Waits for the first measurement: before that no sample has a time. ``from_lsl_s``: our clock minus LSL's."""
        self.clock = PingClock()
        self._inlet, self._from_lsl_s, self._measured_s = inlet, from_lsl_s, 0.0
        self.learn(_OPEN_S)

    def learn(self, wait_s: float) -> None:
        """Takes in the newest measurement.

        Raises:
            pylsl.util.TimeoutError, pylsl.util.LostError: there is none within ``wait_s``, where that is not 0.
        """
        remote, trip, error = ctypes.c_double(), ctypes.c_double(), ctypes.c_int()
        offset = _offset(self._inlet.obj, remote, trip, wait_s, error)
        if wait_s:
            pylsl.util.handle_error(error)
        if error.value or remote.value == self._measured_s:  # none newer
            return
        self._measured_s = remote.value
        probed(self.clock, remote.value, offset + self._from_lsl_s, trip.value)


def probed(clock: PingClock, remote_s: float, offset_s: float, trip_s: float) -> None:
    """Takes in a measurement: the sender's clock said ``remote_s`` in the middle of a round trip of ``trip_s``; with
    ``offset_s`` added that is the session's clock."""
    ours_s = remote_s + offset_s
    sent_ns, came_ns = (round(1e9 * (ours_s + sign * 0.5 * trip_s)) for sign in (-1.0, 1.0))
    clock.update(sent_ns, round(1e9 * remote_s), came_ns)


def on_session_clock(came: StreamSamples, stream: Stream[Any]) -> StreamSamples:
    """The samples once they are in the session's ``stream``, with their times by its clock."""
    stamps_ns = [round(1e9 * stamp) for stamp in came.stamps]
    for stamp_ns, value in zip(stamps_ns, came.values, strict=True):
        stream.add(stamp_ns, tuple(value) if came.text else np.asarray(value, dtype=float), came.came_ns)
    return replace(came, times_ns=[stream.time_of(stamp_ns) for stamp_ns in stamps_ns])


def _pulled(inlet: pylsl.StreamInlet) -> tuple[list[list[float | str]], list[float]] | None:
    """Samples that have come, and their stamps; None where there are none."""
    values: Any
    values, stamps = inlet.pull_chunk(0.0, _MOST, as_numpy=False)
    return (values, checked_times(np.asarray(stamps)).tolist()) if values else None

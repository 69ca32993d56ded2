"""Streams of the Lab Streaming Layer that are recorded beside a session: markers of PsychoPy, an EEG, an eye tracker.

Nothing waits for them. Each has a thread of its own, which looks for it, follows it, and looks again when it is gone.
Raw time stamps are kept beside those on the session's clock: the sender's stamp, plus LSL's estimate of how far its
clock is behind this machine's, renewed every :data:`RENEWED_NS`.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import pylsl

from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.console import counted, say_aside
from highfive.mocap_bridge.sources.lsl import clock_minus_lsl, configure
from highfive.mocap_bridge.sources.scheduler import in_seconds
from highfive.mocap_bridge.wire.lsl import channel_labels, checked_times

RENEWED_NS = 2_000_000_000
PATIENCE_NS = 5_000_000_000
"""A stream that is not found for so long is said to be absent."""
_SEARCH_S, _PAUSE_S = 1.2, 1.8
"""A search takes so long, and the next one comes so much later. The library asks this machine's ports one by one only
after half a second; and it asks from ports of the range in which streams announce themselves: three searches without a
pause leave none for a stream that begins."""
_STEP_S, _OPEN_S, _KEPT_S, _MOST = 0.05, 3.0, 60, 4096


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
        self, names: Sequence[str], taker: StreamTaker, *, local_only: bool = False, clock: Clock = MACHINE
    ) -> None:
        """Looks for each, on this machine alone where ``local_only``."""
        configure(local_only)
        self._closing = threading.Event()
        self._streams = {name: _Stream(name, taker, clock, self._closing) for name in names}
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

    def __init__(self, name: str, taker: StreamTaker, clock: Clock, closing: threading.Event) -> None:
        self._name, self._taker, self._clock, self._closing = name, taker, clock, closing
        self._there: dict[str, pylsl.StreamInfo] = {}  # those of the name, by uid, the oldest first
        self._refused: set[str] = set()
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
                self._follow(info)
                absent_since = None  # it was told that it is gone
            elif absent_since is not None and self._clock.now() - absent_since > PATIENCE_NS:
                self._tell("lsl_absent", "is not there; it is recorded as soon as it is", logging.WARNING)
                absent_since = None
            self._closing.wait(_STEP_S)

    def _follow(self, info: pylsl.StreamInfo) -> None:
        """Records a stream until it is gone."""
        try:
            self._record(info)
        except (pylsl.util.LostError, pylsl.util.TimeoutError):
            self._there = {}  # whether it is still there, the next search says
            self._tell("lsl_lost", "is gone; it is recorded again when it is back", logging.WARNING)
        except Exception as error:  # whatever a stranger sends: the session goes on
            self._refused.add(info.uid())
            reason = " ".join(str(error).split()) or type(error).__name__
            self._tell("lsl_refused", f"cannot be recorded: {reason}", logging.WARNING)

    def _record(self, info: pylsl.StreamInfo) -> None:
        # recover: to wait for an outlet that died is done here, where it can be told.
        inlet = pylsl.StreamInlet(info, max_buflen=_KEPT_S, recover=False)
        full = inlet.info(_OPEN_S)
        count, text = full.channel_count(), full.channel_format() == pylsl.cf_string
        labels = channel_labels(full.as_xml(), count)
        if self._closing.is_set():
            return
        inlet.open_stream(_OPEN_S)
        from_lsl, renewed = clock_minus_lsl(in_seconds(self._clock.now)), self._clock.now()
        to_ours = inlet.time_correction(_OPEN_S) + from_lsl
        kind = f"{counted(count, 'channel')}, {'text' if text else 'numbers'}, type {full.type() or '(none)'}"
        if self._known is not None and self._known != (count, text):
            self._tell("lsl_changed", f"is another than before: {kind}", logging.WARNING)
        else:
            self._tell("lsl_found", f"is recorded: {kind}")
        self._known, begins, closing = (count, text), True, False
        while not closing:
            closing = self._closing.wait(_STEP_S)  # what has come until then is taken once more
            while samples := _pulled(inlet):
                values, stamps = samples
                times = [round(1e9 * (stamp + to_ours)) for stamp in stamps]
                self._taker.record_stream(StreamSamples(self._name, labels, text, values, stamps, times, begins))
                begins = False
            if self._clock.now() - renewed > RENEWED_NS:
                renewed = self._clock.now()
                with contextlib.suppress(pylsl.util.TimeoutError):  # none newer
                    to_ours = inlet.time_correction(0.0) + from_lsl

    def _tell(self, event: str, what: str, level: int = logging.INFO) -> None:
        if self._closing.is_set():  # what becomes of it is the session's no more
            return
        say_aside(f"the LSL stream {self._name} {what}", level)
        self._taker.record_event(event, self._clock.now(), detail=f"{self._name} {what}")


def _pulled(inlet: pylsl.StreamInlet) -> tuple[list[list[float | str]], list[float]] | None:
    """Samples that have come, and their stamps; None where there are none."""
    values: Any
    values, stamps = inlet.pull_chunk(0.0, _MOST, as_numpy=False)
    return (values, checked_times(np.asarray(stamps)).tolist()) if values else None

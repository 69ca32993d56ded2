"""Any stream of the Lab Streaming Layer: an eye tracker, EEG, an experiment's events.

Samples are handed on with the sender's own stamps. LSL asks the sender for the time by eight packets every two seconds
and keeps the one with the least round trip; each of these goes into a :class:`PingClock`, which has drift and a bound
besides. A sender that stamps with another clock than LSL's is found by whoever looks at the stamps
(:mod:`highfive.hil.session.stream_watch`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

import numpy as np
import pylsl
from pylsl.lib import lib as library

from highfive.mocap_bridge.sources.lsl import clock_minus_lsl, configure
from highfive.mocap_bridge.sources.ping_clock import PingClock
from highfive.mocap_bridge.sources.scheduler import THREADS, Scheduler, in_seconds
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.lsl import checked_times
from highfive.model.errors import HighFiveError
from highfive.model.plugins import fault

Take = Callable[[int, Any, int], None]
"""Gets a sample: its stamp by the sender's clock, ns; channels (C,), or the text of the only one; its arrival, ns.

It is called in the thread that receives, and must neither wait nor raise.
"""

_MOST, _KEPT_S = 4096, 5  # samples that are taken at once; what is older is dropped by the library
_RENEWED_S, _AGAIN_S = 0.5, 1.0  # how often the clock is looked at, and a stream that is gone

_offset = library.lsl_time_correction_ex  # the C interface says when and how well it was measured
_offset.restype = ctypes.c_double
_offset.argtypes = [
    ctypes.c_void_p, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_double), ctypes.c_double,
    ctypes.POINTER(ctypes.c_int),
]  # fmt: skip


class LslStream:
    """Follows one stream until it is closed; a stream that is gone is looked for anew.

    Attributes:
        trouble: why nothing comes, in one line; '' where there is nothing to say.
    """

    def __init__(self, name: str, take: Take, clock: PingClock, scheduler: Scheduler = THREADS) -> None:
        """Starts to look for the stream called ``name``.

        Args:
            name: of the stream.
            take: gets the samples.
            clock: of the sender; it learns here.
            scheduler: time, and what starts the thread.

        Raises:
            HighFiveError: no stream can be called so.
        """
        if not name or "'" in name or '"' in name:
            raise HighFiveError(f"an LSL stream called {name!r}: a stream has a name, without quotation marks")
        configure(local_only=False)
        self.trouble = "connecting"
        self._name, self._take, self._clock, self._now = name, take, clock, scheduler.now
        self._closing = False
        self._changed = scheduler.condition()
        self._task = scheduler.start(f"LSL {name}", self._run)

    def close(self) -> None:
        """Ends the thread and the connection."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._task.join(timeout=5.0)

    def _run(self) -> None:
        while not self._closing:
            try:
                self._follow()
            except HighFiveError as error:
                self.trouble = str(error)
            except Exception as error:  # RuntimeError is what all errors of the library are
                self.trouble = f"the stream {self._name!r}: {fault(error)}"
            with self._changed:
                self._changed.wait_for(lambda: self._closing, _AGAIN_S)

    def _follow(self) -> None:
        found = pylsl.resolve_byprop("name", self._name, timeout=_AGAIN_S)
        if not found:
            raise LinkError(f"no stream called {self._name!r} is on the network")
        if len({(info.source_id(), info.uid()) for info in found}) > 1:
            raise LinkError(f"{len(found)} streams are called {self._name!r}; rename all but one where they are sent")
        inlet = pylsl.StreamInlet(found[0], max_buflen=_KEPT_S, recover=False)
        inlet.open_stream(timeout=2.0)
        text = found[0].channel_format() == pylsl.cf_string
        seconds = in_seconds(self._now)
        to_monotonic_s, renewed, measured_s = clock_minus_lsl(seconds), 0.0, 0.0
        while not self._closing:
            if (now := seconds()) - renewed > _RENEWED_S:
                renewed = now
                measured_s = self._learn(inlet, to_monotonic_s, measured_s)
            samples, stamps = inlet.pull_chunk(timeout=0.1, max_samples=_MOST)
            arrival_ns = self._now()
            times = np.rint(1e9 * checked_times(np.asarray(stamps, dtype=float))).astype(np.int64).tolist()
            self.trouble = "" if times else self.trouble
            for stamp_ns, sample in zip(times, cast("list[list[Any]]", samples), strict=True):
                self._take(stamp_ns, _value(sample, text), arrival_ns)

    def _learn(self, inlet: pylsl.StreamInlet, to_monotonic_s: float, measured_s: float) -> float:
        """Hands the newest probe of the sender's clock on; returns when, by that clock, it was made, s."""
        remote, trip, error = ctypes.c_double(), ctypes.c_double(), ctypes.c_int()
        offset = 0.0
        with suppress(RuntimeError):
            wait_s = 2.0 if not measured_s else 0.0  # once: before that no sample has a time
            offset = _offset(inlet.obj, remote, trip, wait_s, error)
        if error.value or remote.value == measured_s:
            return measured_s
        local_s = remote.value + offset + to_monotonic_s
        sent_ns, came_ns = (round(1e9 * (local_s + sign * 0.5 * trip.value)) for sign in (-1.0, 1.0))
        self._clock.update(sent_ns, round(1e9 * remote.value), came_ns)
        return remote.value


def _value(sample: list[Any], text: bool) -> Any:
    if not text:
        return np.asarray(sample, dtype=float)
    return sample[0] if len(sample) == 1 else tuple(sample)

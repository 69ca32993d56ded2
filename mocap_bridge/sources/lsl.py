"""Markers from the Lab Streaming Layer (labstreaminglayer.org), through its own library.

Time. LSL stamps a sample with the sender's clock, s. ``time_correction`` of the library estimates, from packets
exchanged with the sender, what has to be added to get this machine's LSL clock; that clock and this process's
monotonic clock differ by a constant, which is measured when the connection is made. The sum of the three is the
``source_time_ns`` of a frame: on one machine the age of a frame is right to some 0.02 ms, over a network to the
asymmetry of its delays (below 1 ms). The library renews the estimate every two seconds; it is taken over gradually.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pylsl

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.live import Link
from highfive.mocap_bridge.sources.scheduler import THREADS, Now, in_seconds
from highfive.mocap_bridge.sources.scheme import UP, Address, Scheme
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.lsl import FrameCounter, checked_times, library_settings, markers_of, parse_description
from highfive.model.errors import HighFiveError

TYPE = "MoCap"
"""The type that a stream of markers has."""

_MOST = 512  # samples that are taken at once
_KEPT_S = 1  # what is older is dropped by the library
_RENEWED_S = 1.0  # how often the clock offset is requested
_SLEW = 0.02  # share of the way to a new clock offset that is gone a time
_configured = threading.Lock()
_FILES = ("lsl_api.cfg", "~/lsl_api/lsl_api.cfg", "/etc/lsl_api/lsl_api.cfg")


def configure(local_only: bool) -> None:
    """Sets the library up, once a process, before its first use; later calls do nothing.

    The user's own configuration (``LSLAPICFG``, ``lsl_api.cfg``) holds. ``local_only`` restricts announcing and
    searching to this machine; which network card the data port listens at, the library cannot be configured.
    """
    if not _configured.acquire(blocking=False):  # held for good: the library reads its settings once
        return
    text = ""
    for name in (os.environ.get("LSLAPICFG", ""), *_FILES):
        path = Path(name).expanduser()
        if name and path.is_file():
            try:
                text = path.read_text(encoding="utf-8", errors="replace")
            except OSError:
                continue
            break
    pylsl.util.set_config_content(library_settings(text, local_only))


def connect_lsl(
    name: str,
    timeout_s: float = 2.0,
    y_up: bool = False,
    counter: FrameCounter | None = None,
    now: Now = THREADS.now,
) -> Link:
    """Connects to the stream called ``name``.

    Args:
        name: the stream's name.
        timeout_s: how long each step (finding it, measuring the clock offset, opening it) may take, s.
        y_up: the stream's y axis points up, not its z axis.
        counter: numbers the frames, and goes on where an earlier connection left off; None counts from 0.
        now: monotonic clock, ns.

    Raises:
        LinkError: there is no such stream, it holds no markers, or it does not answer.
    """
    if not name or "'" in name or '"' in name:
        raise LinkError(f"lsl://{name}: a stream has a name, without quotation marks")
    configure(local_only=False)
    found = pylsl.resolve_byprop("name", name, timeout=timeout_s)
    if not found:
        raise LinkError(f"no stream called {name!r} is on the network (searched for {timeout_s:g} s)")
    markers = [info for info in found if info.type().lower() == TYPE.lower()]
    if not markers:
        raise LinkError(
            f"the stream {name!r} is of type {found[0].type()!r}; markers come in a stream of type {TYPE!r}"
        )
    try:
        return LslLink(markers[0], name, timeout_s, y_up, counter or FrameCounter(), now)
    except (RuntimeError, HighFiveError) as error:  # RuntimeError is what all errors of the library are
        raise LinkError(f"the stream {name!r}: {error}") from None


class LslLink:
    """An open stream."""

    def __init__(
        self, info: pylsl.StreamInfo, name: str, timeout_s: float, y_up: bool, counter: FrameCounter, now: Now
    ):
        """Opens the stream that ``info`` describes."""
        self._name, self._y_up, self._clock = name, y_up, in_seconds(now)
        if info.channel_format() == pylsl.cf_string:
            raise LinkError("it sends text, not numbers")
        # recover: whether to wait for an outlet that died; that is our caller's to do.
        self._inlet: pylsl.StreamInlet | None = pylsl.StreamInlet(info, max_buflen=_KEPT_S, recover=False)
        full = self._inlet.info(timeout_s)
        self._layout = parse_description(full.as_xml(), full.channel_count())
        rate = full.nominal_srate()
        self._rate_hz = float(rate) if 0.0 < rate < 1e6 else 0.0
        self._counter = counter
        counter.set_rate(self._rate_hz)
        self._to_monotonic_s = clock_minus_lsl(self._clock)
        self._correction = self._newest_correction = self._inlet.time_correction(timeout_s)
        self._renewed = self._clock()
        self._inlet.open_stream(timeout_s)

    @property
    def rate_hz(self) -> float:
        """Nominal rate, Hz; 0 for an irregular stream."""
        return self._rate_hz

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """Frames that have come; see :class:`highfive.mocap_bridge.sources.live.Link`."""
        if self._inlet is None:
            raise LinkError(f"the stream {self._name!r} was closed")
        try:
            samples, stamps = self._inlet.pull_chunk(timeout_s, _MOST, min_samples=1, as_numpy=True)
            if not len(stamps):
                return ()
            offset, arrival = self._offset(), self._clock()
        except RuntimeError as error:
            raise LinkError(f"the stream {self._name!r}: {error}") from None
        points, valid, impossible = markers_of(self._layout, np.asarray(samples))
        if self._y_up:
            points = np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)
        column = self._layout.frame_column
        stated = np.full(len(points), np.nan) if column < 0 else np.asarray(samples)[:, column].astype(float)
        nothing = np.zeros((0, 3))
        return [
            MarkerFrame(
                names=self._layout.names,
                positions=points[k],
                valid=valid[k],
                number=self._counter.next(float(time_s), arrival, float(stated[k])),
                source_time_ns=round(time_s * 1e9),
                arrival_time_ns=0,
                unlabelled=nothing,
                counted=column >= 0,
                impossible=int(impossible[k]),
            )
            for k, time_s in enumerate(checked_times(np.asarray(stamps)) + offset)
        ]

    def close(self) -> None:
        """Leaves the stream."""
        self._inlet = None  # the library lets go with the object

    def _offset(self) -> float:
        """What is added to a time stamp for this process's monotonic clock, s."""
        now = self._clock()
        if now - self._renewed > _RENEWED_S and self._inlet is not None:
            self._renewed = now
            with contextlib.suppress(pylsl.util.TimeoutError):  # none newer
                self._newest_correction = self._inlet.time_correction(0.0)
        self._correction += _SLEW * (self._newest_correction - self._correction)
        return self._correction + self._to_monotonic_s


def clock_minus_lsl(clock: Callable[[], float]) -> float:
    """This process's clock minus LSL's, s: of several readings the one that took least time."""
    readings = []
    for _ in range(9):
        before = clock()
        lsl = pylsl.local_clock()
        after = clock()
        readings.append((after - before, 0.5 * (before + after) - lsl))
    return min(readings)[1]


@dataclass(frozen=True)
class _LslScheme(Scheme):
    def connector(self, address: Address, now: Now = THREADS.now) -> Callable[[], Link]:
        """Connections that number their frames on from one to the next."""
        counter = FrameCounter()
        return lambda: connect_lsl(address.host, y_up=address.options.get("up") == "y", counter=counter, now=now)


SCHEME = _LslScheme("lsl://name", lambda address: connect_lsl(address.host), options=UP)
"""Names of LSL streams."""

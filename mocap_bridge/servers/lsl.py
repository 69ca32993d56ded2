"""A recording as a stream of the Lab Streaming Layer."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pylsl

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.lsl import TYPE, configure
from highfive.mocap_bridge.sources.scheduler import THREADS, Now
from highfive.mocap_bridge.wire.lsl import channel_descriptions, samples_of
from highfive.model.errors import HighFiveError

_KEPT_S = 1  # what a client has not taken for so long is dropped


class LslServer:
    """One stream: three channels per marker, in metres, NaN where it is hidden.

    The channels of a stream are fixed, so labels that come in another order are put into the first one, a label that is
    not among them is not sent, and points without a label cannot be sent.
    """

    def __init__(
        self,
        names: Sequence[str],
        rate_hz: float,
        name: str = "HighFive",
        local_only: bool = True,
        now: Now = THREADS.now,
    ):
        """Announces the stream.

        Args:
            names: the markers, with their person before a colon.
            rate_hz: nominal rate.
            name: the stream's name.
            local_only: announce it on this machine alone. LSL cannot set where its data port listens: a program on
                another machine that knows the port could still ask.
            now: monotonic clock, ns.

        Raises:
            HighFiveError: there is nothing to send, or the library cannot make the stream.
        """
        if not names or not name or "'" in name or '"' in name:
            raise HighFiveError(f"an LSL stream needs markers and a name without quotation marks; got {name!r}")
        configure(local_only)
        self._names, self._rate, self._name = tuple(names), rate_hz, name
        self._outlet: pylsl.StreamOutlet | None = None
        self._now, self._sent_ns = now, 0
        self._start_s: float | None = None  # LSL's clock at the source's time 0
        self._closed = False
        self.answer()

    @property
    def port(self) -> int:
        """TCP port of the data; clients find it by the stream's name. 0 while it hangs up."""
        if self._outlet is None:
            return 0
        text = self._outlet.get_info().as_xml().partition("<v4data_port>")[2].partition("<")[0]
        return int(text) if text.isdigit() else 0

    @property
    def sent_ns(self) -> int:
        """When the last frame went out; see :class:`highfive.mocap_bridge.servers.serving.Server`."""
        return self._sent_ns

    def send(self, frame: MarkerFrame) -> None:
        """Sends a frame, stamped with its own time; a client that is slow loses what is older than a second."""
        source_s = frame.source_time_ns * 1e-9
        # Of all frames the one that was sent most promptly says when the source began: the first call takes longer.
        start = self._start_s = min(pylsl.local_clock() - source_s, self._start_s or math.inf)
        if self._outlet is None:
            return
        sample = samples_of(self._names, frame.names, frame.positions, frame.valid).astype(np.float32)
        self._sent_ns = self._now()
        self._outlet.push_chunk(sample[None], start + source_s)

    def hang_up(self) -> None:
        """Takes the stream off the network."""
        self._outlet = None

    def answer(self) -> None:
        """Announces the stream, again if it was taken off."""
        if self._outlet is not None or self._closed:
            return
        info = pylsl.StreamInfo(
            self._name, TYPE, 3 * len(self._names), self._rate, pylsl.cf_float32, f"high-five-{self._name}"
        )
        channels = info.desc().append_child("channels")
        for described in channel_descriptions(self._names):
            channel = channels.append_child("channel")
            for key, value in described.items():
                channel.append_child_value(key, value)
        try:
            self._outlet = pylsl.StreamOutlet(info, chunk_size=1, max_buffered=_KEPT_S)
        except RuntimeError as error:
            raise HighFiveError(f"cannot make the LSL stream {self._name!r}: {error}") from None

    def close(self) -> None:
        """Takes the stream off the network for good."""
        self._closed = True
        self.hang_up()

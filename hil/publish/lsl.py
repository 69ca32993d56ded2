"""A session as outlets of the Lab Streaming Layer."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence

import numpy as np
import pylsl

from highfive.hil.publish.lsl_streams import (
    Stream,
    avatar_sample,
    avatar_stream,
    events_stream,
    person_sample,
    person_stream,
    shown_sample,
    shown_stream,
)
from highfive.hil.publish.publisher import ArmPosture, SessionEvent, ShownPicture
from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.mocap_bridge.sources.lsl import clock_minus_lsl, configure
from highfive.mocap_bridge.sources.scheduler import in_seconds
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

KEPT_S = 60
"""What a program has not taken for so long is dropped for it."""
_LAST_WORDS_NS = 1_000_000_000
"""LabRecorder takes what has come twice a second."""


class LslPublisher:
    """Outlets, there from now on: person, avatar, events, and what pages show where there is one.

    A sample is stamped with its own time on the session's clock: a person's with when the cameras saw her, a pose's
    with when it is to be shown, an event's with that of the pose with which it happened.
    """

    name = "lsl"
    waiting = 1200

    def __init__(
        self, markers: Sequence[str], rates_hz: tuple[float, float], lag_s: float = 0.0, *,
        pages: bool = False, local_only: bool = True, clock: Clock = MACHINE,
    ) -> None:  # fmt: skip
        """Announces the streams.

        Args:
            markers: the person's.
            rates_hz: nominal rates of the person's samples and the avatar's; 0 for irregular.
            lag_s: what her system says that it takes, made up for in the time stamps.
            pages: the session is shown on pages.
            local_only: announce them on this machine alone; see :class:`highfive.mocap_bridge.servers.lsl.LslServer`.
            clock: of the session.

        Raises:
            HighFiveError: the library cannot make a stream.
        """
        configure(local_only)
        self._to_lsl_s = -clock_minus_lsl(in_seconds(clock.now))
        self._clock = clock
        self._markers = tuple(markers)
        self._person = _outlet(person_stream(markers, rates_hz[0], lag_s))
        self._avatar = _outlet(avatar_stream(rates_hz[1]))
        self._events = _outlet(events_stream())
        self._shown = _outlet(shown_stream()) if pages else None

    def tick(self, tick: RecordedTick) -> None:
        """A sample of the avatar and, where a frame had come, of the person."""
        if tick.sighting is not None:
            if tick.sighting.markers.names != self._markers:
                raise HighFiveError(f"the person's markers are {', '.join(tick.sighting.markers.names)} now")
            self._push(self._person, person_sample(tick.sighting), tick.captured_ns)
        self._push(self._avatar, avatar_sample(tick.played), tick.at_ns)

    def event(self, event: SessionEvent) -> None:
        """A sample of the events."""
        self._events.push_sample([json.dumps(event.record(), ensure_ascii=False)], self._stamp(event.at_ns))

    def shown(self, picture: ShownPicture) -> None:
        """A sample of what was shown, at the time at which it was seen."""
        if self._shown is not None:
            self._push(self._shown, shown_sample(picture), picture.shown.display_ns)

    def arm(self, posture: ArmPosture) -> None:
        """Nobody asks for it."""

    def close(self) -> None:
        """Takes the streams off the network; whoever listens gets what was sent until now."""
        outlets = (self._person, self._avatar, self._events, self._shown)
        if any(outlet is not None and outlet.have_consumers() for outlet in outlets):
            self._clock.wait_until(self._clock.now() + _LAST_WORDS_NS)
        del self._person, self._avatar, self._events, self._shown, outlets

    def _push(self, outlet: pylsl.StreamOutlet, sample: Array, at_ns: int) -> None:
        outlet.push_chunk(sample.astype(np.float32)[None], self._stamp(at_ns))

    def _stamp(self, at_ns: int) -> float:
        return 1e-9 * at_ns + self._to_lsl_s


def _outlet(stream: Stream) -> pylsl.StreamOutlet:
    kind = pylsl.cf_string if stream.text else pylsl.cf_float32
    # The same from session to session: who recorded the last one finds this one again.
    source_id = f"{stream.name}@{platform.node() or 'here'}"
    info = pylsl.StreamInfo(stream.name, stream.kind, len(stream.channels), stream.rate_hz, kind, source_id)
    about = info.desc()
    channels = about.append_child("channels")
    for described in stream.channels:
        channel = channels.append_child("channel")
        for key, value in described.items():
            channel.append_child_value(key, value)
    acquisition = about.append_child("acquisition")
    acquisition.append_child_value("manufacturer", "High Five")
    acquisition.append_child_value("compensated_lag", f"{stream.lag_s:g}")
    synchronization = about.append_child("synchronization")
    synchronization.append_child_value("can_drop_samples", "true")
    try:
        return pylsl.StreamOutlet(info, chunk_size=1, max_buffered=KEPT_S)
    except RuntimeError as error:
        raise HighFiveError(f"cannot make the LSL stream {stream.name}: {error}") from None

"""A switch that says, over LSL, when a shoulder was tapped: a mat, a button, a dummy that is touched."""

from __future__ import annotations

from collections import deque

from highfive.hil.recording.lsl_inlets import LslInlets
from highfive.hil.recording.stream_samples import StreamSamples, check_stream_names
from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.session.session_streams import SessionStreams
from highfive.model.errors import HighFiveError

PRESSED = 0.5
"""A number above it says that the switch is pressed."""
PATIENCE_S = 30.0
"""So long the stream is waited for before a run, s."""
_KEPT = 64
_HEARD, _GONE = {"lsl_found", "lsl_changed"}, {"lsl_lost", "lsl_refused", "lsl_absent"}


class TapSwitch:
    """Follows a stream of events or levels until it is closed.

    A stream of texts says a tap by each text that is not empty; one of numbers by its first channel, as it rises above
    :data:`PRESSED`.
    """

    def __init__(self, name: str, clock: Clock = MACHINE, *, local_only: bool = False) -> None:
        """Looks for the stream; one that is not there is told, and looked for again.

        Raises:
            HighFiveError: no name of a stream.
        """
        check_stream_names([name])
        self.name = name
        self._taps: deque[int] = deque(maxlen=_KEPT)
        self._clock = clock
        self._there = False
        self._held = False
        self._inlets = LslInlets([name], self, SessionStreams(), local_only=local_only, clock=clock)

    def close(self) -> None:
        """It is followed no more."""
        self._inlets.close()

    def tapped_since(self, since_ns: int) -> int | None:
        """When the first tap after a time was, ns of the host's clock; None where there was none."""
        return next((at_ns for at_ns in list(self._taps) if at_ns >= since_ns), None)

    def record_stream(self, samples: StreamSamples) -> None:
        """Samples that have come."""
        self._held = self._held or samples.begins  # what is pressed as the stream begins has not risen
        for at_ns, row in zip(samples.times_ns, samples.values, strict=True):
            value = row[0] if row else ""
            if isinstance(value, str):
                pressed = risen = bool(value.strip())
            else:
                pressed = value > PRESSED
                risen = pressed and not self._held
            if risen:
                self._taps.append(at_ns)
            self._held = pressed

    def record_event(self, event: str, at_ns: int | None = None, *, detail: str) -> None:
        """What becomes of the stream."""
        self._there = event in _HEARD or (self._there and event not in _GONE)

    @property
    def trouble(self) -> str:
        """Why no tap would be heard now, '' where one would."""
        return "" if self._there else f"the switch's LSL stream {self.name} is not there"

    def wait(self, seconds: float = PATIENCE_S) -> None:
        """Returns once the stream is heard.

        Raises:
            HighFiveError: it is not there within so many s.
        """
        end = self._clock.now() + round(1e9 * seconds)
        while self.trouble:
            if self._clock.now() > end:
                raise HighFiveError(f"{self.trouble}; is its name right, and is it sending? (--tap-switch)")
            self._clock.wait_until(self._clock.now() + 50_000_000)

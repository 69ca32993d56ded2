"""Samples of other programs' streams that come before the first high five begins."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import replace

from highfive.hil.recording.stream_samples import StreamSamples

EARLY = 1_000_000
"""Values (channels times samples) that are kept until then: half a minute of 64 channels at 500 Hz, some 30 MB."""


class EarlySamples:
    """The newest of them, in order; what is left out is counted.

    Attributes:
        dropped: samples that were left out, by stream.
    """

    def __init__(self, most: int = EARLY) -> None:
        """Keeps ``most`` values at the most, and the newest samples of all in any case."""
        self._most, self._held = most, 0
        self._kept: deque[StreamSamples] = deque()
        self._begins = set[str]()  # streams whose beginning, which names the channels, was left out
        self.dropped = Counter[str]()

    def add(self, samples: StreamSamples) -> None:
        """Keeps what has come; the oldest goes."""
        self._kept.append(samples)
        self._held += _values(samples)
        while self._held > self._most and len(self._kept) > 1:
            oldest = self._kept.popleft()
            self._held -= _values(oldest)
            self.dropped[oldest.name] += len(oldest.stamps)
            if oldest.begins:
                self._begins.add(oldest.name)

    def taken(self) -> Iterator[StreamSamples]:
        """Them, the oldest first, and none is left: the first ones of a stream name its channels."""
        while self._kept:
            samples = self._kept.popleft()
            begins = samples.begins or samples.name in self._begins
            self._begins.discard(samples.name)
            yield replace(samples, begins=begins)
        self._held = 0


def _values(samples: StreamSamples) -> int:
    return sum(map(len, samples.values))

"""How well frames come: age, jitter, and what was seen of each marker; memory does not grow with time."""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.geometry.rotations import Array

RECENT_S = 1.0
"""What the screen calls recent, s."""

_STEP = math.log(1.01)  # width of a bin: percentiles are right to 1 %
_SMALLEST = 1e-3  # ms
_BINS = 2000  # up to 4e5 ms
_MOST_RECENT = 4096  # frames


class Histogram:
    """Durations in bins that are one per cent wide."""

    def __init__(self) -> None:
        """Empty."""
        self._bins = np.zeros(_BINS, dtype=np.int64)
        self.count, self.max = 0, 0.0
        self._sum = self._squares = 0.0

    def add(self, ms: float) -> None:
        """Adds a duration, ms."""
        index = int(math.log(max(ms, _SMALLEST) / _SMALLEST) / _STEP)
        self._bins[min(index, _BINS - 1)] += 1
        self.count += 1
        self.max = max(self.max, ms)
        self._sum += ms
        self._squares += ms * ms

    def percentile(self, share: float) -> float:
        """Duration, ms, that ``share`` of all (0 to 1) do not exceed; 0 where there are none."""
        if not self.count:
            return 0.0
        index = int(np.searchsorted(np.cumsum(self._bins), share * self.count))
        return min(_SMALLEST * math.exp((index + 0.5) * _STEP), self.max)

    @property
    def std(self) -> float:
        """Standard deviation, ms."""
        if not self.count:
            return 0.0
        mean = self._sum / self.count
        return math.sqrt(max(0.0, self._squares / self.count - mean * mean))


@dataclass(frozen=True)
class Snapshot:
    """What is known at one moment.

    Attributes:
        frames: that were looked at since the first.
        rate_hz: of the last second.
        age_ms: (3,) median, p99 and maximum of the age of a frame when it was there to be used.
        jitter_ms: (2,) standard deviation and p99 of the time between frames.
        names: markers.
        recent: (M,) share of the last second's frames in which each was seen.
        share: (M,) the same of all frames.
        last_seen_s: (M,) s, inf for never.
        unlabelled: points without a label in the newest frame, ...
        unlabelled_mean, unlabelled_max: ... and in all.
    """

    frames: int
    rate_hz: float
    age_ms: tuple[float, float, float]
    jitter_ms: tuple[float, float]
    names: tuple[str, ...]
    recent: Array
    share: Array
    last_seen_s: Array
    unlabelled: int
    unlabelled_mean: float
    unlabelled_max: int


class StreamStatistics:
    """Fed by one thread, looked at by another."""

    def __init__(self) -> None:
        """Nothing has come yet."""
        self._lock = threading.Lock()
        self._ages, self._periods = Histogram(), Histogram()
        self._recent: deque[tuple[int, np.ndarray]] = deque(maxlen=_MOST_RECENT)
        self._names: tuple[str, ...] = ()
        self._seen: dict[str, int] = {}  # frames in which each marker was seen
        self._last: dict[str, int] = {}  # ns
        self._arrival_ns, self._unlabelled = -1, 0
        self._unlabelled_sum = self._unlabelled_max = 0

    def add(self, frame: MarkerFrame, now_ns: int) -> None:
        """A frame that can be used from ``now_ns`` on."""
        with self._lock:
            self._ages.add((now_ns - frame.arrival_time_ns) * 1e-6)
            if self._arrival_ns >= 0:
                self._periods.add((frame.arrival_time_ns - self._arrival_ns) * 1e-6)
            self._arrival_ns, self._unlabelled = frame.arrival_time_ns, len(frame.unlabelled)
            self._unlabelled_sum += self._unlabelled
            self._unlabelled_max = max(self._unlabelled_max, self._unlabelled)
            if frame.names != self._names:
                self._names = frame.names
                self._recent.clear()
            self._recent.append((frame.arrival_time_ns, frame.valid))
            for name, valid in zip(frame.names, frame.valid.tolist(), strict=True):
                if valid:
                    self._seen[name] = self._seen.get(name, 0) + 1
                    self._last[name] = frame.arrival_time_ns
                else:
                    self._seen.setdefault(name, 0)

    def snapshot(self, now_ns: int) -> Snapshot:
        """What is known at ``now_ns``."""
        with self._lock:
            recent = [entry for entry in self._recent if now_ns - entry[0] <= RECENT_S * 1e9]
            names = tuple(self._seen)
            of = {name: m for m, name in enumerate(self._names)}
            columns = [of.get(name, -1) for name in names]
            shares = np.mean([valid for _, valid in recent], axis=0) if recent else np.zeros(len(self._names))
            shares = np.append(shares, 0.0)[columns] if names else np.zeros(0)
            frames = self._ages.count
            return Snapshot(
                frames=frames,
                rate_hz=len(recent) / RECENT_S,
                age_ms=(self._ages.percentile(0.5), self._ages.percentile(0.99), self._ages.max),
                jitter_ms=(self._periods.std, self._periods.percentile(0.99)),
                names=names,
                recent=shares,
                share=np.array([self._seen[name] / frames for name in names]),
                last_seen_s=np.array([(now_ns - self._last[n]) * 1e-9 if n in self._last else np.inf for n in names]),
                unlabelled=self._unlabelled,
                unlabelled_mean=self._unlabelled_sum / max(frames, 1),
                unlabelled_max=self._unlabelled_max,
            )

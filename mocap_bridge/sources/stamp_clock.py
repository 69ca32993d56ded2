"""A system's time stamps on this computer's clock.

A frame arrives late by what network and computers take, never early: the least of arrival minus stamp is the offset of
the clocks, and its slope is their drift. The lower convex hull of the minima of each second gives both, untouched by
late frames (Zhang, Liu & Xia 2002, "Clock synchronization algorithms for network measurements", IEEE INFOCOM; the line
through the hull by linear programming: Moon, Skelly & Towsley 1999). Where one of the clocks was set it begins anew.
The least delay itself cannot be seen from one side: systems report it, or it is measured with an event that both see.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import copysign, sqrt

from highfive.model.settings import Settings, setting

SECOND_NS = 1_000_000_000

UNKNOWN_NS = 2**63 - 1
"""A bound where nothing is known yet."""


@dataclass(frozen=True)
class StampClockSettings(Settings):
    """Chosen on simulated clocks 50 ppm apart with heavy-tailed delays and stalls."""

    span: int = setting(30, "s", least=2)
    """How many of the last seconds the hull is drawn under."""
    step_ns: int = setting(2_000_000, "ns", above=0)
    """A frame so far below the line, or nothing but frames so far above it, say that a clock was set."""
    back_ns: int = setting(50_000_000, "ns", above=0)
    """A frame may be late, its stamp is not: one that lies so far before the newest says that the system's clock was
    set back. Senders of several threads mix stamps by less."""
    late_ns: int = setting(1_500_000_000, "ns", above=0)
    """For so long, from frame to frame by whichever clock says less, all must have been above it: after an outage those
    that were held back come within a moment, and the last of them in time."""
    late_frames: int = setting(10, least=1)
    """So many of them at the least."""
    set_ns: int = setting(100_000_000, "ns", above=0)
    """In the first seconds a line may be wrong by what frames are late; one that is so far off was no line of this
    clock."""
    settled: int = setting(5, "s", least=2)
    """With fewer seconds the drift is not known, and the bound is what frames scatter by."""
    drift: float = setting(1.5e-3, above=0.0)
    """More drift than this is not believed: 119.88 Hz called 120 is 1e-3."""


class StampClock:
    """Maps stamps to local time. One thread updates it; any may read.

    Attributes:
        settings: it runs by.
        resets: how often a clock was set, and the estimate began anew.
    """

    def __init__(self, settings: StampClockSettings | None = None) -> None:
        """Knows nothing yet."""
        self.settings = settings or StampClockSettings()
        self.resets = 0
        self._counted = False
        self._drift: float | None = None  # as it was before the last reset
        self._begin(0, (0, 0))

    def _begin(self, stamp_ns: int, lowest: tuple[int, int]) -> None:
        """Anew, from a frame's stamp and the lowest point that holds: stamp and offset."""
        self._minima: deque[tuple[int, int]] = deque(maxlen=self.settings.span)
        self._second, self._newest = stamp_ns // SECOND_NS, stamp_ns
        self._lowest = lowest
        self._late = self._late_ns = 0  # frames above the line in a row, and for how long; last and lowest
        self._late_last, self._late_lowest = (0, 0), lowest
        self._line = (lowest[0], float(lowest[1]), self._drift or 0.0)  # stamp, offset there, drift
        self._frames, self._excess = 0, 0.0  # that came, and by how much they lay above the line, ns, all in all
        self._spread: tuple[float, float] | None = None  # ns, of the minima above the line; of the drift

    def update(self, stamp_ns: int, arrival_ns: int) -> None:
        """A frame with a stamp arrived, ns."""
        offset = arrival_ns - stamp_ns
        if not self._counted:
            self._counted = True
            self._begin(stamp_ns, (stamp_ns, offset))
        above, second = offset - self._offset(stamp_ns), stamp_ns // SECOND_NS
        back = self._newest - stamp_ns > self.settings.back_ns
        self._newest = max(self._newest, stamp_ns)
        if (-above > self.settings.step_ns and self._minima) or back:
            self._reset(stamp_ns, (stamp_ns, offset))
        elif self._is_set(stamp_ns, arrival_ns, above):
            self._reset(stamp_ns, self._late_lowest)
        else:
            if second > self._second:
                self._end_second(stamp_ns, offset, second)
            elif offset < self._lowest[1]:
                self._lowest = (stamp_ns, offset)
            self._touch(stamp_ns, offset)

    def _reset(self, stamp_ns: int, lowest: tuple[int, int]) -> None:
        if len(self._minima) >= self.settings.settled:  # whoever sets a clock does not change its crystal
            self._drift = self._line[2]
        # A line that was not yet known was wrong, and no clock set, unless it is that far off.
        if self.settled or abs(lowest[1] - self._offset(lowest[0])) > self.settings.set_ns:
            self.resets += 1
        self._begin(stamp_ns, lowest)
        self._frames = 1

    def _is_set(self, stamp_ns: int, arrival_ns: int, above: float) -> bool:
        """Whether nothing but late frames has come for so long that the clocks must be further apart than before."""
        if above <= self.settings.step_ns or not self._minima:
            self._late = 0
            return False
        if not self._late:
            self._late_ns, self._late_last = 0, (stamp_ns, arrival_ns)
        self._late += 1
        before, self._late_last = self._late_last, (stamp_ns, arrival_ns)
        self._late_ns += max(0, min(stamp_ns - before[0], arrival_ns - before[1]))
        # The first of them may be late frames from before the clock was set: what counts is the second half.
        if 2 * self._late_ns < self.settings.late_ns or arrival_ns - stamp_ns < self._late_lowest[1]:
            self._late_lowest = stamp_ns, arrival_ns - stamp_ns
        return self._late_ns >= self.settings.late_ns and self._late >= self.settings.late_frames

    def _end_second(self, stamp_ns: int, offset: int, second: int) -> None:
        """A second is over: its minimum joins the hull, unless all of it was late."""
        lowest = self._lowest
        self._second, self._lowest = second, (stamp_ns, offset)
        if self._minima and lowest[1] - self._offset(lowest[0]) > self.settings.step_ns:
            return
        self._minima.append(lowest)
        self._line = hull_edge(list(self._minima))
        if self._drift is not None and len(self._minima) < self.settings.settled:
            self._line = _highest(self._minima, self._drift)
        elif abs(self._line[2]) > self.settings.drift:  # in the first seconds, of few frames
            self._line = _highest(self._minima, copysign(self.settings.drift, self._line[2]))
        if len(self._minima) >= self.settings.settled:
            self._spread = self._scatter()

    def _touch(self, stamp_ns: int, offset: int) -> None:
        """No frame is early: where one lies below the line, the line lies too high."""
        above = offset - self._offset(stamp_ns)
        if above < 0.0:
            at, known, drift = self._line
            self._line = at, known + above, drift
        self._frames += 1
        self._excess += min(abs(above), self.settings.step_ns)

    def _scatter(self) -> tuple[float, float]:
        """How far the line may be off: ns at the minima, and for each ns beyond them.

        The minima above the line scatter more than the lowest of them, on which it rests; few of them show too little
        of it.
        """
        count = len(self._minima)
        squares = sum((offset - self._offset(stamp)) ** 2 for stamp, offset in self._minima)
        spread = (1.2 + 5.0 / count) * sqrt(squares / (count - 2))
        seconds_ns = self._minima[-1][0] - self._minima[0][0]
        return spread, min(self.settings.drift, 4.0 * spread / max(seconds_ns, SECOND_NS))

    def _offset(self, stamp_ns: int) -> float:
        at, offset, drift = self._line
        return offset + drift * (stamp_ns - at)

    @property
    def drift(self) -> float:
        """By how much the local clock is faster than the stamps', as a fraction."""
        return self._line[2]

    @property
    def settled(self) -> bool:
        """Whether drift and offset are known well enough to be corrected slowly from now on."""
        return len(self._minima) >= (3 if self._drift is None else 1)

    def local(self, stamp_ns: int) -> int:
        """When a frame with that stamp arrives if nothing holds it up, ns of the local clock."""
        return stamp_ns + round(self._offset(stamp_ns))

    def bound_ns(self, stamp_ns: int) -> int:
        """How far :meth:`local` may be off the least delay, ns; :data:`UNKNOWN_NS` before the second frame.

        What the minima scatter by, and the drift that this leaves open times the age of the newest of them; in the
        first seconds the mean by which frames were late. It is an estimate and not a guarantee: delays that are late
        for half a minute all alike show nothing.
        """
        if self._frames < 2:
            return UNKNOWN_NS
        scatter = self._excess / (self._frames - 1) if self._spread is None else self._spread[0]
        return round(scatter) + self.aged_ns(stamp_ns)

    def aged_ns(self, stamp_ns: int) -> int:
        """What the drift, as far as it is not known, has made of it since the newest minimum, ns."""
        unknown = self.settings.drift if self._drift is None else 0.1 * self.settings.drift  # it was known before
        drift = unknown if self._spread is None else self._spread[1]
        return round(drift * abs(stamp_ns - self.newest_ns))

    @property
    def newest_ns(self) -> int:
        """The newest stamp that the line rests on, ns."""
        return self._line[0] if self._spread is None else self._minima[-1][0]


def _highest(points: deque[tuple[int, int]], slope: float) -> tuple[int, float, float]:
    """The highest line of a known slope below all points, as :func:`hull_edge` gives one."""
    x, y = min(points, key=lambda point: point[1] - slope * point[0])
    return x, float(y), slope


def hull_edge(points: list[tuple[int, int]]) -> tuple[int, float, float]:
    """The edge of the lower convex hull under the middle of points in the order of their first coordinate.

    Returns:
        a first coordinate, the edge's value there, and its slope.
    """
    hull: list[tuple[int, int]] = []
    for x, y in points:
        while len(hull) > 1:
            (x0, y0), (x1, y1) = hull[-2:]
            if (y1 - y0) * (x - x0) < (y - y0) * (x1 - x0):
                break
            hull.pop()
        hull.append((x, y))
    if len(hull) == 1:
        return hull[0][0], float(hull[0][1]), 0.0
    middle = (points[0][0] + points[-1][0]) // 2
    right = next(i for i in range(1, len(hull)) if hull[i][0] >= middle)
    (x0, y0), (x1, y1) = hull[right - 1], hull[right]
    return x0, float(y0), (y1 - y0) / (x1 - x0)

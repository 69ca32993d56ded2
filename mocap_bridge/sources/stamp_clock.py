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

from highfive.model.settings import Settings, setting

SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class StampClockSettings(Settings):
    """Chosen on simulated clocks 50 ppm apart with heavy-tailed delays and stalls."""

    span: int = setting(30, "s", least=2)
    """How many of the last seconds the hull is drawn under."""
    step_ns: int = setting(2_000_000, "ns", above=0)
    """A frame so far below the line, or seconds whose earliest frames are so far above it, say that a clock was set."""
    late: int = setting(2, least=1)
    """Such seconds in a row."""


class StampClock:
    """Maps stamps to local time. One thread updates it; any may read."""

    def __init__(self, settings: StampClockSettings | None = None) -> None:
        """Knows nothing yet."""
        self.settings = settings or StampClockSettings()
        self.resets = -1
        self._begin(0, 0)
        self.resets = 0

    def _begin(self, stamp_ns: int, offset_ns: int) -> None:
        self._minima: deque[tuple[int, int]] = deque(maxlen=self.settings.span)
        self._second = stamp_ns // SECOND_NS
        self._lowest = (stamp_ns, offset_ns)
        self._above, self._counted = 0, False
        self._line = (stamp_ns, float(offset_ns), 0.0)  # stamp, offset there, drift
        self.resets += 1

    def update(self, stamp_ns: int, arrival_ns: int) -> None:
        """A frame with a stamp arrived, ns."""
        offset = arrival_ns - stamp_ns
        if not self._counted:
            self._begin(stamp_ns, offset)
            self._counted, self.resets = True, max(self.resets - 1, 0)
            return
        below = self._offset(stamp_ns) - offset
        second = stamp_ns // SECOND_NS
        if (below > self.settings.step_ns and self._minima) or second < self._second - 1:
            self._begin(stamp_ns, offset)
            self._counted = True
            return
        if second > self._second:
            self._end_second(stamp_ns, offset, second)
        elif offset < self._lowest[1]:
            self._lowest = (stamp_ns, offset)
        if below > 0.0:  # no frame is early: the line lies too high
            at, known, drift = self._line
            self._line = at, known - below, drift

    def _end_second(self, stamp_ns: int, offset: int, second: int) -> None:
        """A second is over: its minimum joins the hull, or says for how long all have been late."""
        lowest = self._lowest
        if self._minima and lowest[1] - self._offset(lowest[0]) > self.settings.step_ns:
            self._above += 1
        else:
            self._above = 0
        if self._above >= self.settings.late:
            self._begin(stamp_ns, offset)
            self._counted = True
            return
        self._minima.append(lowest)
        self._second, self._lowest = second, (stamp_ns, offset)
        if not self._above:
            self._line = hull_edge(list(self._minima))

    def _offset(self, stamp_ns: int) -> float:
        at, offset, drift = self._line
        return offset + drift * (stamp_ns - at)

    def local(self, stamp_ns: int) -> int:
        """When a frame with that stamp arrives if nothing holds it up, ns of the local clock."""
        return stamp_ns + round(self._offset(stamp_ns))


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

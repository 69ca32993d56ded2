"""What goes wrong between a motion capture system and whoever listens, on demand: pure, and the same for a seed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

KINDS = {
    "occlusion": "markers are hidden: names joined by +, or a share of all markers, hidden at random (occlusion=0.3)",
    "swap": "two markers have each other's label (swap=RWRA+RFIN)",
    "ghosts": "so many points per frame without a label, near the markers (ghosts=3)",
    "nan": "markers have coordinates that are no numbers (nan=RFIN)",
    "overflow": "markers have coordinates that no unit can hold (overflow=RFIN)",
    "metres": "numbers in metres where the protocol has millimetres",
    "reorder": "the labels come in another order in each frame",
    "gap": "so many frames are never sent, all at once (gap=12)",
    "stall": "nothing is sent",
    "burst": "nothing is sent, then all that was held back at once",
    "disconnect": "the server hangs up, and is back at the end",
}
"""Every fault and what it does."""

MOST_GHOSTS = 1000
"""Points without a label in a frame that can be requested."""

LONGEST_BURST_S = 60.0
"""So long frames can be held back, s: they wait in memory."""

_VALUED = {"occlusion", "swap", "ghosts", "nan", "overflow", "gap"}
_SPELLING = re.compile(r"(?P<kind>[a-z]+)(=(?P<value>[^@]+))?(@(?P<start>[\d.]+)(-(?P<end>[\d.]+))?)?")
_OVERFLOWS = 1e37  # m: a number of 32 bits, which in millimetres it is not any more
_SPREAD = 0.3  # m, of ghosts about a marker


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong from ``start`` to ``end``, s from the first frame.

    ``kind`` is one of :data:`KINDS`; ``names`` are markers, ``amount`` a number, where the kind has them.
    """

    kind: str
    start: float = 0.0
    end: float = np.inf
    names: tuple[str, ...] = ()
    amount: float = 0.0

    def on(self, time: float) -> bool:
        """Whether it is going on, ``time`` in s."""
        return self.start <= time < self.end


def parse_fault(text: str) -> Fault:
    """Reads ``kind=value@start-end``, times in s; without times all the time, without an end from then on.

    Raises:
        HighFiveError: it is spelt otherwise.
    """
    match = _SPELLING.fullmatch(text.strip())
    kind = match["kind"] if match else ""
    if not match or kind not in KINDS or (kind in _VALUED) != bool(match["value"]):
        what = "; ".join(f"{name}: {meaning}" for name, meaning in KINDS.items())
        raise HighFiveError(
            f"no fault {text!r}; a fault is kind=value@start-end, such as occlusion=RFIN+RMC5@2-2.3. {what}"
        )
    names, amount = (), 0.0
    try:
        start, end = float(match["start"] or 0.0), float(match["end"] or np.inf)
        if value := match["value"]:
            try:
                amount = float(value)
            except ValueError:
                names = tuple(value.split("+"))
    except ValueError:
        raise HighFiveError(f"fault {text!r}: the times are not numbers") from None
    if (
        start >= end
        or not 0.0 <= amount < 1e6
        or (kind in {"ghosts", "gap"} and names)
        or (kind == "swap" and len(set(names)) != 2)
        or (kind == "ghosts" and amount > MOST_GHOSTS)
        or (kind == "burst" and end - start > LONGEST_BURST_S)
        or (kind in {"nan", "overflow"} and not names)
        or (kind == "occlusion" and amount > 1.0)
    ):
        raise HighFiveError(f"fault {text!r} makes no sense; {kind}: {KINDS[kind]}")
    return Fault(kind, start, end, names, amount)


class Faults:
    """The faults of one replay. What is random depends on the seed and the frame alone."""

    def __init__(self, faults: Sequence[Fault], seed: int = 0):
        """Nothing is held back yet."""
        self._faults, self._seed = tuple(faults), seed
        self._held: list[MarkerFrame] = []

    def connected(self, time_ns: int) -> bool:
        """Whether the server is there."""
        return not self._on("disconnect", time_ns * 1e-9)

    def of(self, frame: MarkerFrame) -> list[MarkerFrame]:
        """What is sent in place of a frame: nothing, the frame with its faults, or all that was held back."""
        time = frame.source_time_ns * 1e-9
        if self._on("disconnect", time) or self._on("stall", time) or self._left_out(frame):
            return []
        self._held.append(self._spoilt(frame, time))
        if self._on("burst", time):
            return []
        sent, self._held = self._held, []
        return sent

    def _on(self, kind: str, time: float) -> list[Fault]:
        return [fault for fault in self._faults if fault.kind == kind and fault.on(time)]

    def _left_out(self, frame: MarkerFrame) -> bool:
        gaps = (fault for fault in self._faults if fault.kind == "gap")
        period = frame.source_time_ns / frame.number if frame.number else 0
        return any(0.0 <= frame.source_time_ns * 1e-9 - gap.start < (gap.amount - 0.5) * period * 1e-9 for gap in gaps)

    def _spoilt(self, frame: MarkerFrame, time: float) -> MarkerFrame:
        rng = np.random.default_rng([self._seed, frame.number])
        points, valid, loose = frame.positions.copy(), frame.valid.copy(), frame.unlabelled
        for fault in self._on("occlusion", time):
            if fault.names:
                valid[self._columns(frame, fault)] = False
            else:
                valid &= rng.random(len(valid)) >= fault.amount
        for fault in self._on("swap", time):
            one, other = self._columns(frame, fault)
            points[[one, other]], valid[[one, other]] = points[[other, one]], valid[[other, one]]
        for fault in self._on("nan", time):
            points[self._columns(frame, fault)] = np.nan
        for fault in self._on("overflow", time):
            points[self._columns(frame, fault)] = _OVERFLOWS
        for fault in self._on("ghosts", time):
            loose = np.concatenate([loose, _ghosts(points[valid], int(fault.amount), rng)])
        names = frame.names
        if self._on("reorder", time):
            order = rng.permutation(len(names))
            names, points, valid = tuple(names[m] for m in order), points[order], valid[order]
        if self._on("metres", time):
            points, loose = points * 1e-3, loose * 1e-3
        return replace(frame, names=names, positions=points, valid=valid, unlabelled=loose)

    @staticmethod
    def _columns(frame: MarkerFrame, fault: Fault) -> list[int]:
        """Columns of the markers that a fault names, with or without the person before the colon."""
        columns = []
        for name in fault.names:
            found = [m for m, label in enumerate(frame.names) if name in (label, label.rpartition(":")[2])]
            if not found:
                raise HighFiveError(f"fault {fault.kind}: no marker {name!r}; there are {', '.join(frame.names)}")
            columns += found[:1] if fault.kind == "swap" else found
        return columns


def _ghosts(points: Array, count: int, rng: np.random.Generator) -> Array:
    """Points (count, 3) strewn about points (n, 3)."""
    if not len(points):
        return np.zeros((0, 3))
    return points[rng.integers(len(points), size=count)] + rng.normal(scale=_SPREAD, size=(count, 3))

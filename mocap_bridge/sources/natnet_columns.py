"""Which marker of a NatNet frame is which: names from descriptions, places from numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.wire.natnet_frame import FILLED, MEASURED, OCCLUDED, UNLABELLED, Frame, z_up
from highfive.mocap_bridge.wire.natnet_model import Model
from highfive.mocap_bridge.wire.plausible import plausible, plausible_only


@np.errstate(invalid="ignore")  # a NaN may be of the signalling kind
def marker_frame(frame: Frame, columns: Columns, y_up: bool, clock_hz: int = 0) -> MarkerFrame:
    """A frame of the wire that fits ``columns``, z up; ``clock_hz`` is the unit of its finer time stamps,
    0 where that is not known."""
    turn = z_up if y_up else _as_it_is
    points, valid, loose = columns.place(frame)
    points, valid, impossible = plausible(turn(points), valid)
    return MarkerFrame(
        columns.names,
        points,
        valid,
        frame.number,
        round(frame.time * 1e9),
        0,
        plausible_only(turn(loose)),
        impossible=int(impossible),
        latency_ns=_latency_ns(frame, clock_hz),
    )


def _latency_ns(frame: Frame, clock_hz: int) -> int:
    """From the middle of the exposure until it was sent, ns; 0 where the server does not say, or cannot mean it."""
    if not frame.exposed or clock_hz <= 0:
        return 0
    latency = 1e9 * (frame.sent - frame.exposed) / clock_hz
    return max(0, round(latency))


def _as_it_is(points: NDArray[np.floating]) -> NDArray[np.float64]:
    return points.astype(np.float64)


class Columns:
    """Where each marker of a frame belongs.

    A set's points come in the order of its description; there a hidden marker is zero, or filled in from the asset's
    shape. What was seen is said by the labelled markers, which have numbers instead of names: the asset's, and the
    place in its set. Only rigid bodies, skeletons and assets have their number in the descriptions. Which number a mere
    set has shows in a frame: its points are the same in both places.
    """

    def __init__(self, model: Model):
        """Nothing is known of numbers that the descriptions do not have."""
        names: list[str] = []
        self._spans: dict[str, tuple[int, int]] = {}  # set -> first column and number of markers
        for one in model.sets:
            if one.name.lower() != "all":
                self._spans[one.name] = (len(names), len(one.markers))
                names += [_full_name(one.name, marker) for marker in one.markers]
        self.names = tuple(names)
        self._starts = np.zeros(len(names), dtype=np.intp)  # of each column's set
        for start, count in self._spans.values():
            self._starts[start : start + count] = start
        self._span_of = {number: self._spans[name] for name, number in model.ids.items() if name in self._spans}
        self._base: dict[int, int] = {}  # asset -> place that its markers are counted from
        self._ids: bytes | None = None  # those that the columns below are of
        self._rows = self._columns = np.zeros(0, dtype=np.intp)
        self._covered = np.zeros(len(names), dtype=bool)

    def fit(self, frame: Frame) -> bool:
        """Whether the descriptions are those of a frame."""
        return all(
            name.lower() == "all" or self._spans.get(name, (0, -1))[1] == len(points) for name, points in frame.sets
        )

    def place(self, frame: Frame) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]]:
        """Points (M, 3) m in the order of ``names``, which of them were seen (M,), and those without a label (U, 3)."""
        points, valid = np.zeros((len(self.names), 3), np.float32), np.zeros(len(self.names), dtype=bool)
        for name, given in frame.sets:
            if name in self._spans:
                start, count = self._spans[name]
                points[start : start + count] = given
                valid[start : start + count] = given.any(axis=1)
        markers, flags = frame.labelled, frame.labelled["flags"]
        if not len(markers):
            return points, valid, frame.others
        if markers["id"].tobytes() != self._ids:
            self._find(markers, points, valid)
        # Filled in from the asset's shape, and not measured, is not seen either.
        hidden = (flags & OCCLUDED).astype(bool) | ((flags & (FILLED | MEASURED)) == FILLED)
        valid[self._covered] = False
        valid[self._columns] = ~hidden[self._rows]
        points[self._columns] = markers["point"][self._rows]
        return points, valid, _without_label(frame, (flags & UNLABELLED).astype(bool) & ~hidden)

    def _find(self, markers: NDArray[np.void], points: NDArray[np.float32], valid: NDArray[np.bool_]) -> None:
        """Finds the column of each labelled marker."""
        ids, labelled = markers["id"], (markers["flags"] & UNLABELLED) == 0
        assets, places = ids >> 16, (ids & 0xFFFF).astype(np.intp)
        columns, sure = np.full(len(ids), -1, dtype=np.intp), True
        taken = set(self._span_of.values())
        guesses = [] if valid.any() else [span for span in self._spans.values() if span not in taken]
        given = {point: column for column, point in enumerate(map(tuple, points.tolist())) if any(point)}
        for asset in np.unique(assets[labelled]).tolist():
            rows = np.flatnonzero(labelled & (assets == asset))
            base = self._base.setdefault(asset, int(places[rows].min() > 0))
            found = np.array([given.get(tuple(point), -1) for point in markers["point"][rows].tolist()])
            span = self._span_of.get(asset) or self._recognised(found, places[rows] - base)
            if span:
                self._span_of[asset] = span
            else:
                sure = False  # look again in the next frame; until then the order of the descriptions
                span = guesses.pop(0) if guesses else (0, 0)
            inside = rows[(places[rows] >= base) & (places[rows] - base < span[1])]
            columns[inside] = span[0] + places[inside] - base
            # Points are named by their set; should the numbers say otherwise, it is them that are misunderstood.
            other = (found >= span[0]) & (found < span[0] + span[1]) & (found != columns[rows])
            columns[rows[other]], sure = found[other], sure and not other.any()
        self._rows = np.flatnonzero(columns >= 0)
        self._columns = columns[self._rows]
        self._covered = np.isin(self._starts, self._starts[self._columns])
        self._ids = ids.tobytes() if sure else None

    def _recognised(self, columns: NDArray[np.intp], places: NDArray[np.intp]) -> tuple[int, int] | None:
        """The set in which most markers of an asset have the same point in the same place.

        Args:
            columns: (n,) where each marker's point is among the sets' points; -1 for nowhere.
            places: (n,) each marker's place in its asset.
        """
        same = columns[(columns >= 0) & (self._starts[columns] + places == columns)]
        if not len(same):
            return None
        starts, votes = np.unique(self._starts[same], return_counts=True)
        span = next(span for span in self._spans.values() if span[0] == starts[votes.argmax()] and span[1])
        return None if span in self._span_of.values() else span


def _full_name(group: str, marker: str) -> str:
    """``'MarkerSet:Marker'``, whether or not the marker's own name begins with the set's."""
    for mark in ":_":
        marker = marker.removeprefix(group + mark) or marker
    return f"{group}:{marker}" if group else marker


def _without_label(frame: Frame, flagged: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Points without a label: those that say so, and those that are not among the markers with a number.

    Motive's list of other markers has held labelled ones too, depending on its version.
    """
    loose = frame.labelled["point"][flagged]
    if not len(frame.others):
        return loose
    known = set(map(tuple, frame.labelled["point"].tolist()))
    others = [point for point in frame.others.tolist() if tuple(point) not in known]
    return np.concatenate([loose, np.array(others, np.float32).reshape(-1, 3)])

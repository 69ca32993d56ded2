"""Which hands two people meet with, and the mirror image of a recording: the avatar raises its right hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.pair_frame import Pair
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.model.geometry.rotations import Array

SIDES = ("right", "left")
CLEARLY = 0.05
"""Another pair of hands than the two right ones has to come nearer by so much, m."""


@dataclass(frozen=True)
class Hands:
    """The hands with which the people of a set meet.

    Attributes:
        person, actor: 'right' or 'left'.
        distance: m, median over the trials of how near they come.
        fraction: of the trials, in which these hands come nearest or within 5 cm of the nearest.
    """

    person: str
    actor: str
    distance: float
    fraction: float


def meeting_hands(pairs: Sequence[Pair], people: MarkerSet, actors: MarkerSet) -> Hands:
    """The hands that come nearest over the whole set; the right ones where the others are not clearly nearer."""
    nearest = np.array([_nearest(*pair, people, actors) for pair in pairs])
    typical = [float(np.median(d[np.isfinite(d)])) if np.isfinite(d).any() else np.inf for d in nearest.T]
    best = int(np.argmin(typical))
    chosen = best if typical[best] < typical[0] - CLEARLY else 0
    near = nearest[:, chosen] <= nearest.min(axis=1) + CLEARLY
    return Hands(SIDES[chosen // 2], SIDES[chosen % 2], typical[chosen], float(near.mean()))


def mirror_columns(marker_set: MarkerSet) -> NDArray[np.intp]:
    """For each marker (M,) the one that a mirror puts in its place, or -1."""
    flipped = marker_set.local_positions * [1.0, -1.0, 1.0]
    columns = np.full(len(marker_set), -1, dtype=np.intp)
    for m, joint in enumerate(marker_set.joints):
        other = _other_side(joint)
        gaps = np.linalg.norm(marker_set.local_positions - flipped[m], axis=1)
        gaps[[name != other for name in marker_set.joints]] = np.inf
        if gaps.min() < 1e-3:
            columns[m] = int(np.argmin(gaps))
    return columns


def mirrored(recording: Recording, marker_set: MarkerSet) -> Recording:
    """The mirror image in the plane y = 0: what was left is right. It has the set's markers in the set's order.

    Markers without a counterpart come out unseen.
    """
    points, seen = marker_set.arrange(recording.names, recording.points, recording.valid)
    columns = mirror_columns(marker_set)
    seen = seen[:, columns] & (columns >= 0)
    points = np.where(seen[..., None], points[:, columns] * [1.0, -1.0, 1.0], 0.0)
    ghosts = recording.unlabelled * [1.0, -1.0, 1.0]
    return replace(recording, names=marker_set.names, points=points, valid=seen, unlabelled=ghosts)


def _other_side(joint: str) -> str:
    for side, other in (("left_", "right_"), ("right_", "left_")):
        if joint.startswith(side):
            return other + joint.removeprefix(side)
    return joint


def _nearest(person: Recording, actor: Recording, people: MarkerSet, actors: MarkerSet) -> list[float]:
    """Smallest distances, m, of the hands: right–right, right–left, left–right, left–left (person first)."""
    distances = []
    for one in _hands(person, people):
        for other in _hands(actor, actors):
            gap = np.linalg.norm(one - other, axis=1)
            distances.append(float(gap[np.isfinite(gap)].min(initial=np.inf)))
    return distances


def _hands(recording: Recording, marker_set: MarkerSet) -> list[Array]:
    """Tracks (T, 3), m, of the right and the left hand, NaN where not seen."""
    points, seen = marker_set.arrange(recording.names, recording.points, recording.valid)
    points = np.where(seen[..., None], points, np.nan)
    right = marker_set.indices(marker_set.arm.hand or marker_set.arm.wrist)
    left = mirror_columns(marker_set)[right]
    if (left < 0).any():
        return [points[:, right].mean(axis=1), np.full((len(points), 3), np.nan)]
    return [points[:, columns].mean(axis=1) for columns in (right, left)]

"""Which joint centre a point is, from how the points move: for recordings whose labels say nothing.

Points joined by a bone keep their distance. Legs and arms are the pairs of three-point chains that keep it best, with
lengths as people have them (fractions of stature after Winter 2009, fig. 4.1, as in ``scenes/anthropometry.py``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from highfive.mocap_bridge.files.recording import Recording
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

_FRAMES = 150  # looked at of each recording
_TOPMOST = 0.93  # height of the highest joint centre, which is no crown, in statures

_MIDLINE = 0.02  # statures by which a point of the midline may be nearer to one hip than to the other

Chain = tuple[int, int, int]


@dataclass(frozen=True)
class _Limb:
    """What is known of a limb: heights of its three joints and lengths of its two bones, in statures, and its girdle's.

    ``heights`` are (lowest, highest) that the three joints may have, ``width`` is between left and right first joint.
    """

    heights: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    bones: tuple[float, float]
    width: float


_LEG = _Limb(((0.42, 0.64), (0.18, 0.38), (-0.02, 0.14)), (0.245, 0.246), 0.104)
_ARM = _Limb(((0.70, 0.92), (0.45, 1.1), (0.30, 1.3)), (0.186, 0.146), 0.214)


@dataclass(frozen=True)
class _Points:
    """M points: heights (M,) and mean distances (M, M) in statures, their spread (M, M) about it, positions a frame."""

    height: Array
    distance: Array
    spread: Array
    tracks: list[Array]
    up: Array


def recognise_shape(recordings: Sequence[Recording]) -> dict[str, str]:
    """Canonical joint centre -> label, from recordings of people with the same labels in the same order.

    The axes are taken to be right-handed.

    Raises:
        HighFiveError: no two legs and two arms are found, or no feet that show which side is left.
    """
    tracks = [_track(recording) for recording in recordings]
    extent = np.median([np.nanmedian(np.nanmax(t, axis=1) - np.nanmin(t, axis=1), axis=0) for t in tracks], axis=0)
    axis = int(np.argmax(extent))
    found = []
    for sign in (1.0, -1.0):
        points = _measure(tracks, sign * np.eye(3)[axis])
        legs = _best_pair(points, _LEG, (), ())
        if legs is None:
            continue
        hips = legs[1][0], legs[2][0]
        arms = _best_pair(points, _ARM, (*legs[1], *legs[2], *_midline(points, *hips)), hips)
        if arms is not None:
            found.append((legs[0] + arms[0], points, legs[1:], arms[1:]))
    if not found:
        raise HighFiveError("the points do not move like the joints of two arms and two legs")
    _, points, legs, arms = min(found, key=lambda option: option[0])
    known = _named(points, legs, arms)
    names = recordings[0].names
    return {name: names[m] for name, m in known.items()}


def _track(recording: Recording) -> Array:
    """Positions (T, M, 3) of some frames, NaN where not seen."""
    step = max(1, len(recording) // _FRAMES)
    return np.where(recording.valid[::step, :, None], recording.points[::step], np.nan)


def _measure(tracks: Sequence[Array], up: Array) -> _Points:
    heights, distances, spreads = [], [], []
    for track in tracks:
        lowest, highest = np.nanmin(track @ up, axis=1), np.nanmax(track @ up, axis=1)
        stature = float(np.nanmedian(highest - lowest)) / _TOPMOST
        unseen = np.isnan(track).all(axis=(0, 2))
        level = np.where(unseen, np.nan, (track @ up - lowest[:, None]) / stature)
        heights.append(_median(level))
        gaps = np.linalg.norm(track[:, :, None] - track[:, None], axis=-1) / stature
        typical = _median(gaps)
        distances.append(typical)
        spreads.append(_median(np.abs(gaps - typical)))
    height, distance, spread = (np.nan_to_num(_median(np.array(v)), nan=9.0) for v in (heights, distances, spreads))
    return _Points(height, distance, spread, list(tracks), up)


def _median(values: Array) -> Array:
    """Median over the first axis without NaN; NaN where all are."""
    none = np.isnan(values).all(axis=0)
    return np.where(none, np.nan, np.nanmedian(np.where(none, 0.0, values), axis=0))


def _midline(points: _Points, one: int, other: int) -> list[int]:
    """Points that are always as far from one of two points as from the other."""
    gaps = [np.linalg.norm(track - track[:, [m]], axis=-1) for track in points.tracks for m in (one, other)]
    apart = [_median(np.abs(a - b)) / np.nanmedian(a[:, other]) for a, b in zip(gaps[::2], gaps[1::2], strict=True)]
    width = points.distance[one, other]
    return np.flatnonzero(_median(np.array(apart)) * width < _MIDLINE).tolist()


def _best_pair(
    points: _Points, limb: _Limb, taken: Sequence[int], anchors: Sequence[int]
) -> tuple[float, Chain, Chain] | None:
    """Cost and the two chains, mirror images of each other, that are most like the limb.

    Args:
        points: what is known of the points.
        limb: how long and where it is.
        taken: points that belong to others.
        anchors: points from which the first joint hardly moves away.
    """
    chains = _chains(points, limb, taken, anchors)
    best = None
    for (cost, one), (other_cost, other) in combinations(chains, 2):
        if set(one) & set(other) or _crossed(points, one, other):
            continue
        total = cost + other_cost
        for i, j in ((0, 1), (1, 2)):
            total += 4.0 * abs(np.log(points.distance[one[i], one[j]] / points.distance[other[i], other[j]]))
        total += abs(np.log(max(points.distance[one[0], other[0]], 1e-3) / limb.width))
        if best is None or total < best[0]:
            best = (float(total), one, other)
    return best


def _crossed(points: _Points, one: Chain, other: Chain) -> bool:
    """A joint of one side goes better with the next joint of the other side."""
    d = points.distance
    return any(
        d[one[i], one[i + 1]] + d[other[i], other[i + 1]] > d[one[i], other[i + 1]] + d[other[i], one[i + 1]]
        for i in (0, 1)
    )


def _chains(
    points: _Points, limb: _Limb, taken: Sequence[int], anchors: Sequence[int], most: int = 60
) -> list[tuple[float, Chain]]:
    """The likeliest chains of three points with their costs."""
    fits = [
        [m for m in range(len(points.height)) if low <= points.height[m] <= high and m not in taken]
        for low, high in limb.heights
    ]
    chains = []
    for middle in fits[1]:
        for first in fits[0]:
            for last in fits[2]:
                if len({first, middle, last}) < 3:
                    continue
                lengths = points.distance[first, middle], points.distance[middle, last]
                misfit = [abs(np.log(max(got, 1e-3) / usual)) for got, usual in zip(lengths, limb.bones, strict=True)]
                if max(misfit) > 0.5:
                    continue
                spread = points.spread[first, middle] / lengths[0] + points.spread[middle, last] / lengths[1]
                loose = sum(points.spread[first, m] / points.distance[first, m] for m in anchors)
                ratio = abs(np.log(lengths[0] / lengths[1] * limb.bones[1] / limb.bones[0]))
                chains.append((20.0 * (spread + loose) + sum(misfit) + 2.0 * ratio, (first, middle, last)))
    return sorted(chains)[:most]


def _named(points: _Points, legs: tuple[Chain, Chain], arms: tuple[Chain, Chain]) -> dict[str, int]:
    """Canonical names of the points, given the limbs in no order of sides."""
    used = {m for chain in (*legs, *arms) for m in chain}
    feet = [_near(points, legs[i][2], legs[1 - i][2], used, 0.20) for i in (0, 1)]
    if not all(feet):
        raise HighFiveError("the points show arms and legs, but no toes that would tell left from right")
    # Of all points of a foot the toes are the furthest from the ankle.
    toes = [max(foot, key=lambda m: points.distance[leg[2], m]) for foot, leg in zip(feet, legs, strict=True)]
    ahead = [sum(t[:, toe] - t[:, leg[2]] for toe, leg in zip(toes, legs, strict=True)) for t in points.tracks]
    left = [np.cross(points.up, a) for a in ahead]
    if _across(points, left, legs[0][0], legs[1][0]) < 0.0:
        legs, toes = (legs[1], legs[0]), toes[::-1]
    if _across(points, left, arms[0][0], arms[1][0]) < 0.0:
        arms = arms[1], arms[0]
    known: dict[str, int] = {}
    for i, side in enumerate(("left", "right")):
        known |= {f"{side}_{name}": m for name, m in zip(("hip", "knee", "ankle"), legs[i], strict=True)}
        known |= {f"{side}_{name}": m for name, m in zip(("shoulder", "elbow", "wrist"), arms[i], strict=True)}
        known[f"{side}_ball"] = toes[i]
        _, elbow, wrist = arms[i]
        # The thumb is beside the hand, not beyond it.
        hand = [
            m
            for m in _near(points, wrist, arms[1 - i][2], used, 0.13)
            if points.distance[elbow, m] > points.distance[elbow, wrist] + 0.8 * points.distance[wrist, m]
        ]
        if hand:
            known[f"{side}_hand_tip"] = max(hand, key=lambda m: points.distance[wrist, m])
    return known | _middle(points, known)


def _across(points: _Points, left: Sequence[Array], one: int, other: int) -> float:
    """How far the first of two points lies to the left of the second, a mean over all frames."""
    sums = [np.nanmean(np.sum((t[:, one] - t[:, other]) * s, axis=1)) for t, s in zip(points.tracks, left, strict=True)]
    return float(np.mean(sums))


def _near(points: _Points, end: int, other: int, used: set[int], reach: float) -> list[int]:
    """Points that keep their distance from the end of a limb and are nearer to it than to that of the other side."""
    near = np.flatnonzero(points.distance[end] < reach).tolist()
    return [
        m
        for m in near
        if m not in used
        and points.distance[end, m] < points.distance[other, m]
        and points.spread[end, m] < 0.12 * points.distance[end, m]
    ]


def _middle(points: _Points, known: dict[str, int]) -> dict[str, int]:
    """Pelvis, trunk, neck and head: the points as far from the left as from the right hip and shoulder."""
    hips, shoulders = ([known[f"{side}_{joint}"] for side in ("left", "right")] for joint in ("hip", "shoulder"))
    middle = [
        m
        for m in range(len(points.height))
        if m not in known.values()
        and all(abs(points.distance[m, a] - points.distance[m, b]) < 0.02 for a, b in (hips, shoulders))
    ]
    middle.sort(key=lambda m: points.height[m])
    hip, shoulder = (float(points.height[pair].mean()) for pair in (hips, shoulders))
    low = [m for m in middle if abs(points.height[m] - hip) < 0.075]
    trunk = [m for m in middle if hip + 0.075 <= points.height[m] < shoulder - 0.01]
    high = [m for m in middle if shoulder - 0.01 <= points.height[m]]
    found = {"pelvis": low[0]} if low else {}
    slots = {1: (3,), 2: (2, 4), 3: (1, 3, 4)}.get(len(trunk), (1, 2, 3, 4))
    for i, slot in enumerate(slots if trunk else ()):
        found[f"trunk_{slot}"] = trunk[round(i * (len(trunk) - 1) / max(len(slots) - 1, 1))]
    if high:
        found["neck"] = high[0]
    if len(high) > 1:
        found["head"] = high[-1]
    return found

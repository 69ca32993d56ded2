"""The skeleton as the tracker sees it: the segments of a marker set, joined by hinges, with every number in arrays.

Segments without a parent in the set move freely; all others turn about their joint. Which turns a joint has, how far
from rest it may be expected and how fast it is driven is anatomy, and the same for every marker set.
"""

from __future__ import annotations

import numpy as np

from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.tracking.chain_kinematics import HINGE, SHIFT, TURN, Chain
from highfive.mocap_bridge.tracking.filter_settings import FilterSettings
from highfive.model.geometry.rotations import Array

_TILT = 0.35  # rad, standard deviation of a free segment from upright
_HEADING = 0.6  # rad, of a free segment from where the head looks

Turn = tuple[str, float, float, float]
"""Axis, standard deviation about rest, rad, rest angle, rad, and power of the accelerations that drive it, rad²/s³."""

# Turns from parent to child, about the axes of scenes/anthropometry.py. Powers: a raised arm reaches 300 rad/s² for a
# tenth of a second, but what is driven that hard is noise when it is seen, and is not predicted when it is not;
# these are the ones with which hidden hands were found best (simulated high fives, CMU 85).
_TURNS: dict[str, tuple[Turn, ...]] = {
    "clavicle": (("z", 0.25, 0.0, 20.0), ("x", 0.25, 0.0, 20.0)),
    "shoulder": (("y", 1.2, -0.5, 200.0), ("x", 0.7, 0.0, 200.0), ("z", 1.0, 0.0, 200.0)),
    # The carrying angle hardly changes, but markers say little of where in the arm the elbow's axis lies.
    "elbow": (("y", 1.0, -0.7, 300.0), ("x", 0.08, 0.0, 90.0), ("z", 0.8, 0.0, 100.0)),
    "wrist": (("x", 0.7, 0.0, 50.0), ("y", 0.5, 0.0, 25.0)),
    "hip": (("y", 0.7, 0.0, 150.0), ("x", 0.3, 0.0, 30.0), ("z", 0.3, 0.0, 30.0)),
    "knee": (("y", 0.7, 0.3, 150.0), ("z", 0.1, 0.0, 3.0)),
    "ankle": (("y", 0.4, 0.0, 50.0), ("x", 0.3, 0.0, 30.0), ("z", 0.3, 0.0, 30.0)),
    "toe": (("y", 0.3, 0.0, 30.0),),
    "neck": (("y", 0.3, 0.0, 20.0), ("x", 0.2, 0.0, 10.0), ("z", 0.4, 0.0, 30.0)),
    "head": (("y", 0.4, 0.0, 50.0), ("x", 0.3, 0.0, 30.0), ("z", 0.6, 0.0, 100.0)),
}
_TRUNK = (("y", 0.3, 0.0, 30.0), ("x", 0.2, 0.0, 10.0), ("z", 0.3, 0.0, 30.0))
_FINGER = (("x", 0.7, 0.0, 150.0), ("y", 0.2, 0.0, 10.0))
_DIGITS = ("thumb", "index", "middle", "ring", "little")
_SHIFT_POWER, _TURN_POWER = 5.0, 20.0  # m²/s³ and rad²/s³, of a free segment

# s, in which a speed falls to a third where nothing is seen: no one keeps a speed for long.
_COASTING = {"wrist": 0.07, "elbow": 0.07}
_OTHERS_COASTING = 0.1


def segment_order(marker_set: MarkerSet) -> list[str]:
    """The set's segments, every parent before its children: the order of a :class:`Chain`."""
    order: list[str] = []
    waiting = list(marker_set.segments)
    while waiting:
        ready = [name for name in waiting if marker_set.segments[name].parent in (None, *order)]
        order += ready
        waiting = [name for name in waiting if name not in ready]
    return order


def make_chain(marker_set: MarkerSet, settings: FilterSettings | None = None) -> Chain:
    """The chain of a marker set, on the body for which the set was written."""
    settings = settings or FilterSettings()
    names = segment_order(marker_set)
    segments = [marker_set.segments[name] for name in names]
    parents = [-1 if s.parent is None else names.index(s.parent) for s in segments]
    offsets = [s.centre - (segments[p].centre if p >= 0 else 0.0) for s, p in zip(segments, parents, strict=True)]
    rows: list[tuple[int, int, int, float, float, float]] = []  # kind, axis, joint, rest, stiffness, power
    first, path = [], []
    for joint, (name, parent) in enumerate(zip(names, parents, strict=True)):
        first.append(len(rows))
        if parent < 0:
            rows += [(SHIFT, axis, joint, 0.0, 0.0, _SHIFT_POWER) for axis in range(3)]
            away = (_TILT, _TILT, _HEADING)
            rows += [(TURN, axis, joint, 0.0, away[axis] ** -2, _TURN_POWER) for axis in range(3)]
        else:
            plain = _plain(name)
            turns = _TURNS.get(plain, _FINGER if plain.partition("_")[0] in _DIGITS else _TRUNK)
            rows += [(HINGE, "xyz".index(axis), joint, rest, sd**-2, power) for axis, sd, rest, power in turns]
        path.append(([] if parent < 0 else path[parent]) + list(range(first[-1], len(rows))))
    kind, axis, moved, rest, stiffness, power = (np.array(column) for column in zip(*rows, strict=True))
    longest = max(len(p) for p in path)
    free = [name for name, parent in zip(names, parents, strict=True) if parent < 0]
    return Chain(
        parents=np.array(parents),
        offsets=np.array(offsets, dtype=float),
        first=np.array(first),
        count=np.diff([*first, len(rows)]),
        kind=kind,
        axis=axis,
        joint=moved,
        rest=rest.astype(float),
        stiffness=stiffness.astype(float),
        power=power.astype(float),
        coasting=settings.coasting * np.array([_COASTING.get(_plain(names[j]), _OTHERS_COASTING) for j in moved]),
        path=np.array([p + [-1] * (longest - len(p)) for p in path]),
        lengths=np.array([len(p) for p in path]),
        carrier=np.array([names.index(joint) for joint in marker_set.joints]),
        places=np.array(marker_set.local_positions, dtype=float),
        spreads=np.array(marker_set.spreads, dtype=float),
        strangeness=_strangeness(marker_set, names, parents, offsets),
        head=names.index("head") if "head" in free and len(free) > 1 else -1,
        settings=settings.compiled(),
    )


def _strangeness(marker_set: MarkerSet, names: list[str], parents: list[int], offsets: list[Array]) -> Array:
    """Variance (M,), m², of a coordinate of each marker on somebody whose size and pose are known.

    An error of a length lies along the segment, but counts for every coordinate alike here.
    """
    to_joint = np.zeros(len(names))
    for j, parent in enumerate(parents):  # a parent stands before its children
        if parent >= 0:
            relative = marker_set.segments[names[parent]].relative_sigma
            to_joint[j] = to_joint[parent] + (relative * np.linalg.norm(offsets[j])) ** 2 / 3.0
    carriers = [names.index(joint) for joint in marker_set.joints]
    return np.square(marker_set.spreads) + to_joint[carriers]


def _plain(name: str) -> str:
    return name.removeprefix("left_").removeprefix("right_")

"""The tracker's chain as a model of OpenSim and of biorbd: the same segments, joints, axes and markers as text files.

A chain's angles in the order of its freedoms are the coordinates of both, so that what any of the three finds can be
put into the same forward kinematics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.tracking.chain import SHIFT, TURN, make_chain, segment_order
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

_HINGES = "xyz"


@dataclass(frozen=True)
class PeerModel:
    """S segments (a parent before its children), n coordinates, M markers.

    Attributes:
        segments: names.
        parents: index of each segment's parent, -1 for the ground.
        offsets: (S, 3) m, the joint's centre from its parent's in the zero pose; from the floor without a parent.
        free: (S,) the segment moves along x, y, z; these are its first three coordinates.
        turns: for each segment the axes that it turns about, from parent to child.
        markers: names.
        carrier: (M,) the segment of each marker.
        places: (M, 3) m, in the segment's frame.
    """

    segments: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Array
    free: NDArray[np.bool_]
    turns: tuple[str, ...]
    markers: tuple[str, ...]
    carrier: NDArray[np.intp]
    places: Array

    @property
    def coordinates(self) -> list[tuple[int, str, str]]:
        """Of each coordinate the segment, the axis, and ``'shift'`` or ``'turn'``."""
        rows: list[tuple[int, str, str]] = []
        for s, turns in enumerate(self.turns):
            rows += [(s, axis, "shift") for axis in _HINGES if self.free[s]]
            rows += [(s, axis, "turn") for axis in turns]
        return rows

    @property
    def unsteady(self) -> NDArray[np.bool_]:
        """(n,) turns of free segments that carry too few markers to show them."""
        carried = np.bincount(self.carrier, minlength=len(self.segments))
        return np.array([kind == "turn" and self.free[s] and carried[s] < 3 for s, _, kind in self.coordinates])

    def frames(self, coordinates: Array) -> tuple[Array, Array]:
        """Centres (T, S, 3), m, and orientations (T, S, 4), quaternions, of the segments at coordinates (T, n)."""
        count = len(coordinates)
        centres, turned = np.empty((count, len(self.segments), 3)), np.empty((count, len(self.segments), 4))
        column = 0
        for s, parent in enumerate(self.parents):
            base = turned[:, parent] if parent >= 0 else np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
            away = np.tile(self.offsets[s], (count, 1))
            if self.free[s]:
                away, column = away + coordinates[:, column : column + 3], column + 3
            start = centres[:, parent] if parent >= 0 else np.zeros((count, 3))
            centres[:, s], own = start + rotations.rotate(base, away), base
            for axis in self.turns[s]:
                own, column = (
                    rotations.multiply(own, rotations.from_axis_angle(axis, coordinates[:, column])),
                    column + 1,
                )
            turned[:, s] = own
        return centres, turned

    def marker_positions(self, coordinates: Array) -> Array:
        """Markers (T, M, 3), m, in the world at coordinates (T, n)."""
        centres, turned = self.frames(coordinates)
        return centres[:, self.carrier] + rotations.rotate(turned[:, self.carrier], self.places)


def peer_model(
    marker_set: MarkerSet, markers: Sequence[str], fixed: Sequence[str] = (), rigid: Sequence[str] = ()
) -> PeerModel:
    """The chain of a marker set with only ``markers`` and the segments that they need.

    Args:
        marker_set: the set, on the body that is to be modelled.
        markers: names of those that are given to the peers.
        fixed: segments that do not move at all.
        rigid: hinges that do not turn, as ``'right_elbow.x'``.
    """
    chain, order = make_chain(marker_set), segment_order(marker_set)
    rows = marker_set.indices(markers)
    needed: set[int] = set()
    for m in rows:
        j = int(chain.carrier[m])
        while j >= 0:
            needed.add(j)
            j = int(chain.parents[j])
    kept = sorted(needed)
    turns, free = [], []
    for j in kept:
        own = range(chain.first[j], chain.first[j] + chain.count[j])
        still = order[j] in fixed
        free.append(not still and any(chain.kind[d] == SHIFT for d in own))
        axes = [_HINGES[chain.axis[d]] for d in own if chain.kind[d] != SHIFT]
        turns.append("" if still else "".join(axis for axis in axes if f"{order[j]}.{axis}" not in rigid))
    return PeerModel(
        segments=tuple(order[j] for j in kept),
        parents=tuple(kept.index(chain.parents[j]) if chain.parents[j] >= 0 else -1 for j in kept),
        offsets=chain.offsets[kept],
        free=np.array(free),
        turns=tuple(turns),
        markers=tuple(marker_set.names[m] for m in rows),
        carrier=np.array([kept.index(int(chain.carrier[m])) for m in rows]),
        places=chain.places[rows],
    )


def start_of(model: PeerModel, marker_set: MarkerSet, centres: Array, frames: Array, angles: Array) -> Array:
    """Coordinates (n,) of a pose of the set's own chain: ``centres`` (J, 3), ``frames`` (J, 3, 3), ``angles`` (D,)."""
    chain, order = make_chain(marker_set), segment_order(marker_set)
    values = []
    for s, axis, kind in model.coordinates:
        j = order.index(model.segments[s])
        if kind == "shift":
            a = _HINGES.index(axis)
            values.append(centres[j, a] - model.offsets[s, a])
            continue
        own = [d for d in range(chain.first[j], chain.first[j] + chain.count[j]) if _HINGES[chain.axis[d]] == axis]
        d = next(d for d in own if chain.kind[d] != SHIFT)
        if chain.kind[d] == TURN:
            values.append(float(_xyz(frames[j])[_HINGES.index(axis)]))
        else:
            values.append(float(angles[d]))
    return np.array(values)


def _xyz(matrix: Array) -> Array:
    """Angles (3,), rad, about x, then the turned y, then the turned z, of a rotation matrix."""
    x, z = np.arctan2(-matrix[1, 2], matrix[2, 2]), np.arctan2(-matrix[0, 1], matrix[0, 0])
    return np.array([x, np.arcsin(np.clip(matrix[0, 2], -1.0, 1.0)), z])


def biorbd_text(model: PeerModel) -> str:
    """The model as a ``.bioMod`` file."""
    lines = ["version 4", "gravity 0 0 -9.81", ""]
    for s, name in enumerate(model.segments):
        parent = model.segments[model.parents[s]] if model.parents[s] >= 0 else "root"
        lines += [f"segment {name}", f"  parent {parent}", "  rtinmatrix 0"]
        lines += [f"  rt 0 0 0 xyz {_numbers(model.offsets[s])}"]
        lines += ["  translations xyz"] if model.free[s] else []
        lines += [f"  rotations {model.turns[s]}"] if model.turns[s] else []
        lines += ["  mass 1", "  inertia 0.01 0 0 0 0.01 0 0 0 0.01", "  com 0 0 0", "endsegment", ""]
    for m, name in enumerate(model.markers):
        carrier = model.segments[model.carrier[m]]
        lines += [f"marker {name}", f"  parent {carrier}", f"  position {_numbers(model.places[m])}"]
        lines += ["  technical 1", "endmarker", ""]
    return "\n".join(lines)


def opensim_text(model: PeerModel) -> str:
    """The model as an ``.osim`` file; coordinate number i is called ``q<i>``."""
    bodies, joints, number = [], [], 0
    for s, name in enumerate(model.segments):
        bodies.append(
            f'<Body name="{name}"><mass>1</mass><mass_center>0 0 0</mass_center>'
            "<inertia>0.01 0.01 0.01 0 0 0</inertia></Body>"
        )
        count = 3 * int(model.free[s]) + len(model.turns[s])
        parent = f"/bodyset/{model.segments[model.parents[s]]}" if model.parents[s] >= 0 else "/ground"
        joints.append(_joint(model, s, parent, range(number, number + count)))
        number += count
    markers = [
        f'<Marker name="{name}"><socket_parent_frame>/bodyset/{model.segments[model.carrier[m]]}</socket_parent_frame>'
        f"<location>{_numbers(model.places[m])}</location><fixed>true</fixed></Marker>"
        for m, name in enumerate(model.markers)
    ]
    parts = [
        f'<{kind} name="{kind.lower()}"><objects>\n' + "\n".join(items) + f"\n</objects></{kind}>"
        for kind, items in (("BodySet", bodies), ("JointSet", joints), ("MarkerSet", markers))
    ]
    return (
        '<?xml version="1.0" encoding="UTF-8" ?>\n<OpenSimDocument Version="40000"><Model name="chain">\n'
        + "\n".join(parts)
        + "\n</Model></OpenSimDocument>\n"
    )


def _joint(model: PeerModel, s: int, parent: str, numbers: range) -> str:
    """One segment's joint; OpenSim wants three axes of turning, those without a coordinate stand still."""
    kind = "CustomJoint" if numbers else "WeldJoint"
    name, waiting = model.segments[s], list(numbers)
    axes = []
    shifts = [waiting.pop(0) if model.free[s] else None for _ in range(3)]
    order = model.turns[s] + "".join(axis for axis in _HINGES if axis not in model.turns[s])
    for i, axis in enumerate(order):
        axes.append(_axis(f"rotation{i + 1}", axis, waiting.pop(0) if waiting else None))
    axes += [_axis(f"translation{i + 1}", axis, shifts[i]) for i, axis in enumerate(_HINGES)]
    coordinates = "".join(f'<Coordinate name="q{n}"><range>-100 100</range></Coordinate>' for n in numbers)
    frames = "".join(
        f'<PhysicalOffsetFrame name="{name}_{end}"><socket_parent>{frame}</socket_parent>'
        f"<translation>{_numbers(away)}</translation><orientation>0 0 0</orientation></PhysicalOffsetFrame>"
        for end, frame, away in (
            ("parent", parent, model.offsets[s]),
            ("child", f"/bodyset/{name}", np.zeros(3)),
        )
    )
    return (
        f'<{kind} name="to_{name}"><socket_parent_frame>{name}_parent</socket_parent_frame>'
        f"<socket_child_frame>{name}_child</socket_child_frame>"
        + (f"<coordinates>{coordinates}</coordinates>" if numbers else "")
        + f"<frames>{frames}</frames>"
        + (f"<SpatialTransform>{''.join(axes)}</SpatialTransform>" if numbers else "")
        + f"</{kind}>"
    )


def _axis(name: str, axis: str, number: int | None) -> str:
    unit = " ".join("1" if axis == other else "0" for other in _HINGES)
    function = (
        '<Constant name="function"><value>0</value></Constant>'
        if number is None
        else '<LinearFunction name="function"><coefficients>1 0</coefficients></LinearFunction>'
    )
    coordinate = "" if number is None else f"q{number}"
    return (
        f'<TransformAxis name="{name}"><coordinates>{coordinate}</coordinates><axis>{unit}</axis>'
        f"{function}</TransformAxis>"
    )


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.9g}" for value in values)

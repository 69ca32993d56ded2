"""A chain as compiled code sees it: its arrays, its pose, and where points of its segments are."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.tracking.filter_settings import FilterSettings
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array

SHIFT, TURN, HINGE = 0, 1, 2
"""Kinds of freedom: of a free segment along and about the world's axes, of a joint about an axis of its own."""


class Chain(NamedTuple):
    """J segments (a parent before its children), n freedoms, M markers.

    Attributes:
        parents: (J,) index of each segment's parent, -1 for a free segment.
        offsets: (J, 3) m, the joint's centre from its parent's in the zero pose; of a free segment from the floor.
        first, count: (J,) the freedoms of a segment are ``first`` to ``first + count``.
        kind: (n,) :data:`SHIFT`, :data:`TURN` or :data:`HINGE`.
        axis: (n,) 0, 1 or 2 for x, y, z: of the world, or of the joint's frame before the turn.
        joint: (n,) the segment that it moves.
        rest: (n,) rad.
        stiffness: (n,) 1/rad², inverse variance about rest; for a free segment's turns: from upright and ahead.
        power: (n,) of the accelerations, m²/s³ or rad²/s³.
        coasting: (n,) s, in which a speed falls to a third where nothing is seen.
        path: (J, L) the freedoms that move a segment, padded with -1.
        lengths: (J,) how many of them there are.
        carrier: (M,) the segment of each marker.
        places: (M, 3) m, of the markers in their segment's frame.
        spreads: (M,) m, standard deviation of a coordinate of that place from person to person.
        strangeness: (M,) m², variance of a coordinate of where a marker is on somebody in a known pose: by its place
            and by the lengths of the segments that lead to it.
        head: the free segment whose heading the others follow, or -1.
        settings: what the filter is tuned by, in the form that compiled code takes.
    """

    parents: NDArray[np.int64]
    offsets: Array
    first: NDArray[np.int64]
    count: NDArray[np.int64]
    kind: NDArray[np.int64]
    axis: NDArray[np.int64]
    joint: NDArray[np.int64]
    rest: Array
    stiffness: Array
    power: Array
    coasting: Array
    path: NDArray[np.int64]
    lengths: NDArray[np.int64]
    carrier: NDArray[np.int64]
    places: Array
    spreads: Array
    strangeness: Array
    head: int
    settings: FilterSettings


class Pose(NamedTuple):
    """``centres`` (J, 3), m, and ``frames`` (J, 3, 3) of the segments, and ``angles`` (n,), rad, of the hinges."""

    centres: Array
    frames: Array
    angles: Array


@compiled_entry
def kinematics(chain: Chain, offsets: Array, pose: Pose) -> tuple[Pose, Array]:
    """The pose with centres and frames of all segments, and the axes (n, 3) of the freedoms, in the world."""
    segments, freedoms = len(chain.parents), len(chain.kind)
    centres, frames = np.empty((segments, 3)), np.empty((segments, 3, 3))
    axes = np.zeros((freedoms, 3))
    for j in range(segments):
        parent = chain.parents[j]
        if parent < 0:
            centres[j] = pose.centres[j]
            frames[j] = pose.frames[j]
            for d in range(chain.first[j], chain.first[j] + chain.count[j]):
                axes[d, chain.axis[d]] = 1.0
            continue
        for i in range(3):
            total = centres[parent, i]
            for k in range(3):
                total += frames[parent, i, k] * offsets[j, k]
                frames[j, i, k] = frames[parent, i, k]
            centres[j, i] = total
        for d in range(chain.first[j], chain.first[j] + chain.count[j]):
            a = chain.axis[d]
            b, c = (a + 1) % 3, (a + 2) % 3
            cosine, sine = math.cos(pose.angles[d]), math.sin(pose.angles[d])
            for i in range(3):
                axes[d, i] = frames[j, i, a]
                left, right = frames[j, i, b], frames[j, i, c]
                frames[j, i, b] = cosine * left + sine * right
                frames[j, i, c] = cosine * right - sine * left
    return Pose(centres, frames, pose.angles), axes


@compiled_entry
def on_segments(chain: Chain, pose: Pose, places: Array) -> Array:
    """Markers (M, 3), m, in the world, from their places on the segments."""
    markers = np.empty((len(places), 3))
    for m in range(len(places)):
        j = chain.carrier[m]
        for i in range(3):
            total = pose.centres[j, i]
            for k in range(3):
                total += pose.frames[j, i, k] * places[m, k]
            markers[m, i] = total
    return markers


@compiled
def point_jacobian(chain: Chain, pose: Pose, axes: Array, j: int, point: Array, out: Array) -> int:
    """Derivative (L, 3) of a point on segment ``j`` by the freedoms that move it, and their number L."""
    count = chain.lengths[j]
    for i in range(count):
        d = chain.path[j, i]
        if chain.kind[d] == 0:
            for k in range(3):
                out[i, k] = axes[d, k]
        else:
            pivot = chain.joint[d]
            x, y, z = (
                point[0] - pose.centres[pivot, 0],
                point[1] - pose.centres[pivot, 1],
                point[2] - pose.centres[pivot, 2],
            )
            out[i, 0] = axes[d, 1] * z - axes[d, 2] * y
            out[i, 1] = axes[d, 2] * x - axes[d, 0] * z
            out[i, 2] = axes[d, 0] * y - axes[d, 1] * x
    return count


@compiled
def rotated(frame: Array, x: float, y: float, z: float) -> Array:
    """A frame (3, 3) turned by a rotation vector in the world (Rodrigues)."""
    angle = math.sqrt(x * x + y * y + z * z)
    s = math.sin(angle) / angle if angle > 1e-9 else 1.0
    c = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-6 else 0.5
    turn = np.empty((3, 3))
    turn[0, 0], turn[0, 1], turn[0, 2] = 1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y
    turn[1, 0], turn[1, 1], turn[1, 2] = c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x
    turn[2, 0], turn[2, 1], turn[2, 2] = c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)
    result = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            result[i, j] = turn[i, 0] * frame[0, j] + turn[i, 1] * frame[1, j] + turn[i, 2] * frame[2, j]
    return result


@compiled_entry
def shifted(chain: Chain, pose: Pose, step: Array) -> Pose:
    """The pose moved by a small step (n,) of its freedoms; segments that are not free are not worked out."""
    centres, frames, angles = pose.centres.copy(), pose.frames.copy(), pose.angles.copy()
    for d in range(len(step)):
        if chain.kind[d] == 2:
            angles[d] += step[d]
        elif chain.kind[d] == 0:
            centres[chain.joint[d], chain.axis[d]] += step[d]
        elif chain.axis[d] == 0:  # the three turns of a free segment stand together
            frames[chain.joint[d]] = rotated(frames[chain.joint[d]], step[d], step[d + 1], step[d + 2])
    return Pose(centres, frames, angles)

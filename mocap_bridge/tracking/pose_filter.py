"""The arithmetic of the skeleton tracker, compiled: an iterated extended Kalman filter over poses of a chain.

State: the chain's freedoms and their speeds. A free segment's turn is kept as a matrix and its error as a rotation
vector in the world (Solà 2017, "Quaternion kinematics for the error-state Kalman filter"). The update is in information
form and relinearised (Bell & Cathey 1993, IEEE Trans. Autom. Control 38(2)): 3 M measured numbers enter through an n by
n matrix. Where a marker sits on its segment is followed beside the pose by a small filter of its own for each marker,
since skin moves and no one is the reference body.

Everything that is compiled stands in this one file, as :mod:`highfive.model.compiled` asks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array

SHIFT, TURN, HINGE = 0, 1, 2
"""Kinds of freedom: of a free segment along and about the world's axes, of a joint about an axis of its own."""

MARKER_SIGMA = 0.0012
"""Standard deviation of a measured marker, m."""

PULL_S = 2.0
"""Time in which the expected pose weighs as much as one look at it, s."""

SLIP = 0.001
"""How far a marker wanders on its segment, m per √s: skin moves."""

FADING_S = 0.15
"""Time in which what a hidden marker was last seen beside its place falls to a third, s."""

SLIDE = 0.012
"""Most that a marker moves on its segment, or otherwise than before, from one frame to the next, m."""

FIRST_STEP = 0.04
"""Most that a marker moves in the frame after it was seen again, m: 5 m/s."""

RETURN_NS = 40_000_000
"""A marker that was not seen for so long brings back a part of the body whose speed is not known any more."""

RETURN_SPEED = 6.0
"""How fast that part may be, rad/s."""

UNSURE = 0.1
"""A freedom counts as out of sight from this standard deviation on, rad."""

MISFIT_S = 0.5
"""Time over which the misfit between markers and chain is averaged, s."""

LARGEST_MISFIT = 0.02
"""Most that a marker's misfit may count, m."""

GATE = 25.0
"""Squared Mahalanobis distance, three degrees of freedom, beyond which a point is not believed (15 in a million)."""

TAKE_UP_GATE = 11.3
"""The same within which a point without a label may be taken for a marker (1 in 100 missed)."""

GHOSTS = 20.0
"""Points without a label that belong to nothing, in a m³ about the body."""

TAKEN = 0.02
"""How probable it is that a hidden marker has a point without a label, over the odds that are asked for to take it."""

CAUTION = 0.1
"""Share of what was not known of a marker that is added to its variance in the frame in which it is seen again.

A wrong point may come under a right label; it must not shut out the right one in the next frame.
"""

REACH = 0.10
"""Most that a point without a label may be away from the marker that it is taken for, m."""

DRIFT = 0.15
"""How much further off a marker may reappear than its covariance says, m per second hidden: no model is right."""

USABLE_SIGMA = 0.06
"""An estimate is valid up to this standard deviation a coordinate, m."""

RESET_NS = 250_000_000
"""A marker that was not believed for so long is believed: it has slipped on its segment."""

SLIPPED = 0.15
"""Further off than this, m, from where the set has it, it is no marker of this segment."""

LOST_SHARE = 0.6
"""More than this share of the visible markers not believed, and the frame counts as astray."""

NEVER = np.iinfo(np.int64).max

_ROUNDS = 3  # linearisations of one update at most
_SMALL = 2e-3  # rad or m: after a step below it, the next one would be a thousandth of that


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


class Pose(NamedTuple):
    """``centres`` (J, 3), m, and ``frames`` (J, 3, 3) of the segments, and ``angles`` (n,), rad, of the hinges."""

    centres: Array
    frames: Array
    angles: Array


class State(NamedTuple):
    """What is carried from frame to frame; no array of it is ever written to.

    Attributes:
        pose: the mean; centres and frames of all segments.
        speeds: (n,) m/s or rad/s.
        covariance: (3, n, n): of the pose, of speeds (rows) with the pose, of the speeds.
        offsets: (J, 3) m, the body's.
        places: (M, 3) m, of the markers on their segments as believed now.
        homes: (M, 3) m, where they were at first, and return to in the long run.
        doubt: (M,) m², variance of a coordinate of that place.
        misfit: (M,) m², variance of what chain and noise do not explain.
        left: (M, 3) m, in the segment's frame: how far beside its place a marker was last seen.
        ages: (M,) ns since the marker was last seen; :data:`NEVER` where it never was.
        disbelieved: (M,) ns for which the marker's label has been somewhere else.
        last: (M, 3) m, the marker's last believed point.
        pace: (M, 3) m, from the believed point before that one to it; zero where that one was not the frame before.
        astray: frames in a row of which most was not believed.
    """

    pose: Pose
    speeds: Array
    covariance: Array
    offsets: Array
    places: Array
    homes: Array
    doubt: Array
    misfit: Array
    left: Array
    ages: NDArray[np.int64]
    disbelieved: NDArray[np.int64]
    last: Array
    pace: Array
    astray: int


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
def _slopes(chain: Chain, pose: Pose, axes: Array, j: int, point: Array, out: Array) -> int:
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
def _factor(matrix: Array) -> bool:
    """Cholesky factor in place of the lower triangle; False where the matrix is not positive definite."""
    n = len(matrix)
    for j in range(n):
        for k in range(j):
            f = matrix[j, k]
            if f != 0.0:
                for i in range(j, n):
                    matrix[i, j] -= matrix[i, k] * f
        if not matrix[j, j] > 0.0:
            return False
        root = math.sqrt(matrix[j, j])
        matrix[j, j] = root
        for i in range(j + 1, n):
            matrix[i, j] /= root
    return True


@compiled
def _solve(lower: Array, vector: Array) -> None:
    """Solution in place of a vector (n,), by the Cholesky factor."""
    n = len(vector)
    for i in range(n):
        total = vector[i]
        for k in range(i):
            total -= lower[i, k] * vector[k]
        vector[i] = total / lower[i, i]
    for back in range(n):
        i = n - 1 - back
        total = vector[i]
        for k in range(i + 1, n):
            total -= lower[k, i] * vector[k]
        vector[i] = total / lower[i, i]


@compiled
def _inverse(lower: Array) -> Array:
    """Inverse of the matrix whose Cholesky factor is ``lower``."""
    n = len(lower)
    half = np.zeros((n, n))  # row j: column j of the inverse factor
    for j in range(n):
        half[j, j] = 1.0 / lower[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total += lower[i, k] * half[j, k]
            half[j, i] = -total / lower[i, i]
    result = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += half[i, k] * half[j, k]
            result[i, j] = result[j, i] = total
    return result


@compiled
def _times(a: Array, b: Array) -> Array:
    """a · b for (n, n)."""
    n = len(a)
    result = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            f = a[i, k]
            if f != 0.0:
                for j in range(n):
                    result[i, j] += f * b[k, j]
    return result


@compiled
def _times_transposed(a: Array, b: Array) -> Array:
    """a · bᵀ for (n, n)."""
    n = len(a)
    result = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += a[i, k] * b[j, k]
            result[i, j] = total
    return result


@compiled
def _turned(frame: Array, x: float, y: float, z: float) -> Array:
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
            frames[chain.joint[d]] = _turned(frames[chain.joint[d]], step[d], step[d + 1], step[d + 2])
    return Pose(centres, frames, angles)


@compiled_entry
def predicted(chain: Chain, state: State, seconds: float) -> State:
    """The state a time later: speeds carry the pose on and die away, white accelerations drive both."""
    n = len(state.speeds)
    keep, gone, step = np.empty(n), np.empty(n), np.empty(n)
    for d in range(n):
        keep[d] = math.exp(-seconds / chain.coasting[d])
        gone[d] = chain.coasting[d] * (1.0 - keep[d])  # how far a speed of 1 carries
        step[d] = gone[d] * state.speeds[d]
    place, cross, speed = state.covariance[0], state.covariance[1], state.covariance[2]
    covariance = np.empty((3, n, n))
    for i in range(n):
        for j in range(n):
            carried = gone[i] * cross[i, j] + gone[j] * cross[j, i]
            covariance[0, i, j] = place[i, j] + carried + gone[i] * gone[j] * speed[i, j]
            covariance[1, i, j] = keep[i] * (cross[i, j] + gone[j] * speed[i, j])
            covariance[2, i, j] = keep[i] * keep[j] * speed[i, j]
        covariance[0, i, i] += chain.power[i] * seconds**3 / 3.0
        covariance[1, i, i] += chain.power[i] * seconds**2 / 2.0
        covariance[2, i, i] += chain.power[i] * seconds
    pose, _ = kinematics(chain, state.offsets, shifted(chain, state.pose, step))
    fading = math.exp(-seconds / FADING_S)
    wander = SLIP * SLIP * seconds
    doubt, left = np.empty_like(state.doubt), np.empty_like(state.left)
    for m in range(len(doubt)):
        doubt[m] = min(state.doubt[m] + wander, chain.spreads[m] ** 2)
        for i in range(3):
            left[m, i] = state.left[m, i] * fading
    return State(
        pose,
        keep * state.speeds,
        covariance,
        state.offsets,
        state.places,
        state.homes,
        doubt,
        state.misfit,
        left,
        state.ages,
        state.disbelieved,
        state.last,
        state.pace,
        state.astray,
    )


@compiled
def _covariance(chain: Chain, state: State, axes: Array, m: int, marker: Array, slopes: Array, out: Array) -> int:
    """Covariance (3, 3) of where a marker is, without noise and misfit; its derivative and its length as _slopes."""
    j = chain.carrier[m]
    count = _slopes(chain, state.pose, axes, j, marker, slopes)
    place = state.covariance[0]
    xx = yy = zz = xy = xz = yz = 0.0
    for a in range(count):
        d = chain.path[j, a]
        x, y, z = 0.5 * place[d, d] * slopes[a, 0], 0.5 * place[d, d] * slopes[a, 1], 0.5 * place[d, d] * slopes[a, 2]
        for b in range(a):
            p = place[d, chain.path[j, b]]
            x += p * slopes[b, 0]
            y += p * slopes[b, 1]
            z += p * slopes[b, 2]
        u, v, w = slopes[a, 0], slopes[a, 1], slopes[a, 2]
        xx += 2.0 * u * x
        yy += 2.0 * v * y
        zz += 2.0 * w * z
        xy += u * y + v * x
        xz += u * z + w * x
        yz += v * z + w * y
    out[0, 0], out[1, 1], out[2, 2] = xx + state.doubt[m], yy + state.doubt[m], zz + state.doubt[m]
    out[0, 1] = out[1, 0] = xy
    out[0, 2] = out[2, 0] = xz
    out[1, 2] = out[2, 1] = yz
    return count


@compiled_entry
def expected(chain: Chain, state: State) -> tuple[Array, Array, Array]:
    """Markers: positions (M, 3), covariances (M, 3, 3), without noise and misfit, and velocities (M, 3)."""
    pose, axes = kinematics(chain, state.offsets, state.pose)
    markers = on_segments(chain, pose, state.places)
    covariances, velocities = np.empty((len(markers), 3, 3)), np.zeros((len(markers), 3))
    slopes = np.empty((chain.path.shape[1], 3))
    for m in range(len(markers)):
        count = _covariance(chain, state, axes, m, markers[m], slopes, covariances[m])
        for a in range(count):
            speed = state.speeds[chain.path[chain.carrier[m], a]]
            for i in range(3):
                velocities[m, i] += slopes[a, i] * speed
    return markers, covariances, velocities


@compiled
def _expect_rest(chain: Chain, pose: Pose, seconds: float, system: Array, right: Array) -> None:
    """Adds what is known of bodies without looking: hinges stay about rest, free segments upright and ahead."""
    share = seconds / PULL_S
    for d in range(len(right)):
        weight = share * chain.stiffness[d]
        if weight == 0.0:
            continue
        if chain.kind[d] == 2:
            away = chain.rest[d] - pose.angles[d]
        else:
            up = pose.frames[chain.joint[d]]
            if chain.axis[d] == 0:  # the turn that takes the segment's z axis to the world's
                away = up[1, 2]
            elif chain.axis[d] == 1:
                away = -up[0, 2]
            else:
                if chain.head < 0 or chain.head == chain.joint[d]:
                    continue
                ahead = pose.frames[chain.head]
                away = math.atan2(ahead[1, 0], ahead[0, 0]) - math.atan2(up[1, 0], up[0, 0])
                away -= 2.0 * math.pi * math.floor(away / (2.0 * math.pi) + 0.5)
        system[d, d] += weight
        right[d] += weight * away


@compiled
def _look(
    chain: Chain, state: State, pose: Pose, axes: Array, points: Array, seen: NDArray[np.bool_], caution: Array,
    system: Array, right: Array,
) -> None:  # fmt: skip
    """Adds what the points (M, 3) of the markers that were ``seen`` (M,) say: normal equations, lower triangle."""
    slopes, gap = np.empty((chain.path.shape[1], 3)), np.empty(3)
    markers = on_segments(chain, pose, state.places)
    for m in range(len(markers)):
        if not seen[m]:
            continue
        j = chain.carrier[m]
        count = _slopes(chain, pose, axes, j, markers[m], slopes)
        weight = 1.0 / (MARKER_SIGMA**2 + state.doubt[m] + state.misfit[m] + caution[m])
        for k in range(3):
            gap[k] = weight * (points[m, k] - markers[m, k])
        for a in range(count):
            row = chain.path[j, a]
            right[row] += slopes[a, 0] * gap[0] + slopes[a, 1] * gap[1] + slopes[a, 2] * gap[2]
            x, y, z = weight * slopes[a, 0], weight * slopes[a, 1], weight * slopes[a, 2]
            for b in range(a + 1):  # a path runs from the root outward: its freedoms are in order
                system[row, chain.path[j, b]] += x * slopes[b, 0] + y * slopes[b, 1] + z * slopes[b, 2]


@compiled_entry
def places_doubt(chain: Chain, state: State) -> Array:
    """Covariance (n, n) of the pose that comes of not knowing this person: places of markers, lengths of segments.

    The places' errors stay the same from frame to frame, so no number of frames takes them away ("consider" covariance,
    Schmidt 1966): it is that of a single look with every marker as far off as it may be from person to person.
    """
    n = len(state.speeds)
    pose, axes = kinematics(chain, state.offsets, state.pose)
    system, right = np.zeros((n, n)), np.zeros(n)
    doubtful = State(
        state.pose, state.speeds, state.covariance, state.offsets, state.places, state.homes, chain.strangeness,
        np.zeros_like(state.misfit), state.left, state.ages, state.disbelieved, state.last, state.pace, state.astray,
    )  # fmt: skip
    _expect_rest(chain, pose, PULL_S, system, right)
    markers = on_segments(chain, pose, state.places)
    _look(chain, doubtful, pose, axes, markers, state.ages != NEVER, np.zeros(len(markers)), system, right)
    for d in range(n):
        system[d, d] += 1e-6
    return _inverse(system) if _factor(system) else np.zeros((n, n))


@compiled_entry
def corrected(
    chain: Chain, state: State, points: Array, seen: NDArray[np.bool_], caution: Array, seconds: float, rounds: int,
    small: float,
) -> tuple[State, bool]:  # fmt: skip
    """The state after looking at the points (M, 3) of the markers that were ``seen`` (M,); False where it failed.

    ``caution`` (M,), m², is added to their variances. ``rounds`` linearisations at most; a step below ``small``, rad or
    m, ends them.
    """
    n = len(state.speeds)
    prior = state.covariance[0].copy()
    if not _factor(prior):
        return state, False
    information = _inverse(prior)
    pose, axes = kinematics(chain, state.offsets, state.pose)
    moved, step = np.zeros(n), np.zeros(n)
    system = information
    for _ in range(rounds):
        system = information.copy()
        for i in range(n):
            total = 0.0
            for k in range(n):
                total -= information[i, k] * moved[k]
            step[i] = total
        _expect_rest(chain, pose, seconds, system, step)
        _look(chain, state, pose, axes, points, seen, caution, system, step)
        if not _factor(system):
            return state, False
        _solve(system, step)
        largest = 0.0
        for d in range(n):
            step[d] = min(max(step[d], -0.5), 0.5)  # far from the solution the slope says the direction only
            largest = max(largest, abs(step[d]))
            moved[d] += step[d]
        pose, axes = kinematics(chain, state.offsets, shifted(chain, pose, step))
        if largest < small:
            break
    after = _inverse(system)
    cross, speed = state.covariance[1], state.covariance[2]
    gain = _times(cross, information)
    covariance = np.empty((3, n, n))
    covariance[0] = after
    covariance[1] = _times(gain, after)
    # gain · before · gainᵀ is cross · gainᵀ
    taken, kept = _times_transposed(cross, gain), _times_transposed(covariance[1], gain)
    speeds = state.speeds.copy()
    for i in range(n):
        for k in range(n):
            speeds[i] += gain[i, k] * moved[k]
            covariance[2, i, k] = speed[i, k] - taken[i, k] + kept[i, k]
    return (
        State(
            pose,
            speeds,
            covariance,
            state.offsets,
            state.places,
            state.homes,
            state.doubt,
            state.misfit,
            state.left,
            state.ages,
            state.disbelieved,
            state.last,
            state.pace,
            state.astray,
        ),
        True,
    )


@compiled_entry
def settled(chain: Chain, state: State, points: Array, seen: NDArray[np.bool_], seconds: float) -> State:
    """The state after the markers' places on their segments have followed what was seen."""
    places, doubt, misfit, left = (state.places.copy(), state.doubt.copy(), state.misfit.copy(), state.left.copy())
    share = min(seconds / MISFIT_S, 1.0)
    beside = np.empty(3)
    for m in range(len(places)):
        if not seen[m]:
            continue
        j = chain.carrier[m]
        gain = doubt[m] / (doubt[m] + MARKER_SIGMA**2 + misfit[m])
        # A turn of a segment and a shift of all its markers look alike. In the long run it is the turn: markers wander
        # about their homes, at most as far as they lie apart from person to person.
        homing = seconds * SLIP**2 / chain.spreads[m] ** 2
        square = 0.0
        for i in range(3):
            local = 0.0
            for k in range(3):
                local += state.pose.frames[j, k, i] * (points[m, k] - state.pose.centres[j, k])
            beside[i] = local - places[m, i]
            places[m, i] += gain * beside[i] + homing * (state.homes[m, i] - places[m, i])
            left[m, i] = (1.0 - gain) * beside[i]
            square += left[m, i] * left[m, i] / 3.0
        doubt[m] *= 1.0 - gain
        misfit[m] += share * (max(square - MARKER_SIGMA**2, 0.0) - misfit[m])
        misfit[m] = min(misfit[m], LARGEST_MISFIT**2)
    return State(
        state.pose,
        state.speeds,
        state.covariance,
        state.offsets,
        places,
        state.homes,
        doubt,
        misfit,
        left,
        state.ages,
        state.disbelieved,
        state.last,
        state.pace,
        state.astray,
    )


@compiled
def _precision(out: Array, extra: float) -> None:
    """Inverse, in place, of a covariance (3, 3) with ``extra`` on its diagonal."""
    a, b, c = out[0, 0] + extra, out[0, 1], out[0, 2]
    d, e, f = out[1, 1] + extra, out[1, 2], out[2, 2] + extra
    x, y, z = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1.0 / (a * x + b * y + c * z)
    out[0, 0], out[0, 1], out[0, 2] = scale * x, scale * y, scale * z
    out[1, 0], out[1, 1], out[1, 2] = scale * y, scale * (a * f - c * c), scale * (b * c - a * e)
    out[2, 0], out[2, 1], out[2, 2] = scale * z, scale * (b * c - a * e), scale * (a * d - b * b)


@compiled
def _determinant(a: Array) -> float:
    """Determinant of a symmetric matrix (3, 3)."""
    x, y = a[1, 1] * a[2, 2] - a[1, 2] ** 2, a[0, 1] * a[2, 2] - a[0, 2] * a[1, 2]
    return a[0, 0] * x - a[0, 1] * y + a[0, 2] * (a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1])


@compiled
def _distance(precision: Array, gap: Array) -> float:
    """Squared Mahalanobis distance of a gap (3,)."""
    total = 0.0
    for i in range(3):
        for k in range(3):
            total += gap[i] * precision[i, k] * gap[k]
    return total


@compiled
def _believed(
    state: State, markers: Array, precisions: Array, slides: Array, points: Array, labelled: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which labelled points (M, 3) of known markers are believed.

    Far outside its expected place a point is not, unless it is near where the marker would be if it sat on its segment
    as in the last frame, ``slides`` (M, 3), or goes on as it went: skin slides and models err, but labels jump.
    """
    seen, gap = np.zeros(len(markers), dtype=np.bool_), np.empty(3)
    for m in range(len(markers)):
        if not labelled[m] or state.ages[m] == NEVER:
            continue
        slid, went = 0.0, 0.0
        paced = math.isfinite(state.pace[m, 0])
        for i in range(3):
            gap[i] = points[m, i] - markers[m, i]
            slid += (points[m, i] - slides[m, i]) ** 2
            went += (points[m, i] - state.last[m, i] - (state.pace[m, i] if paced else 0.0)) ** 2
        far = 0.0 if state.ages[m] > 0 else SLIDE if paced else FIRST_STEP
        seen[m] = slid < SLIDE**2 or went < far**2 or _distance(precisions[m], gap) < GATE
    return seen


@compiled
def _take_up(
    state: State, markers: Array, precisions: Array, points: Array, loose: Array, seen: NDArray[np.bool_],
    doubted: NDArray[np.bool_],
) -> Array:  # fmt: skip
    """Gives loose points (U, 3), and labelled ones that are ``doubted`` (M,), to markers that are not ``seen`` (M,).

    Only where point and marker fit each other and no other. Returns the points as used (M, 3); marks markers as seen.
    """
    count, used, gap = len(markers), points.copy(), np.empty(3)
    owner = np.full(count + len(loose), -1)  # the marker that a point fits: -1 for none, -2 for several
    choice = np.full(count, -1)  # the point that fits a marker, likewise
    for p in range(len(owner)):
        if p < count and not doubted[p]:
            continue
        point = points[p] if p < count else loose[p - count]
        for m in range(count):
            if seen[m] or state.ages[m] == NEVER:
                continue
            square = 0.0
            for i in range(3):
                gap[i] = point[i] - markers[m, i]
                square += gap[i] * gap[i]
            away = _distance(precisions[m], gap)
            # Odds that it is the marker and not one of the ghosts in the space where the marker may be.
            odds = TAKEN * math.sqrt(_determinant(precisions[m])) * math.exp(-0.5 * away) / (GHOSTS * 15.75)
            if square < REACH * REACH and away < TAKE_UP_GATE and odds > 1.0:
                owner[p] = m if owner[p] == -1 else -2
                choice[m] = p if choice[m] == -1 else -2
    for m in range(count):
        p = choice[m]
        if p >= 0 and owner[p] == m:
            used[m] = points[p] if p < count else loose[p - count]
            seen[m] = True
    return used


class Followed(NamedTuple):
    """What one frame made of the markers.

    Attributes:
        positions: (M, 3) m.
        velocities: (M, 3) m/s.
        covariances: (M, 3, 3) m², of the positions.
        seen: (M,) a point was believed to be the marker.
        valid: (M,) the marker is known well enough to be used, if need be from the set and the markers beside it.
        rejected: (M,) the marker's label was at a point that was not believed to be it.
    """

    positions: Array
    velocities: Array
    covariances: Array
    seen: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    rejected: NDArray[np.bool_]


@compiled_entry
def followed(
    chain: Chain, state: State, points: Array, labelled: NDArray[np.bool_], loose: Array, elapsed_ns: int
) -> tuple[State, Followed, bool]:
    """One frame: predict, tell points apart, correct, and say where every marker is; False where the filter failed.

    Args:
        chain: the skeleton.
        state: after the frame before.
        points: (M, 3) m, finite.
        labelled: (M,) the marker's label has a point.
        loose: (U, 3) m, points without a label.
        elapsed_ns: since the frame before.
    """
    count, seconds = len(points), 1e-9 * elapsed_ns
    state = predicted(chain, state, seconds)
    pose, axes = kinematics(chain, state.offsets, state.pose)
    markers = on_segments(chain, pose, state.places)
    precisions, slopes = np.zeros((count, 3, 3)), np.empty((chain.path.shape[1], 3))
    slides, caution = np.full_like(markers, np.inf), np.zeros(count)
    for m in range(count):
        if state.ages[m] == NEVER:
            continue
        square = 0.0
        for i in range(3):
            square += (points[m, i] - markers[m, i]) ** 2
        # No variance is below the measurement's own, so that what is this near lies inside the gate.
        if not labelled[m] or square > GATE * MARKER_SIGMA**2 or state.ages[m] > 0:
            # Only while its label is nowhere: one that is somewhere else is not believed for staying there.
            slack = DRIFT * 1e-9 * (state.ages[m] - min(state.disbelieved[m], state.ages[m]))
            _covariance(chain, state, axes, m, markers[m], slopes, precisions[m])
            if state.ages[m] > 0:
                for i in range(3):
                    caution[m] += CAUTION * precisions[m, i, i] / 3.0
            _precision(precisions[m], MARKER_SIGMA**2 + state.misfit[m] + slack * slack)
        if state.ages[m] == 0:
            for i in range(3):
                slides[m, i] = markers[m, i]
                for k in range(3):
                    slides[m, i] += state.pose.frames[chain.carrier[m], i, k] * state.left[m, k]
    seen = _believed(state, markers, precisions, slides, points, labelled)
    doubted, rejected, wanting = np.zeros(count, dtype=np.bool_), 0, False
    for m in range(count):
        known = state.ages[m] != NEVER
        doubted[m] = labelled[m] and known and not seen[m]
        rejected += 1 if doubted[m] else 0
        wanting = wanting or (known and not seen[m])
    if wanting and rejected + len(loose) > 0:
        points = _take_up(state, markers, precisions, points, loose, seen, doubted)
    state = _paceless(chain, state, seen)
    state, worked = corrected(chain, state, points, seen, caution, seconds, _ROUNDS, _SMALL)
    state = _remembered(
        chain, settled(chain, state, points, seen, seconds), points, labelled, seen, rejected, elapsed_ns
    )
    return state, _shown(chain, state, points, seen, doubted), worked


@compiled
def _paceless(chain: Chain, state: State, seen: NDArray[np.bool_]) -> State:
    """The state, without the speeds of parts of the body that were out of sight until now.

    The way that a hidden hand was off came about during all the time that it was hidden: taken for its speed, it would
    throw the hand far beyond.
    """
    covariance, copied = state.covariance, False
    for m in range(len(seen)):
        if not seen[m] or state.ages[m] < RETURN_NS or state.ages[m] == NEVER:
            continue
        j = chain.carrier[m]
        for a in range(chain.lengths[j]):
            d = chain.path[j, a]
            if chain.kind[d] == 0 or covariance[0, d, d] < UNSURE**2:
                continue
            if not copied:
                covariance, copied = covariance.copy(), True
            for i in range(len(state.speeds)):
                covariance[1, d, i] = covariance[2, d, i] = covariance[2, i, d] = 0.0
            covariance[2, d, d] = RETURN_SPEED**2
    return State(
        state.pose, state.speeds, covariance, state.offsets, state.places, state.homes, state.doubt, state.misfit,
        state.left,        state.ages, state.disbelieved, state.last, state.pace, state.astray,
    )  # fmt: skip


@compiled
def _remembered(
    chain: Chain, state: State, points: Array, labelled: NDArray[np.bool_], seen: NDArray[np.bool_], rejected: int,
    elapsed_ns: int,
) -> State:  # fmt: skip
    """The state with the markers' ages; markers that appear, or have slipped, are put where they are, and are seen."""
    places, doubt, left = state.places.copy(), state.doubt.copy(), state.left.copy()
    homes = state.homes.copy()
    ages, disbelieved, shown = state.ages.copy(), state.disbelieved.copy(), 0
    last, pace = state.last.copy(), np.empty_like(state.pace)
    local = np.empty(3)
    for m in range(len(ages)):
        shown += 1 if labelled[m] and ages[m] != NEVER else 0
        disbelieved[m] = disbelieved[m] + elapsed_ns if labelled[m] and not seen[m] else 0
        if labelled[m] and not seen[m] and disbelieved[m] > RESET_NS:
            square, j = 0.0, chain.carrier[m]
            for i in range(3):
                local[i] = 0.0
                for k in range(3):
                    local[i] += state.pose.frames[j, k, i] * (points[m, k] - state.pose.centres[j, k])
                square += (local[i] - chain.places[m, i]) ** 2
            if square < SLIPPED**2:
                places[m], homes[m], left[m], doubt[m], seen[m] = local, local, 0.0, chain.spreads[m] ** 2, True
        for i in range(3):
            pace[m, i] = points[m, i] - last[m, i] if seen[m] and ages[m] == 0 else np.nan
            last[m, i] = points[m, i] if seen[m] else last[m, i]
        if seen[m]:
            ages[m] = 0
        elif ages[m] != NEVER:
            ages[m] += elapsed_ns
    astray = state.astray + 1 if shown > 0 and rejected > LOST_SHARE * shown else 0
    return State(
        state.pose, state.speeds, state.covariance, state.offsets, places, homes, doubt, state.misfit, left,
        ages, disbelieved, last, pace, astray,
    )  # fmt: skip


@compiled
def _shown(chain: Chain, state: State, points: Array, seen: NDArray[np.bool_], doubted: NDArray[np.bool_]) -> Followed:
    """Where every marker is, seen or not."""
    markers, covariances, velocities = expected(chain, state)
    valid = np.empty(len(markers), dtype=np.bool_)
    for m in range(len(markers)):
        j, own = chain.carrier[m], 0.0
        if seen[m]:  # what chain and place do not explain is the skin's own motion, for the most part
            share = state.misfit[m] / (state.misfit[m] + MARKER_SIGMA**2)
            own = share * MARKER_SIGMA**2
            for i in range(3):
                markers[m, i] += share * (points[m, i] - markers[m, i])
        else:
            own = state.misfit[m]
            for i in range(3):
                for k in range(3):
                    markers[m, i] += state.pose.frames[j, i, k] * state.left[m, k]
        variance = 3.0 * own
        for i in range(3):
            variance += covariances[m, i, i]
            covariances[m, i, i] += own
        valid[m] = variance < 3.0 * USABLE_SIGMA**2
    return Followed(markers, velocities, covariances, seen, valid, doubted)


@compiled_entry
def misfit_of(chain: Chain, state: State, points: Array, seen: NDArray[np.bool_]) -> float:
    """How badly a pose explains points (M, 3): squares of residuals and of the way from rest, in their deviations."""
    pose, _ = kinematics(chain, state.offsets, state.pose)
    markers = on_segments(chain, pose, state.places)
    total = 0.0
    for m in range(len(markers)):
        if seen[m]:
            square = 0.0
            for i in range(3):
                square += (points[m, i] - markers[m, i]) ** 2
            total += square / (MARKER_SIGMA**2 + state.doubt[m])
    for d in range(len(chain.kind)):
        if chain.kind[d] == 2:
            total += chain.stiffness[d] * (pose.angles[d] - chain.rest[d]) ** 2
    return total

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

from highfive.mocap_bridge.tracking.chain_kinematics import (
    Chain,
    Pose,
    kinematics,
    on_segments,
    point_jacobian,
    shifted,
)
from highfive.mocap_bridge.tracking.filter_settings import NEVER
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.linear_algebra import (
    cholesky,
    cholesky_inverse,
    cholesky_solve,
    precision_of,
    product,
    product_transposed,
)


class State(NamedTuple):
    """What is carried from frame to frame; no array of it is ever written to.

    Attributes:
        pose: the mean; centres and frames of all segments.
        speeds: (n,) m/s or rad/s.
        covariance: (3, n, n): of the pose, of speeds (rows) with the pose, of the speeds.
        offsets: (J, 3) m, the body's.
        places: (M, 3) m, of the markers on their segments as believed now.
        homes: (M, 3) m, where they were at first, and return to in the long run.
        place_variance: (M,) m², variance of a coordinate of that place.
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
    place_variance: Array
    misfit: Array
    left: Array
    ages: NDArray[np.int64]
    disbelieved: NDArray[np.int64]
    last: Array
    pace: Array
    astray: int


@compiled
def with_pose(state: State, pose: Pose, speeds: Array, covariance: Array) -> State:
    """The state with the chain elsewhere; the markers sit where they did."""
    return State(
        pose, speeds, covariance, state.offsets, state.places, state.homes, state.place_variance, state.misfit,
        state.left, state.ages, state.disbelieved, state.last, state.pace, state.astray,
    )  # fmt: skip


@compiled
def with_places(state: State, places: Array, place_variance: Array, misfit: Array, left: Array) -> State:
    """The state with the markers elsewhere on the chain."""
    return State(
        state.pose, state.speeds, state.covariance, state.offsets, places, state.homes, place_variance, misfit,
        left, state.ages, state.disbelieved, state.last, state.pace, state.astray,
    )  # fmt: skip


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
    fading = math.exp(-seconds / chain.settings.fading_s)
    wander = chain.settings.slip * chain.settings.slip * seconds
    place_variance, left = np.empty_like(state.place_variance), np.empty_like(state.left)
    for m in range(len(place_variance)):
        place_variance[m] = min(state.place_variance[m] + wander, chain.spreads[m] ** 2)
        for i in range(3):
            left[m, i] = state.left[m, i] * fading
    placed = with_places(state, state.places, place_variance, state.misfit, left)
    return with_pose(placed, pose, keep * state.speeds, covariance)


@compiled
def marker_covariance(
    chain: Chain, state: State, axes: Array, m: int, marker: Array, jacobian: Array, out: Array
) -> int:
    """Covariance (3, 3) of where a marker is, without noise and misfit.

    Its derivative and its length are those of :func:`point_jacobian`.
    """
    j = chain.carrier[m]
    count = point_jacobian(chain, state.pose, axes, j, marker, jacobian)
    place = state.covariance[0]
    xx = yy = zz = xy = xz = yz = 0.0
    for a in range(count):
        d = chain.path[j, a]
        x, y, z = (
            0.5 * place[d, d] * jacobian[a, 0],
            0.5 * place[d, d] * jacobian[a, 1],
            0.5 * place[d, d] * jacobian[a, 2],
        )
        for b in range(a):
            p = place[d, chain.path[j, b]]
            x += p * jacobian[b, 0]
            y += p * jacobian[b, 1]
            z += p * jacobian[b, 2]
        u, v, w = jacobian[a, 0], jacobian[a, 1], jacobian[a, 2]
        xx += 2.0 * u * x
        yy += 2.0 * v * y
        zz += 2.0 * w * z
        xy += u * y + v * x
        xz += u * z + w * x
        yz += v * z + w * y
    out[0, 0], out[1, 1], out[2, 2] = (
        xx + state.place_variance[m],
        yy + state.place_variance[m],
        zz + state.place_variance[m],
    )
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
    jacobian = np.empty((chain.path.shape[1], 3))
    for m in range(len(markers)):
        count = marker_covariance(chain, state, axes, m, markers[m], jacobian, covariances[m])
        for a in range(count):
            speed = state.speeds[chain.path[chain.carrier[m], a]]
            for i in range(3):
                velocities[m, i] += jacobian[a, i] * speed
    return markers, covariances, velocities


@compiled
def _expect_rest(chain: Chain, pose: Pose, seconds: float, system: Array, right: Array) -> None:
    """Adds what is known of bodies without looking: hinges stay about rest, free segments upright and ahead."""
    share = seconds / chain.settings.pull_s
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
    chain: Chain, state: State, pose: Pose, axes: Array, points: Array, seen: NDArray[np.bool_], noise: Array,
    caution: Array, system: Array, right: Array,
) -> None:  # fmt: skip
    """Adds what the points (M, 3) of the markers that were ``seen`` (M,) say: normal equations, lower triangle."""
    jacobian, gap = np.empty((chain.path.shape[1], 3)), np.empty(3)
    weights = np.empty((3, 3))
    markers = on_segments(chain, pose, state.places)
    for m in range(len(markers)):
        if not seen[m]:
            continue
        j = chain.carrier[m]
        count = point_jacobian(chain, pose, axes, j, markers[m], jacobian)
        if len(noise) > 0:
            weights[:] = noise[m]
            precision_of(weights, state.place_variance[m] + state.misfit[m] + caution[m])
            for i in range(3):
                gap[i] = 0.0
                for k in range(3):
                    gap[i] += weights[i, k] * (points[m, k] - markers[m, k])
            for a in range(count):
                row = chain.path[j, a]
                right[row] += jacobian[a, 0] * gap[0] + jacobian[a, 1] * gap[1] + jacobian[a, 2] * gap[2]
                x, y, z = _weighted(weights, jacobian[a])
                for b in range(a + 1):
                    system[row, chain.path[j, b]] += x * jacobian[b, 0] + y * jacobian[b, 1] + z * jacobian[b, 2]
            continue
        weight = 1.0 / (chain.settings.marker_sigma**2 + state.place_variance[m] + state.misfit[m] + caution[m])
        for k in range(3):
            gap[k] = weight * (points[m, k] - markers[m, k])
        for a in range(count):
            row = chain.path[j, a]
            right[row] += jacobian[a, 0] * gap[0] + jacobian[a, 1] * gap[1] + jacobian[a, 2] * gap[2]
            x, y, z = weight * jacobian[a, 0], weight * jacobian[a, 1], weight * jacobian[a, 2]
            for b in range(a + 1):  # a path runs from the root outward: its freedoms are in order
                system[row, chain.path[j, b]] += x * jacobian[b, 0] + y * jacobian[b, 1] + z * jacobian[b, 2]


@compiled
def _weighted(weights: Array, vector: Array) -> tuple[float, float, float]:
    """Product of a symmetric matrix (3, 3) and a vector (3,)."""
    a, b, c = vector[0], vector[1], vector[2]
    return (
        weights[0, 0] * a + weights[0, 1] * b + weights[0, 2] * c,
        weights[1, 0] * a + weights[1, 1] * b + weights[1, 2] * c,
        weights[2, 0] * a + weights[2, 1] * b + weights[2, 2] * c,
    )


@compiled_entry
def consider_covariance(chain: Chain, state: State) -> Array:
    """Covariance (n, n) of the pose that comes of not knowing this person: places of markers, lengths of segments.

    The places' errors stay the same from frame to frame, so no number of frames takes them away ("consider" covariance,
    Schmidt 1966): it is that of a single look with every marker as far off as it may be from person to person.
    """
    n = len(state.speeds)
    pose, axes = kinematics(chain, state.offsets, state.pose)
    system, right = np.zeros((n, n)), np.zeros(n)
    doubtful = with_places(state, state.places, chain.strangeness, np.zeros_like(state.misfit), state.left)
    _expect_rest(chain, pose, chain.settings.pull_s, system, right)
    markers = on_segments(chain, pose, state.places)
    alike = np.zeros((0, 3, 3))
    _look(chain, doubtful, pose, axes, markers, state.ages != NEVER, alike, np.zeros(len(markers)), system, right)
    for d in range(n):
        system[d, d] += 1e-6
    return cholesky_inverse(system) if cholesky(system, system) else np.zeros((n, n))


@compiled_entry
def corrected(
    chain: Chain, state: State, points: Array, seen: NDArray[np.bool_], noise: Array, caution: Array, seconds: float,
    rounds: int, small: float,
) -> tuple[State, bool]:  # fmt: skip
    """The state after looking at the points (M, 3) of the markers that were ``seen`` (M,); False where it failed.

    ``noise`` (M, 3, 3), m², is the points' covariance; without rows all have the settings'. ``caution`` (M,), m², is
    added to it. ``rounds`` linearisations at most; a step below ``small``, rad or m, ends them.
    """
    n = len(state.speeds)
    prior = state.covariance[0].copy()
    if not cholesky(prior, prior):
        return state, False
    information = cholesky_inverse(prior)
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
        _look(chain, state, pose, axes, points, seen, noise, caution, system, step)
        if not cholesky(system, system):
            return state, False
        cholesky_solve(system, step)
        largest = 0.0
        for d in range(n):
            step[d] = min(max(step[d], -0.5), 0.5)  # far from the solution the derivative gives the direction only
            largest = max(largest, abs(step[d]))
            moved[d] += step[d]
        pose, axes = kinematics(chain, state.offsets, shifted(chain, pose, step))
        if largest < small:
            break
    after = cholesky_inverse(system)
    cross, speed = state.covariance[1], state.covariance[2]
    gain = product(cross, information)
    covariance = np.empty((3, n, n))
    covariance[0] = after
    covariance[1] = product(gain, after)
    # gain · before · gainᵀ is cross · gainᵀ
    taken, kept = product_transposed(cross, gain), product_transposed(covariance[1], gain)
    speeds = state.speeds.copy()
    for i in range(n):
        for k in range(n):
            speeds[i] += gain[i, k] * moved[k]
            covariance[2, i, k] = speed[i, k] - taken[i, k] + kept[i, k]
    return with_pose(state, pose, speeds, covariance), True

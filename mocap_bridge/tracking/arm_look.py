"""How the segments of the right arm are turned, from one look at its own markers and from what elbows are like.

The tracker's chain carries its state on from frame to frame, so what no marker shows drifts in it: with joint centres
alone a turn of the upper arm about its own length, made good by a bend of the elbow to the side, leaves every marker
where it is. Here nothing is carried on. Shoulder, upper arm, forearm and hand are fitted to the markers as tracked; one
thing is known beside them, the carrying angle of people. What is still not known has a large variance, and says so.

All that is compiled stands in this file, as :mod:`highfive.model.compiled` asks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.tracking.chain_kinematics import SHIFT, Chain
from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array

CARRYING_SIGMA = math.radians(8.0)
"""Standard deviation of the carrying angle about none, over people and flexions, rad.

Valgus is 12 ± 3° in men and 17 ± 3° in women with a straight arm and falls steadily to -2 ± 3° with a bent one (Van Roy
et al. 2005, Ergonomics 48(11-14); 12.9 ± 5.9° straight in 600 people: Paraskevas et al. 2004, Surg. Radiol. Anat.
26(1)): root mean square over the range of flexion 8°. Skeletons that others have solved mostly have none at all."""

GIRDLE_SIGMA = 0.04
"""How far a shoulder moves against a trunk that has no shoulder girdle, m, per coordinate: 0.25 rad of a clavicle."""

FREE = 10.0
"""Standard deviation, rad, of a turn that nothing shows: more than any turn, little enough to be inverted."""

_NOISE = 3.0  # a marker within so many of its deviations from where it is tracked is measured no better than that
_ROUNDS, _SMALL = 8, 1e-5
_STRAIGHT = -0.3  # rad: no elbow is bent backwards so far


class ArmModel(NamedTuple):
    """The right arm of a marker set, on its own.

    Attributes:
        markers: (N,) indices of the markers that upper arm, forearm and hand bear.
        carrier: (N,) which of the three bears it: 0, 1 or 2.
        variance: (N,) m², of a coordinate of where it is measured on its segment.
        stretch: (2,) standard deviation of the lengths of upper arm and forearm, over themselves.
        shoulder_variance: m², of a coordinate of the shoulder's centre.
        segments: (4,) base, upper arm, forearm and hand in the chain.
        wrist: the chain's first freedom of the wrist.
        usual: rad, and its standard deviation: how far elbows are bent.
    """

    markers: NDArray[np.int64]
    carrier: NDArray[np.int64]
    variance: Array
    stretch: Array
    shoulder_variance: float
    segments: NDArray[np.int64]
    wrist: int
    usual: tuple[float, float]


class Look(NamedTuple):
    """Orientations (3, 3, 3) of upper arm, forearm and hand, and their covariance (8, 8), rad².

    The eight are a rotation vector of the upper arm and one of the forearm with the hand, both in the world, and the
    wrist's two hinges.
    """

    frames: Array
    covariance: Array


def arm_model(chain: Chain, marker_set: MarkerSet, names: list[str], segments: tuple[int, int, int, int]) -> ArmModel:
    """The arm whose base, upper arm, forearm and hand are those ``segments`` of a chain with these ``names``."""
    _, upper, forearm, hand = segments
    arm = [upper, forearm, hand]
    markers = np.flatnonzero(np.isin(chain.carrier, arm))
    carrier = np.array([arm.index(j) for j in chain.carrier[markers]], dtype=np.int64)

    lengths = [marker_set.segments[names[segment]].relative_sigma for segment in arm]
    to_shoulder = (lengths[0] * float(np.linalg.norm(chain.offsets[upper]))) ** 2 / 3.0
    girdle = int(chain.parents[upper])
    bears = chain.carrier == girdle
    if "clavicle" in names[girdle] and bears.any():
        shoulder = float(chain.strangeness[bears].mean()) + to_shoulder
    else:
        shoulder = GIRDLE_SIGMA**2 + to_shoulder
    bend = int(chain.first[forearm])
    return ArmModel(
        markers=markers.astype(np.int64),
        carrier=carrier,
        variance=chain.settings.marker_sigma**2 + np.square(chain.spreads[markers]),
        stretch=np.array(lengths[1:]),
        shoulder_variance=shoulder,
        segments=np.array(segments, dtype=np.int64),
        wrist=int(chain.first[hand]),
        usual=(-float(chain.rest[bend]), float(chain.stiffness[bend]) ** -0.5),
    )


@compiled_entry
def sharpened(noise: Array, tracked: Array, measured: Array, seen: NDArray[np.bool_]) -> Array:
    """Markers (N, 3), m, where they are ``tracked``, or nearer to where they are ``measured`` and ``seen`` (N,).

    A tracker lags where people are quicker than it expects. What is off by more than ``noise`` (N,), m, is taken from
    the measurement, and the more so the further it is off.
    """
    result = tracked.copy()
    for m in range(len(tracked)):
        square = 0.0
        for i in range(3):
            square += (measured[m, i] - tracked[m, i]) ** 2
        if seen[m] and square > (_NOISE * noise[m]) ** 2:
            share = 1.0 - (_NOISE * noise[m]) ** 2 / square
            for i in range(3):
                result[m, i] += share * (measured[m, i] - tracked[m, i])
    return result


@compiled_entry
def looked(
    arm: ArmModel, shoulder: Array, frames: Array, offsets: Array, places: Array, points: Array,
    known: NDArray[np.bool_], tracking: Array,
) -> Look:  # fmt: skip
    """The arm that explains its markers best and has a carrying angle as people have.

    Args:
        arm: the arm.
        shoulder: (3,) m, its centre as tracked.
        frames: (3, 3, 3) of upper arm, forearm and hand as tracked.
        offsets: (2, 3) m, of elbow and wrist in the frame of the segment before.
        places: (N, 3) m, of the markers on their segments.
        points: (N, 3) m, where the markers are.
        known: (N,) the marker has ever been seen.
        tracking: (8, 8) rad², the tracked pose's own covariance; it comes on top.
    """
    frames, covariance = _fitted(arm, shoulder, frames, offsets, places, points, known)
    information = np.linalg.inv(covariance + tracking)
    return _carried(arm, frames, 0.5 * (information + information.T))


@compiled
def _fitted(
    arm: ArmModel, shoulder: Array, frames: Array, offsets: Array, places: Array, points: Array,
    known: NDArray[np.bool_],
) -> tuple[Array, Array]:  # fmt: skip
    """Frames (3, 3, 3) by least squares (Gauss-Newton), and the covariance (8, 8) of their eight turns."""
    moved, first, system = np.zeros(13), frames, np.eye(13)
    weights, jacobian = np.empty(13), np.zeros((3, 13))
    weights[:3], weights[3:11], weights[11:] = 1.0 / arm.shoulder_variance, FREE**-2, arm.stretch**-2
    for _ in range(_ROUNDS):
        system, right = np.diag(weights), -weights * moved
        for n in range(len(points)):
            if known[n]:
                at = _marker(arm.carrier[n], shoulder, frames, offsets, places[n], moved, jacobian)
                system += jacobian.T @ jacobian / arm.variance[n]
                right += jacobian.T @ (points[n] - at) / arm.variance[n]
        step = np.linalg.solve(system, right).astype(np.float64)
        largest = np.abs(step[3:11]).max()
        if largest > 0.5:  # far from the solution the derivative gives the direction only
            step *= 0.5 / largest
        moved += step
        frames = _moved(frames, step[3:11])
        if largest < _SMALL:
            break
    if not np.isfinite(moved).all():
        return first, FREE**2 * np.eye(8)
    return frames, np.linalg.inv(system)[3:11, 3:11].astype(np.float64)


@compiled
def _marker(
    carrier: int, shoulder: Array, frames: Array, offsets: Array, place: Array, moved: Array, jacobian: Array
) -> Array:
    """Where a marker is (3,), m, and into ``jacobian`` (3, 13) how that depends on what is fitted.

    That is the shift of the shoulder, 0 to 2, turns of upper arm, 3 to 5, and of forearm with hand, 6 to 8, the wrist's
    hinges, 9 and 10, and the lengths of upper arm and forearm over themselves, 11 and 12.
    """
    upper, fore, hand = frames[0], frames[1], frames[2]
    long, reach = upper @ offsets[0], fore @ offsets[1]
    elbow = (1.0 + moved[11]) * long  # from the shoulder
    wrist = elbow + (1.0 + moved[12]) * reach
    jacobian[:] = 0.0
    for i in range(3):
        jacobian[i, i] = 1.0
    if carrier == 0:  # a longer segment bears its markers further along
        along = (place @ offsets[0]) / (offsets[0] @ offsets[0]) * long
        at = upper @ place + moved[11] * along
        _turn(jacobian, 3, at)
        jacobian[:, 11] = along
    elif carrier == 1:
        along = (place @ offsets[1]) / (offsets[1] @ offsets[1]) * reach
        at = elbow + fore @ place + moved[12] * along
        _turn(jacobian, 3, elbow)
        _turn(jacobian, 6, at - elbow)
        jacobian[:, 11], jacobian[:, 12] = long, along
    else:
        arrow, across = hand @ place, _wrist_axis(frames)
        at = wrist + arrow
        _turn(jacobian, 3, elbow)
        _turn(jacobian, 6, at - elbow)
        for i in range(3):
            k, o = (i + 1) % 3, (i + 2) % 3
            jacobian[i, 9] = across[k] * arrow[o] - across[o] * arrow[k]
            jacobian[i, 10] = hand[k, 1] * arrow[o] - hand[o, 1] * arrow[k]
        jacobian[:, 11], jacobian[:, 12] = long, reach
    return shoulder + moved[:3] + at


@compiled
def _turn(jacobian: Array, first: int, arrow: Array) -> None:
    """Puts into three columns how the tip of an ``arrow`` moves as it is turned about the world's axes."""
    x, y, z = arrow[0], arrow[1], arrow[2]
    jacobian[0, first + 1], jacobian[0, first + 2] = z, -y
    jacobian[1, first], jacobian[1, first + 2] = -z, x
    jacobian[2, first], jacobian[2, first + 1] = y, -x


@compiled
def _wrist_axis(frames: Array) -> Array:
    """The wrist's first axis: the forearm's x axis; the second is the hand's own y axis."""
    return frames[1, :, 0].copy()


@compiled
def _about(axis: Array, frame: Array) -> Array:
    """A frame (3, 3) turned by a rotation vector (3,) in the world (Rodrigues)."""
    angle = math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    if angle < 1e-12:
        return frame.copy()
    x, y, z = axis[0] / angle, axis[1] / angle, axis[2] / angle
    s, c = math.sin(angle), 1.0 - math.cos(angle)
    turn = np.array(
        [
            [1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
            [c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x],
            [c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)],
        ]
    )
    return turn @ frame


@compiled
def _moved(frames: Array, step: Array) -> Array:
    """Upper arm, forearm and hand (3, 3, 3) after the eight turns."""
    result = np.empty((3, 3, 3))
    result[0] = _about(step[:3], frames[0])
    result[1] = _about(step[3:6], frames[1])
    bent = _about(step[7] * frames[2, :, 1].copy(), frames[2])
    result[2] = _about(step[3:6], _about(step[6] * _wrist_axis(frames), bent))
    return result


@compiled
def _carrying(frames: Array) -> tuple[float, Array]:
    """The carrying angle, rad, and its gradient (8,): of the forearm out of the plane across the axis of flexion."""
    axis, along = frames[0, :, 1].copy(), frames[1, :, 2].copy()
    sine = -(axis @ along)
    gradient = np.zeros(8)
    for i in range(3):
        k, o = (i + 1) % 3, (i + 2) % 3
        gradient[3 + i] = axis[k] * along[o] - axis[o] * along[k]
        gradient[i] = -gradient[3 + i]
    cosine = math.sqrt(max(1.0 - sine * sine, 1e-6))
    return math.asin(min(max(sine, -1.0), 1.0)), gradient / cosine


@compiled
def _flexion(frames: Array) -> float:
    """The elbow's flexion, rad."""
    along = frames[0].T @ frames[1, :, 2].copy()
    return math.atan2(-along[0], along[2])


@compiled
def _carried(arm: ArmModel, fitted: Array, information: Array) -> Look:
    """The fitted frames moved to a carrying angle as people have it, as far as the ``information`` (8, 8) lets them."""
    best, least, result = fitted, math.inf, information
    weight = CARRYING_SIGMA**-2
    for hinge in range(2):
        # The fitted pose, and the one in which the upper arm is turned about its length until the elbow is a hinge.
        turned = np.zeros(8)
        if hinge == 1:
            along = fitted[0].T @ fitted[1, :, 2].copy()
            turned[:3] = math.atan2(-along[1], -along[0]) * fitted[0, :, 2]
        start = _moved(fitted, turned)
        step, frames = np.zeros(8), start
        cost = _cost(start, turned, information)
        for _ in range(_ROUNDS):
            angle, gradient = _carrying(frames)
            target = np.linalg.solve(
                information + weight * np.outer(gradient, gradient),
                -information @ turned - weight * (angle - gradient @ step) * gradient,
            )
            share, better = 1.0, False
            for _ in range(6):
                trial = step + share * (target - step)
                there = _moved(start, trial)
                found = _cost(there, turned + trial, information)
                if found < cost:
                    better = True
                    break
                share *= 0.5
            if not better:
                break
            largest = np.abs(trial - step).max()
            step, frames, cost = trial, there, found
            if largest < _SMALL:
                break
        flexion = _flexion(frames)
        # Of two poses between which markers do not decide, the one in which elbows mostly are.
        cost += ((flexion - arm.usual[0]) / arm.usual[1]) ** 2 + (min(flexion - _STRAIGHT, 0.0) / 0.1) ** 2
        if cost < least:
            _, gradient = _carrying(frames)
            best, least, result = frames, cost, information + weight * np.outer(gradient, gradient)
    return Look(best, np.linalg.inv(result).astype(np.float64))


@compiled
def _cost(frames: Array, step: Array, information: Array) -> float:
    """How unlikely these frames are, a ``step`` (8,) from the fitted ones."""
    angle, _ = _carrying(frames)
    return float(step @ information @ step) + (angle / CARRYING_SIGMA) ** 2


def tracking_covariance(chain: Chain, arm: ArmModel, axes: Array, covariance: Array) -> Array:
    """Covariance (8, 8), rad², of the eight turns against the arm's base, of the pose's (n, n) with its axes (n, 3)."""
    base, upper, forearm, hand = arm.segments
    path = chain.path[hand, chain.lengths[base] : chain.lengths[hand]]
    turns = np.zeros((8, len(path)))
    for a, d in enumerate(path):
        if a < chain.lengths[upper] - chain.lengths[base]:
            turns[:3, a] = axes[d]
        if a < chain.lengths[forearm] - chain.lengths[base]:
            turns[3:6, a] = axes[d]
        if d >= arm.wrist:
            turns[6 + d - arm.wrist, a] = 1.0
    return turns @ covariance[np.ix_(path, path)] @ turns.T


def base_covariance(chain: Chain, arm: ArmModel, axes: Array, covariance: Array) -> Array:
    """Covariance (3, 3), rad², of how the arm's base is turned in the world, of the pose's (n, n)."""
    base = arm.segments[0]
    path = chain.path[base, : chain.lengths[base]]
    path = path[chain.kind[path] != SHIFT]
    return axes[path].T @ covariance[np.ix_(path, path)] @ axes[path]

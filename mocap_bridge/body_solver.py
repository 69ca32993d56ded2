"""From a person's markers to the joint angles of the skeleton.

Every frame is a regularised non-linear least-squares problem in the hinge angles and the pelvis' position, solved by
Levenberg–Marquardt with the analytic Jacobian, all frames of a recording at once. Body and fingers are solved one after the
other: given the hands, each finger is a problem of nine unknowns of its own. Levenberg 1944, Marquardt 1963; box limits by
projection with an active set (Bertsekas 1982, SIAM J. Control Optim. 20(2)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model import rotations
from model.errors import HighFiveError
from model.rotations import Array
from model.skeleton import Skeleton
from mocap_bridge.kinematic_part import Part, forward, jacobian, make_part
from mocap_bridge.marker_sets import MarkerSet

MARKER_SIGMA = 0.003
"""Standard deviation of a marker about the model, m: noise, skin movement and misfit of the segments."""

ANGLE_SIGMA = 1.0
"""Standard deviation of a hinge about the rest pose, rad: decides only where the markers say nothing."""

_OUTLIER = 0.05  # m; residuals beyond it count linearly (Huber): a swapped label must not bend the body
_KEY_STEP = 12  # every so many frames is solved from scratch, the frames between from the interpolated result
_CHUNK = 256  # frames solved at once; bounds the memory of the Jacobian


@dataclass(frozen=True)
class BodySolution:
    """The skeleton's pose in T frames.

    Attributes:
        root: (T, 3) m, the pelvis in the world.
        quaternions: (T, J, 4), rotation of each joint relative to its parent; the pelvis relative to the world.
        residuals: (T, M) m, distance of each seen marker from where the pose has it; 0 where it was not seen.
        rms: (M,) m, root mean square of a marker's residuals over the frames in which it was seen; 0 if never.
    """

    root: Array
    quaternions: Array
    residuals: Array
    rms: Array


def solve_body(
    skeleton: Skeleton, marker_set: MarkerSet, points: Array, valid: NDArray[np.bool_], key_step: int = _KEY_STEP
) -> BodySolution:
    """Solves the pose of ``skeleton`` in every frame; limits hold, and joints that no marker tells of stay at rest.

    Args:
        skeleton: the body, scaled to the person (``calibration.subject``).
        marker_set: the markers on it.
        points: (T, M, 3) m, in the order of the set.
        valid: (T, M) bool.
        key_step: every so many frames is solved from scratch; 1 if the frames are not neighbours in time.

    Raises:
        HighFiveError: fewer than a tenth of the frames show enough markers to place the body.
    """
    hands = [joint for joint in range(len(skeleton)) if skeleton.parents.count(joint) > 3]
    digits = [chain for hand in hands for chain in _chains(skeleton, hand)]
    of_digits = {joint for chain in digits for joint in chain}
    body = make_part(skeleton, marker_set, [j for j in range(len(skeleton)) if j not in of_digits])
    angles = np.tile(skeleton.to_hinges(skeleton.rest), (len(points), 1, 1))
    root = _solve_part_with_root(body, points, valid, angles, key_step)
    for chain in digits:
        part = make_part(skeleton, marker_set, chain)
        if len(part.markers):
            base = skeleton.parents[chain[0]]
            _solve_digit(part, base, skeleton, root, angles, points, valid)
    quaternions = skeleton.from_hinges(angles)
    positions, orientations = skeleton.forward_kinematics(root, quaternions)
    gap = np.linalg.norm(points - marker_set.simulate(skeleton, positions, orientations), axis=-1)
    residuals = np.where(valid, gap, 0.0)
    rms = np.sqrt((residuals**2).sum(axis=0) / np.maximum(valid.sum(axis=0), 1))
    return BodySolution(root, quaternions, residuals, rms)


def _chains(skeleton: Skeleton, hand: int) -> list[list[int]]:
    """The digits of a hand, each as its joints from base to tip."""
    chains = []
    for first, parent in enumerate(skeleton.parents):
        if parent == hand:
            chain = [first]
            for joint in range(first + 1, len(skeleton)):
                if skeleton.parents[joint] in chain:
                    chain.append(joint)
            chains.append(chain)
    return chains


def _solve_part_with_root(part: Part, points: Array, valid: NDArray[np.bool_], angles: Array, key_step: int) -> Array:
    """Solves the body; writes its ``angles`` (T, J, 3) in place and returns the root (T, 3)."""
    measured, seen = points[:, part.markers], valid[:, part.markers]
    usable = np.flatnonzero(seen.sum(axis=1) >= 3)
    if len(usable) < max(1, len(points) // 10):
        raise HighFiveError(
            f"only {len(usable)} of {len(points)} frames show three or more of the {len(part.markers)} body markers"
        )
    keys = usable[::key_step] if usable[-1] in usable[::key_step] else np.append(usable[::key_step], usable[-1])
    start = np.column_stack([np.tile(part.rest, (len(keys), 1)), np.zeros((len(keys), 3))])
    start[:, :3], start[:, -3:] = _place_root(part, measured[keys], seen[keys])
    prior = np.append(part.rest, np.zeros(3))
    base = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    still = np.zeros((len(points), 3))
    found = _minimise(part, measured[keys], seen[keys], start, prior, still[keys], base[keys], 40)
    found = _retry_bad(part, measured[keys], seen[keys], found, prior, still[keys], base[keys])
    found[:, :3] = np.unwrap(found[:, :3], axis=0)
    every = np.arange(len(points))
    parameters = np.column_stack([np.interp(every, keys, column) for column in found.T])
    if len(keys) < len(points):
        # Where a frame's own markers say nothing, the neighbouring key frames decide: no jump at an occlusion.
        solved = _minimise(
            part,
            measured[usable],
            seen[usable],
            parameters[usable],
            parameters[usable],
            still[usable],
            base[usable],
            12,
        )
        solved[:, :3] = np.unwrap(solved[:, :3], axis=0)
        parameters = np.column_stack([np.interp(every, usable, column) for column in solved.T])
    angles[:, part.joints] = parameters[:, :-3].reshape(len(points), -1, 3)
    return parameters[:, -3:]


def _solve_digit(
    part: Part,
    base: int,
    skeleton: Skeleton,
    root: Array,
    angles: Array,
    points: Array,
    valid: NDArray[np.bool_],
) -> None:
    """Solves one digit on a hand whose pose is known; writes its ``angles`` (T, J, 3) in place."""
    positions, orientations = skeleton.forward_kinematics(root, skeleton.from_hinges(angles))
    measured, seen = points[:, part.markers], valid[:, part.markers]
    start = np.tile(part.rest, (len(points), 1))
    rotation = rotations.to_matrix(orientations[:, base])
    found = _minimise(part, measured, seen, start, part.rest, positions[:, base], rotation, 25)
    blind = ~seen.all(axis=1)
    if blind.any() and not blind.all():
        # A digit with a lost marker keeps to what its neighbours in time say.
        every, known = np.arange(len(points)), np.flatnonzero(~blind)
        prior = np.column_stack([np.interp(every, known, column) for column in found[known].T])[blind]
        found[blind] = _minimise(
            part, measured[blind], seen[blind], prior, prior, positions[blind, base], rotation[blind], 12
        )
    angles[:, part.joints] = found.reshape(len(points), -1, 3)


def _place_root(part: Part, measured: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """First guess of the pelvis: hinge angles (T, 3) and position (T, 3), by a rigid fit of the rest pose's markers.

    Markers near the pelvis in the tree count most: a quarter for every joint further out.
    """
    rest = forward(part, part.rest[None], np.zeros((1, 3)), np.eye(3)[None]).markers[0]
    depth = np.zeros(len(part.joints), dtype=int)
    for joint, parent in enumerate(part.parents):
        depth[joint] = 0 if parent < 0 else depth[parent] + 1
    weight = np.where(seen, 0.25 ** depth[part.carriers], 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    centre = np.einsum("tn,tni->ti", weight, measured)
    rest_centre = weight @ rest
    spread = np.einsum("tn,tni,tnj->tij", weight, measured - centre[:, None], rest[None] - rest_centre[:, None])
    u, _, vt = np.linalg.svd(spread)
    sign = np.linalg.det(u @ vt)
    u[:, :, 2] *= sign[:, None]
    rotation = u @ vt
    order = "".join("xyz"[axis] for axis in part.axes[0])
    hinges = rotations.to_hinges(order, rotations.from_matrix(rotation))
    return hinges, centre - np.einsum("tij,tj->ti", rotation, rest_centre)


def _retry_bad(
    part: Part, measured: Array, seen: NDArray[np.bool_], found: Array, prior: Array, base: Array, rotation: Array
) -> Array:
    """Solves frames that ended in a poor minimum again, from the nearest good frame before and after; keeps the best."""
    cost = _cost(part, measured, seen, found, prior, base, rotation)
    poor = np.flatnonzero(cost > 4.0 * np.median(cost) + 1e-9)
    good = np.setdiff1d(np.arange(len(found)), poor)
    if not len(poor) or not len(good):
        return found
    found = found.copy()
    place = np.searchsorted(good, poor)
    for neighbour in (good[np.maximum(place - 1, 0)], good[np.minimum(place, len(good) - 1)]):
        arguments = (measured[poor], seen[poor])
        again = _minimise(part, *arguments, found[neighbour], prior, base[poor], rotation[poor], 40)
        better = _cost(part, *arguments, again, prior, base[poor], rotation[poor]) < cost[poor]
        found[poor[better]] = again[better]
        cost = _cost(part, measured, seen, found, prior, base, rotation)
    return found


def _minimise(
    part: Part,
    measured: Array,
    seen: NDArray[np.bool_],
    start: Array,
    prior: Array,
    base: Array,
    rotation: Array,
    iterations: int,
) -> Array:
    """Parameters (T, P) that explain the markers best, from ``start``, chunk by chunk."""
    prior = np.broadcast_to(prior, start.shape)
    out = np.empty_like(start)
    for first in range(0, len(start), _CHUNK):
        c = slice(first, first + _CHUNK)
        out[c] = _levenberg_marquardt(part, measured[c], seen[c], start[c], prior[c], base[c], rotation[c], iterations)
    return out


def _levenberg_marquardt(
    part: Part,
    measured: Array,
    seen: NDArray[np.bool_],
    start: Array,
    prior: Array,
    base: Array,
    rotation: Array,
    iterations: int,
) -> Array:
    size, hinges = part.parameters, 3 * len(part.joints)
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    low[:hinges], high[:hinges] = part.limits.T
    x = np.clip(start, low, high)
    damping = np.full(len(x), 1e-3)
    cost = _cost(part, measured, seen, x, prior, base, rotation)
    active = np.arange(len(x))  # frames that still move
    for _ in range(iterations):
        gradient, hessian = _normal_equations(
            part, measured[active], seen[active], x[active], prior[active], base[active], rotation[active]
        )
        # A hinge at its limit whose slope leads outward is held.
        held = ((x[active] <= low) & (gradient > 0)) | ((x[active] >= high) & (gradient < 0))
        gradient = np.where(held, 0.0, gradient)
        diagonal = np.einsum("tpp->tp", hessian)
        hessian *= ~(held[:, :, None] | held[:, None, :])
        diagonal += np.where(held, 1.0, damping[active, None] * diagonal + 1e-9)
        step = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
        trial = np.clip(x[active] + step, low, high)
        trial_cost = _cost(part, measured[active], seen[active], trial, prior[active], base[active], rotation[active])
        better = trial_cost < cost[active]
        gain = cost[active] - trial_cost
        x[active[better]] = trial[better]
        done = better & (gain < 1e-5 * cost[active]) | (damping[active] > 1e6)
        cost[active[better]] = trial_cost[better]
        damping[active] *= np.where(better, 0.2, 5.0)
        active = active[~done]
        if not len(active):
            break
    return x


def _split(part: Part, x: Array, base: Array) -> tuple[Array, Array]:
    """Hinge angles and the base's position from the parameters."""
    return (x[:, :-3], x[:, -3:]) if part.free else (x, base)


def _prior_residual(part: Part, x: Array, prior: Array) -> Array:
    """Hinges' distance (T, H) from the prior, in its standard deviations; a free base and its turn have no prior."""
    hinges = 3 * len(part.joints)
    residual = (x[:, :hinges] - prior[:, :hinges]) / ANGLE_SIGMA
    if part.free:
        residual[:, :3] = 0.0
    return residual


def _cost(
    part: Part, measured: Array, seen: NDArray[np.bool_], x: Array, prior: Array, base: Array, rotation: Array
) -> Array:
    """Huber cost (T,)."""
    angles, position = _split(part, x, base)
    distance = np.linalg.norm(measured - forward(part, angles, position, rotation).markers, axis=-1)
    huber = np.where(distance < _OUTLIER, distance**2, 2 * _OUTLIER * distance - _OUTLIER**2)
    prior = np.broadcast_to(prior, x.shape)
    return (huber * seen).sum(axis=1) / MARKER_SIGMA**2 + (_prior_residual(part, x, prior) ** 2).sum(axis=1)


def _normal_equations(
    part: Part, measured: Array, seen: NDArray[np.bool_], x: Array, prior: Array, base: Array, rotation: Array
) -> tuple[Array, Array]:
    """Half the gradient (T, P) and the Gauss–Newton matrix (T, P, P) of the cost."""
    angles, position = _split(part, x, base)
    kinematics = forward(part, angles, position, rotation)
    error = kinematics.markers - measured
    distance = np.linalg.norm(error, axis=-1)
    root_weight = np.sqrt(seen * np.minimum(1.0, _OUTLIER / np.maximum(distance, 1e-9))) / MARKER_SIGMA
    slopes = (jacobian(part, kinematics) * root_weight[:, None, :, None]).reshape(len(x), -1, part.parameters)
    weighted = (error * root_weight[..., None]).transpose(0, 2, 1).reshape(len(x), -1, 1)
    transposed = slopes.transpose(0, 2, 1)
    hessian, gradient = transposed @ slopes, (transposed @ weighted)[..., 0]
    hinges = 3 * len(part.joints)
    gradient[:, :hinges] += _prior_residual(part, x, prior) / ANGLE_SIGMA
    first = 3 if part.free else 0
    index = np.arange(first, hinges)
    hessian[:, index, index] += ANGLE_SIGMA**-2
    return gradient, hessian

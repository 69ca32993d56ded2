"""From a person's markers to the joint angles of the skeleton.

Every frame is a regularised non-linear least-squares problem in the hinge angles and the pelvis' position; all frames
of a recording are solved at once. Body and fingers are solved one after the other: given the hands, each finger is a
problem of nine unknowns of its own. Key frames are solved from scratch, the others from the interpolated key frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.body.kinematic_part import Part, forward, make_part
from highfive.mocap_bridge.body.pose_fit import (
    BODY_FIT,
    BodyFitSettings,
    Problem,
    better,
    cost_of,
    kinematics_of,
    minimise,
)
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton


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
    skeleton: Skeleton,
    marker_set: MarkerSet,
    points: Array,
    valid: NDArray[np.bool_],
    settings: BodyFitSettings = BODY_FIT,
) -> BodySolution:
    """Solves the pose of ``skeleton`` in every frame; limits hold, and joints that no marker tells of stay at rest.

    Args:
        skeleton: the body, scaled to the person (``calibration.subject``).
        marker_set: the markers on it.
        points: (T, M, 3) m, in the order of the set.
        valid: (T, M) bool.
        settings: of the fit.

    Raises:
        HighFiveError: fewer than a tenth of the frames show enough markers to place the body.
    """
    body, digits = body_part(skeleton, marker_set), digits_of(skeleton)
    angles = np.tile(skeleton.to_hinges(skeleton.rest), (len(points), 1, 1))
    solved = _solve_body_part(body, points, valid, settings)
    root, angles[:, body.joints] = solved[:, -3:], solved[:, :-3].reshape(len(points), -1, 3)
    positions, orientations = skeleton.forward_kinematics(root, skeleton.from_hinges(angles))
    for chain in digits:
        part, hand = make_part(skeleton, marker_set, chain), skeleton.parents[chain[0]]
        turn = rotations.to_matrix(orientations[:, hand])
        problem = _pose_problem(part, points, valid, positions[:, hand], turn, settings)
        _solve_digit(part, problem, angles)
    quaternions = skeleton.from_hinges(angles)
    positions, orientations = skeleton.forward_kinematics(root, quaternions)
    gap = np.linalg.norm(points - marker_set.simulate(skeleton, positions, orientations), axis=-1)
    residuals = np.where(valid, gap, 0.0)
    rms = np.sqrt((residuals**2).sum(axis=0) / np.maximum(valid.sum(axis=0), 1))
    return BodySolution(root, quaternions, residuals, rms)


def digits_of(skeleton: Skeleton) -> list[list[int]]:
    """The fingers and thumbs, each as its joints from base to tip; a hand is a joint with more than three children."""
    chains = []
    for first, parent in enumerate(skeleton.parents):
        if skeleton.parents.count(parent) > 3:
            chain = [first]
            for joint in range(first + 1, len(skeleton)):
                if skeleton.parents[joint] in chain:
                    chain.append(joint)
            chains.append(chain)
    return chains


def body_part(skeleton: Skeleton, marker_set: MarkerSet) -> Part:
    """The skeleton without its digits, and the markers on it."""
    of_digits = {joint for chain in digits_of(skeleton) for joint in chain}
    return make_part(skeleton, marker_set, [j for j in range(len(skeleton)) if j not in of_digits])


def solve_part_alone(
    part: Part,
    points: Array,
    valid: NDArray[np.bool_],
    start: Array | None = None,
    settings: BodyFitSettings = BODY_FIT,
) -> Array:
    """Parameters (T, P) of the body part in frames that need not be neighbours in time.

    Args:
        part: from :func:`body_part`.
        points: (T, M, 3) m, in the order of the set.
        valid: (T, M) bool.
        start: (T, P) parameters near the solution; None solves from scratch.
        settings: of the fit.
    """
    if start is not None:
        return minimise(part, _body_problem(part, points, valid, settings), start, settings.again_iterations)
    return _solve_body_part(part, points, valid, replace(settings, key_step=1))


def _pose_problem(
    part: Part, points: Array, valid: NDArray[np.bool_], base: Array, rotation: Array, settings: BodyFitSettings
) -> Problem:
    rest = np.tile(part.rest, (len(points), 1))
    return Problem(
        points[:, part.markers], valid[:, part.markers], base, rotation, rest, settings.angle_sigma, settings
    )


def _body_problem(part: Part, points: Array, valid: NDArray[np.bool_], settings: BodyFitSettings) -> Problem:
    frames = len(points)
    upright = np.tile(np.eye(3), (frames, 1, 1))
    return _pose_problem(part, points, valid, np.zeros((frames, 3)), upright, settings)


def _solve_body_part(part: Part, points: Array, valid: NDArray[np.bool_], settings: BodyFitSettings) -> Array:
    """Parameters (T, P) of the body."""
    frames, problem = len(points), _body_problem(part, points, valid, settings)
    usable = np.flatnonzero(problem.seen.sum(axis=1) >= 3)
    if len(usable) < max(1, frames // 10):
        raise HighFiveError(
            f"only {len(usable)} of {frames} frames show three or more of the {len(part.markers)} body markers"
        )
    start = np.column_stack([problem.prior, np.zeros((frames, 3))])
    start[usable, :3], start[usable, -3:] = _place_root(part, problem.measured[usable], problem.seen[usable])
    return _solve_part(part, problem, usable, [start])


def _solve_digit(part: Part, problem: Problem, angles: Array) -> None:
    """Solves one digit on a hand whose pose is known; writes its ``angles`` (T, J, 3) in place."""
    whole = problem.seen.all(axis=1)
    usable = np.flatnonzero(whole if whole.any() else problem.seen.any(axis=1))
    if not len(usable) or not len(part.markers):
        return
    far = np.where(np.abs(part.limits[:, 0]) > np.abs(part.limits[:, 1]), part.limits[:, 0], part.limits[:, 1])
    starts = [problem.prior + bend * (far - part.rest) for bend in problem.settings.bends]
    angles[:, part.joints] = _solve_part(part, problem, usable, starts).reshape(len(angles), -1, 3)


def _solve_part(part: Part, problem: Problem, usable: NDArray[np.intp], starts: list[Array]) -> Array:
    """Parameters (T, P) of a part: key frames from all ``starts``, then every frame from the interpolated ones."""
    frames, s = len(problem.measured), problem.settings
    keys = np.unique(np.append(usable[:: s.key_step], usable[-1]))
    at_keys = problem.take(keys)
    found = minimise(part, at_keys, starts[0][keys], s.iterations)
    for start in starts[1:]:
        found = better(part, at_keys, found, minimise(part, at_keys, start[keys], s.iterations))
    found = _retry_bad(part, at_keys, found)
    if s.key_step == 1:
        return _over_time(part, keys, found, frames)
    for _ in range(s.smoothings):  # what the markers leave open shall not change from one key frame to the next
        found = _over_time(part, keys, found, frames)[keys]
        found = minimise(part, at_keys.near(_smoothed(found)), found, s.near_iterations)
    found = _over_time(part, keys, found, frames)
    solved = minimise(part, problem.take(usable).near(found[usable]), found[usable], s.near_iterations)
    solved = _over_time(part, usable, solved, frames)
    blind = np.setdiff1d(np.flatnonzero(problem.seen.any(axis=1)), usable)
    if len(blind):
        solved[blind] = minimise(part, problem.take(blind).near(solved[blind]), solved[blind], s.near_iterations)
    return _without_mislabelled(part, problem, solved)


def _without_mislabelled(part: Part, problem: Problem, solved: Array) -> Array:
    """Solves frames with a marker far from where the body has it once more without that marker."""
    distance = np.linalg.norm(problem.measured - kinematics_of(part, problem, solved).markers, axis=-1)
    far, s = problem.seen & (distance > problem.settings.mislabelled), problem.settings
    frames = np.flatnonzero(far.any(axis=1))
    if len(frames):
        trusted = replace(problem, seen=problem.seen & ~far)
        near = trusted.take(frames).near(solved[frames])
        solved[frames] = minimise(part, near, solved[frames], s.near_iterations)
    return solved


def _smoothed(parameters: Array) -> Array:
    """Weighted mean over five rows, the first and last one repeated."""
    padded = np.pad(parameters, ((2, 2), (0, 0)), mode="edge")
    weights = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0
    return sum((w * padded[i : i + len(parameters)] for i, w in enumerate(weights)), np.zeros_like(parameters))


def _over_time(part: Part, known: NDArray[np.intp], parameters: Array, frames: int) -> Array:
    """Parameters of all frames (T, P) from those of the ``known`` ones, by linear interpolation."""
    parameters = parameters.copy()
    if part.free:
        parameters[:, :3] = np.unwrap(parameters[:, :3], axis=0)
    return np.column_stack([np.interp(np.arange(frames), known, column) for column in parameters.T])


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
    rotation = rotations.nearest_rotation(spread)
    order = "".join("xyz"[axis] for axis in part.axes[0])
    hinges = rotations.to_euler(order, rotations.from_matrix(rotation))
    return hinges, centre - np.einsum("tij,tj->ti", rotation, rest_centre)


def _retry_bad(part: Part, problem: Problem, found: Array) -> Array:
    """Solves frames that ended in a poor minimum again, from the good frames next to them; keeps the best."""
    cost, s = cost_of(part, problem, found), problem.settings
    poor = np.flatnonzero(cost > s.poor * np.median(cost) + 1e-9)
    good = np.setdiff1d(np.arange(len(found)), poor)
    if not len(poor) or not len(good):
        return found
    found, again = found.copy(), problem.take(poor)
    place = np.searchsorted(good, poor)
    for neighbour in (good[np.maximum(place - 1, 0)], good[np.minimum(place, len(good) - 1)]):
        solved = minimise(part, again, found[neighbour], s.iterations)
        found[poor] = better(part, again, found[poor], solved)
    return found

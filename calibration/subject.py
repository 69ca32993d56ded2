"""A person's own bone lengths and marker places, from a recording of any movement.

Alternates between solving the pose with the body as it is known and, given the rotations, the linear least-squares
problem of segment scales and marker places. Weak priors keep what the recording does not show at the proportions of the
reference body.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mocap_bridge.body_solver import BodySolution, solve_body
from mocap_bridge.marker_sets import MarkerSet, segment_lengths
from model import rotations
from model.errors import HighFiveError
from model.rotations import Array
from model.skeleton import Skeleton

FRAMES = 40
"""Frames of the recording that the fit looks at, spread over its length."""

ROUNDS = 8
SCALE_SIGMA = 0.10
"""Standard deviation of a segment's scale about the body's overall scale: people's proportions differ by so much."""

PLACE_SIGMA = 0.010
"""Standard deviation of a marker's place on its segment about the set's, m."""

_MARKER_SIGMA = 0.003

# Joints whose offsets from their parents share one scale; left and right always do. Any other joint has its own.
_MEASURES = {
    "trunk": ("lumbar_5", "lumbar_3", "thoracic_12", "thoracic_8", "neck"),
    "head": ("head",),
    "shoulders": ("clavicle", "shoulder"),
    "hand": tuple(f"{f}_{i}" for f in ("thumb", "index", "middle", "ring", "little") for i in (1, 2, 3)),
}


@dataclass(frozen=True)
class Subject:
    """A person's body.

    Attributes:
        skeleton: the skeleton with the person's bone lengths.
        marker_set: the set with the markers where this person wears them.
        rms: (M,) m, root mean square of each marker's residual over the frames looked at; 0 for markers never seen.
        scales: scale of each measure of the body relative to the skeleton that was given.
    """

    skeleton: Skeleton
    marker_set: MarkerSet
    rms: Array
    scales: dict[str, float]


def fit_subject(
    skeleton: Skeleton, marker_set: MarkerSet, points: Array, valid: NDArray[np.bool_], frames: int = FRAMES
) -> Subject:
    """Fits bone lengths and marker places to a recording.

    Args:
        skeleton: the reference body.
        marker_set: the markers as the set places them.
        points: (T, M, 3) m, in the order of the set; any movement, the livelier the better.
        valid: (T, M) bool.
        frames: number of frames looked at.

    Raises:
        HighFiveError: the recording shows too few markers to place the body.
    """
    often = valid.sum(axis=1)
    candidates = np.flatnonzero(often >= max(3, np.quantile(often, 0.5)))
    if not len(candidates):
        raise HighFiveError(f"no frame shows three markers of the set {marker_set.name}; the subject cannot be fitted")
    chosen = candidates[np.unique(np.linspace(0, len(candidates) - 1, frames).astype(int))]
    points, valid = points[chosen], valid[chosen]
    measure_names, measure_of = _measures(skeleton)
    body, markers, scales = skeleton, marker_set, np.ones(len(measure_names))
    for _ in range(ROUNDS):
        pose = solve_body(body, markers, points, valid, key_step=1)
        scales, moved = _scales_and_places(skeleton, marker_set, measure_of, len(scales), pose, points, valid)
        body = replace(skeleton, offsets=skeleton.offsets * scales[measure_of][:, None])
        lengths = segment_lengths(body)
        stretch = [lengths[body.index(joint)] / marker_set.segments[joint].length for joint in marker_set.joints]
        markers = replace(marker_set, local_positions=marker_set.local_positions + moved / np.array(stretch)[:, None])
    pose = solve_body(body, markers, points, valid, key_step=1)
    return Subject(body, markers, pose.rms, dict(zip(measure_names, scales.tolist(), strict=True)))


def _measures(skeleton: Skeleton) -> tuple[list[str], NDArray[np.intp]]:
    """Names of the body's measures and, for each joint, the measure that its offset belongs to."""
    names: list[str] = []
    belongs = []
    for name in skeleton.names:
        plain = name.removeprefix("left_").removeprefix("right_")
        measure = next((measure for measure, joints in _MEASURES.items() if plain in joints), plain)
        if measure not in names:
            names.append(measure)
        belongs.append(names.index(measure))
    return names, np.array(belongs)


def _scales_and_places(
    skeleton: Skeleton,
    marker_set: MarkerSet,
    measure_of: NDArray[np.intp],
    measures: int,
    pose: BodySolution,
    points: Array,
    valid: NDArray[np.bool_],
) -> tuple[Array, Array]:
    """Scales (S,) and shifts (M, 3), m, of the markers on their segments, given the rotations of the pose.

    A marker's place is linear in both: x = root + Σ s R o along the path + R (l(s) + d) with offsets o, place l.
    Each frame's mean is taken out of the equations, which does away with the root.
    """
    _, orientations = skeleton.forward_kinematics(pose.root, pose.quaternions)
    turned = rotations.to_matrix(orientations)  # (T, J, 3, 3)
    columns = _scale_columns(skeleton, marker_set, measure_of, measures, turned)
    carriers = [skeleton.index(name) for name in marker_set.joints]
    count = len(marker_set)
    unknowns = measures + 3 * count
    normal, right = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    for t in range(len(points)):
        seen = np.flatnonzero(valid[t])
        rows = np.zeros((len(seen), 3, unknowns))
        rows[:, :, :measures] = columns[t, seen]
        for row, m in enumerate(seen):
            first = measures + 3 * m
            rows[row, :, first : first + 3] = turned[t, carriers[m]]
        target = points[t, seen] - points[t, seen].mean(axis=0)
        rows = (rows - rows.mean(axis=0)).reshape(-1, unknowns)
        normal += rows.T @ rows
        right += rows.T @ target.reshape(-1)
    normal, right = normal / _MARKER_SIGMA**2, right / _MARKER_SIGMA**2
    # Scales lie about their own mean, which is free; the places lie about the set's.
    about_mean = np.eye(measures) - np.full((measures, measures), 1.0 / measures)
    normal[:measures, :measures] += about_mean / SCALE_SIGMA**2 * _frames_weight(len(points))
    places = np.arange(measures, unknowns)
    normal[places, places] += _frames_weight(len(points)) / PLACE_SIGMA**2
    solution = np.linalg.solve(normal, right)
    places_moved = solution[measures:].reshape(count, 3)
    return np.asarray(solution[:measures], dtype=float), np.asarray(places_moved, dtype=float)


def _frames_weight(frames: int) -> float:
    """The residuals are misfit of the model, alike in neighbouring frames: all frames together count as a few."""
    return frames / 4.0


def _scale_columns(
    skeleton: Skeleton, marker_set: MarkerSet, measure_of: NDArray[np.intp], measures: int, turned: Array
) -> Array:
    """Derivative (T, M, 3, S) of the markers' positions by the scales."""
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    out = np.zeros((len(turned), len(marker_set), 3, measures))
    for m, name in enumerate(marker_set.joints):
        joint = skeleton.index(name)
        place = turned[:, joint] @ marker_set.local_positions[m]
        children = [child for child, parent in enumerate(skeleton.parents) if parent == joint] or [joint]
        for child in children:  # a segment is as long as the mean distance to its children
            share = lengths[child] / len(children) / marker_set.segments[name].length
            out[:, m, :, measure_of[child]] += share * place
        while skeleton.parents[joint] >= 0:
            parent = skeleton.parents[joint]
            out[:, m, :, measure_of[joint]] += turned[:, parent] @ skeleton.offsets[joint]
            joint = parent
    return out

"""A person's own bone lengths and marker places, from a recording of any movement.

A Gauss–Newton fit of segment scales and marker places together with the poses of some frames; each frame's pose is
eliminated from the normal equations (Schur complement), so that scales and poses move as one. Weak priors keep what the
recording does not show at the proportions of the reference body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.body.body_solver import body_part, solve_body, solve_part_alone
from highfive.mocap_bridge.body.kinematic_part import Part, forward, jacobian
from highfive.mocap_bridge.body.pose_fit import BODY_FIT, BodyFitSettings
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.markers.marker_set import MarkerSet, segment_lengths
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton
from highfive.model.settings import Settings, setting

_LIMBS = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))

# Joints whose offsets from their parents share one scale; left and right always do. Any other joint has its own.
_MEASURES = {
    "trunk": ("lumbar_5", "lumbar_3", "thoracic_12", "thoracic_8", "neck"),
    "head": ("head",),
    "shoulders": ("clavicle", "shoulder"),
    "hand": tuple(f"{f}_{i}" for f in ("thumb", "index", "middle", "ring", "little") for i in (1, 2, 3)),
}


@dataclass(frozen=True)
class SubjectSettings(Settings):
    """What the fit of a person's body assumes, and how far it goes. Set by hand."""

    frames: int = setting(40, least=1)
    """Of the recording that the fit looks at, spread over its length."""
    rounds: int = setting(6, least=1)
    """Gauss–Newton steps of the body."""
    scale_sigma: float = setting(0.10, above=0.0)
    """Standard deviation of a segment's scale about the body's overall scale: people's proportions differ by so
    much."""
    damping: float = setting(1e-3, above=0.0)
    """Of a step of the scales: all scales together are all but free."""
    correlated: float = setting(4.0, "frames", above=0.0)
    """That count as one: residuals are misfit of the model, alike in neighbouring frames."""
    alike: float = setting(0.035, least=0.0)
    """Relative difference of limbs up to which two recordings are taken to be of one person."""


SUBJECT = SubjectSettings()


@dataclass(frozen=True)
class Subject:
    """A person's body.

    Attributes:
        skeleton: the skeleton with the person's bone lengths.
        marker_set: the set with the markers where this person wears them.
        rms: (M,) m, root mean square of each marker's residual over the frames looked at; 0 for markers never seen.
        scales: scale of each measure of the body relative to the skeleton that was given.
        length_sigmas: m, standard deviation of the length of each segment that carries markers. A still pose does not
            tell a longer bone from markers that sit elsewhere on it.
        frames: frames that were looked at.
    """

    skeleton: Skeleton
    marker_set: MarkerSet
    rms: Array
    scales: dict[str, float]
    length_sigmas: dict[str, float]
    frames: int


def fit_subject(
    skeleton: Skeleton,
    marker_set: MarkerSet,
    points: Array,
    valid: NDArray[np.bool_],
    settings: SubjectSettings = SUBJECT,
    body_fit: BodyFitSettings = BODY_FIT,
) -> Subject:
    """Fits bone lengths and marker places to a recording.

    Args:
        skeleton: the reference body.
        marker_set: the markers as the set places them.
        points: (T, M, 3) m, in the order of the set; any movement, the livelier the better.
        valid: (T, M) bool.
        settings: of the fit of the body.
        body_fit: of the fit of its poses.

    Raises:
        HighFiveError: the recording shows too few markers to place the body.
    """
    often = valid.sum(axis=1)
    candidates = np.flatnonzero(often >= max(3, np.quantile(often, 0.5)))
    if not len(candidates):
        raise HighFiveError(f"no frame shows three markers of the set {marker_set.name}; the subject cannot be fitted")
    chosen = candidates[np.unique(np.linspace(0, len(candidates) - 1, settings.frames).astype(int))]
    points, valid = points[chosen], valid[chosen]
    measure_names, measure_of = _measures(skeleton)
    body, markers = skeleton, marker_set
    scales, moved = np.ones(len(measure_names)), np.zeros((len(marker_set), 3))
    poses, covariance = None, np.zeros((0, 0))
    for attempt in range(settings.rounds):
        part = body_part(body, markers)
        # Half way the poses are found anew: what was a poor minimum on the unfitted body need not be one any more.
        poses = solve_part_alone(part, points, valid, None if attempt == settings.rounds // 2 else poses, body_fit)
        step, covariance = _improve(
            skeleton, marker_set, measure_of, part, poses, points, valid, scales, moved, settings, body_fit
        )
        scales, moved = scales + step[: len(scales)], moved + step[len(scales) :].reshape(-1, 3)
        body = replace(skeleton, offsets=skeleton.offsets * scales[measure_of][:, None])
        lengths = segment_lengths(body)
        stretch = [lengths[body.index(joint)] / marker_set.segments[joint].length for joint in marker_set.joints]
        markers = replace(marker_set, local_positions=marker_set.local_positions + moved / np.array(stretch)[:, None])
    rms = solve_body(body, markers, points, valid, replace(body_fit, key_step=1)).rms
    named = dict(zip(measure_names, scales.tolist(), strict=True))
    sigmas = _length_sigmas(skeleton, marker_set, measure_of, covariance[: len(scales), : len(scales)])
    return Subject(body, markers, rms, named, sigmas, len(chosen))


def _length_sigmas(
    skeleton: Skeleton, marker_set: MarkerSet, measure_of: NDArray[np.intp], covariance: Array
) -> dict[str, float]:
    """Standard deviations, m, of the lengths of the set's segments, from the covariance (S, S) of the scales."""
    sigmas = {}
    for name in marker_set.segments:
        slope = np.zeros(len(covariance))
        for joint, length in _making_up(skeleton, skeleton.index(name)):
            slope[measure_of[joint]] += length
        sigmas[name] = float(np.sqrt(slope @ covariance @ slope))
    return sigmas


def _making_up(skeleton: Skeleton, joint: int) -> list[tuple[int, float]]:
    """Joints whose offsets make up the length of a joint's segment, and how many m each adds at a scale of one."""
    children = [child for child, parent in enumerate(skeleton.parents) if parent == joint] or [joint]
    return [(child, float(np.linalg.norm(skeleton.offsets[child])) / len(children)) for child in children]


def same_bodies(
    recordings: Sequence[Recording], marker_set: MarkerSet, settings: SubjectSettings = SUBJECT
) -> list[list[int]]:
    """Indices of the recordings, in groups of people whose limbs are equally long, as a table of trials names nobody.

    Only joint centres tell; recordings of skin markers are taken to be of one person.
    """
    lengths = [_limb_lengths(recording, marker_set) for recording in recordings]
    groups: list[list[int]] = []
    means: list[Array] = []
    for number, own in enumerate(lengths):
        apart = [_difference(own, mean) for mean in means]
        if apart and min(apart) <= settings.alike:
            nearest = int(np.argmin(apart))
            groups[nearest].append(number)
            both = np.array([lengths[i] for i in groups[nearest]])
            count = np.isfinite(both).sum(axis=0)
            means[nearest] = np.where(count > 0, np.nansum(both, axis=0) / np.maximum(count, 1), np.nan)
        else:
            groups.append([number])
            means.append(own)
    return groups


def _limb_lengths(recording: Recording, marker_set: MarkerSet) -> Array:
    """Median lengths (L,), m, of the limbs between joint centres of the set, NaN where never seen."""
    centre = {joint: m for m, joint in enumerate(marker_set.joints) if not marker_set.local_positions[m].any()}
    limbs = [
        (centre[f"{side}_{a}"], centre[f"{side}_{b}"])
        for side in ("left", "right")
        for a, b in _LIMBS
        if f"{side}_{a}" in centre and f"{side}_{b}" in centre
    ]
    points, seen = marker_set.arrange(recording.names, recording.points, recording.valid)
    lengths = np.full(len(limbs), np.nan)
    for i, (a, b) in enumerate(limbs):
        both = seen[:, a] & seen[:, b]
        if both.any():
            lengths[i] = np.median(np.linalg.norm(points[both, a] - points[both, b], axis=1))
    return lengths


def _difference(one: Array, other: Array) -> float:
    """Root mean square of the relative difference of limbs; 0 if there is none to compare."""
    ratio = np.log(one / other)
    known = np.isfinite(ratio)
    return float(np.sqrt(np.mean(ratio[known] ** 2))) if known.any() else 0.0


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


def _improve(
    skeleton: Skeleton,
    marker_set: MarkerSet,
    measure_of: NDArray[np.intp],
    part: Part,
    poses: Array,
    points: Array,
    valid: NDArray[np.bool_],
    scales: Array,
    moved: Array,
    settings: SubjectSettings,
    body_fit: BodyFitSettings,
) -> tuple[Array, Array]:
    """Gauss–Newton step (S + 3 M,) of the scales and of the markers' shifts on their segments, m, and its covariance.

    A marker's place is linear in both: x = root + Σ s R o along the path + R (l(s) + d) with offsets o, place l.
    """
    upright = np.tile(np.eye(3), (len(poses), 1, 1))
    kinematics = forward(part, poses[:, :-3], poses[:, -3:], upright)
    by_pose = jacobian(part, kinematics)
    by_body = _body_columns(skeleton, marker_set, measure_of, part, kinematics.rotations, len(scales))
    error = kinematics.markers - points[:, part.markers]
    unknowns = by_body.shape[-1]
    normal, right = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    weak = np.eye(part.parameters) * (body_fit.marker_sigma / body_fit.angle_sigma) ** 2
    # A hinge at its limit does not give way.
    hinges = poses[:, :-3]
    by_pose[..., :-3] *= ((hinges > part.limits[:, 0]) & (hinges < part.limits[:, 1]))[:, None, None, :]
    for t in range(len(poses)):
        seen = valid[t, part.markers]
        c = by_body[t, seen].reshape(-1, unknowns)
        j = by_pose[t][:, seen].transpose(1, 0, 2).reshape(-1, part.parameters)
        # What the pose can explain is not the body's: project it out.
        left = c - j @ np.linalg.solve(j.T @ j + weak, j.T @ c)
        normal += left.T @ c
        right += left.T @ error[t, seen].reshape(-1)
    normal, right = normal / body_fit.marker_sigma**2, right / body_fit.marker_sigma**2
    # Scales lie about their own mean, which is free; the places lie about the set's. The residuals are misfit of the
    # model, alike in neighbouring frames: all frames together count as a few.
    weight = max(1.0, len(poses) / settings.correlated)
    count = len(scales)
    about_mean = np.eye(count) - np.full((count, count), 1.0 / count)
    tied = weight / settings.scale_sigma**2
    normal[:count, :count] += tied * about_mean + weight * settings.damping * np.eye(count)
    right[:count] += tied * (about_mean @ scales)
    places = np.arange(count, unknowns)
    tightness = weight / np.repeat(marker_set.spreads, 3) ** 2
    normal[places, places] += tightness
    right[places] += tightness * moved.reshape(-1)
    step, inverse = -np.linalg.solve(normal, right), np.linalg.inv(normal)
    return np.asarray(step, dtype=float), np.asarray(weight * inverse, dtype=float)


def _body_columns(
    skeleton: Skeleton,
    marker_set: MarkerSet,
    measure_of: NDArray[np.intp],
    part: Part,
    turned: Array,
    measures: int,
) -> Array:
    """Derivative (T, N, 3, S + 3 M) of the part's markers by the scales and by the shifts of all markers."""
    within = {int(joint): i for i, joint in enumerate(part.joints)}
    out = np.zeros((len(turned), len(part.markers), 3, measures + 3 * len(marker_set)))
    for n, m in enumerate(part.markers):
        name = marker_set.joints[m]
        joint = skeleton.index(name)
        own = turned[:, within[joint]]
        out[:, n, :, measures + 3 * m : measures + 3 * m + 3] = own
        place = own @ marker_set.local_positions[m]
        for child, length in _making_up(skeleton, joint):
            out[:, n, :, measure_of[child]] += length / marker_set.segments[name].length * place
        while skeleton.parents[joint] >= 0:
            parent = skeleton.parents[joint]
            out[:, n, :, measure_of[joint]] += turned[:, within[parent]] @ skeleton.offsets[joint]
            joint = parent
    return out

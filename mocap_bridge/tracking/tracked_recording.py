"""A whole recording as the tracker has it: every marker, what was hidden, the arm's angles, the skeleton."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.one_person import read_person
from highfive.mocap_bridge.tracking.chain import segment_order
from highfive.mocap_bridge.tracking.gaps import BLIND, bridged
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.joint_angles import ANGLES
from highfive.mocap_bridge.tracking.tracker import RestartSettings, Tracker
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class TrackedRecording:
    """T frames, M markers in the order of the set, J segments.

    Attributes:
        marker_set: the set.
        rate_hz: frames per second.
        measured: (T, M, 3) m, as recorded; zero where not ``there``.
        there: (T, M) the recording has the marker.
        skeleton: (T, M, 3) m, where the markers sit on the tracked skeleton; NaN where it knows no pose.
        disbelieved: (T, M) the recording has the marker, and the tracker did not believe it or had it elsewhere.
        filled: (T, M, 3) m, where a hidden marker was, from what came before and after; elsewhere as ``measured``.
        usable: (T, M) ``filled`` is worth something.
        filled_sd: (T, M) m, standard deviation of where a hidden marker was, root of the sum over its coordinates; NaN
            where none was filled.
        angles, deviations: (T, 8) rad, of the right arm and their standard deviations; NaN where the markers do not
            show them. Angles run on beyond half a turn.
        segments: names of the segments, a parent before its children.
        parents: (J,) index of each segment's parent, -1 for none.
        centres: (T, J, 3) m, joint centres; NaN before the first pose.
        headings: (T,) rad about the vertical, where the trunk (or what is nearest to it) faces; NaN likewise.
        arm: (T, 5, 3) m, centre of the head, shoulder, elbow, wrist and knuckles of the right arm.
    """

    marker_set: MarkerSet
    rate_hz: float
    measured: Array
    there: NDArray[np.bool_]
    skeleton: Array
    disbelieved: NDArray[np.bool_]
    filled: Array
    usable: NDArray[np.bool_]
    filled_sd: Array
    angles: Array
    deviations: Array
    segments: tuple[str, ...]
    parents: NDArray[np.intp]
    centres: Array
    headings: Array
    arm: Array

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.measured)

    @property
    def times(self) -> Array:
        """(T,) s from the first frame."""
        return np.arange(len(self)) / self.rate_hz

    @property
    def posed(self) -> NDArray[np.bool_]:
        """(T,) the tracker knows a pose."""
        return np.isfinite(self.headings)

    @property
    def labelled(self) -> NDArray[np.bool_]:
        """(M,) the recording has the marker at least once."""
        return np.asarray(self.there.any(axis=0))

    @property
    def hidden(self) -> NDArray[np.bool_]:
        """(T, M) the marker is missing in a recording that has it elsewhere."""
        return ~self.there & self.labelled

    @property
    def residuals(self) -> Array:
        """(T, M) m, distance of a measured marker from where the skeleton has it; NaN where there is one alone."""
        compared = self.there & self.posed[:, None]
        return np.where(compared, np.linalg.norm(self.measured - self.skeleton, axis=-1), np.nan)


@dataclass(frozen=True)
class _Pass:
    positions: Array
    skeleton: Array
    variances: Array
    seen: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    angles: Array
    deviations: Array
    centres: Array
    headings: Array
    arm: Array


def track_recording(
    recording: Recording, marker_set: MarkerSet, advance: Callable[[], object] = lambda: None
) -> TrackedRecording:
    """Runs a recording of one person through the tracker, every frame at the recording's own rate.

    Where a marker is hidden, a second run, from the end to the beginning, tells what came after, and a spline through
    what was seen of the marker itself asks no skeleton. All three count by their precision: the spline where a gap is
    short or the skeleton does not explain this person, the runs where it is long.

    Args:
        recording: of one person, labels without a prefix.
        marker_set: the set that its labels fit.
        advance: called after each frame of each run, :func:`passes` times as many as there are frames.
    """
    measured, there = marker_set.arrange(recording.names, recording.points, recording.valid)
    count = len(recording)
    forward = _run(recording, marker_set, range(count), advance)
    filled, usable, variance = forward.positions, forward.valid, forward.variances
    if passes(recording, marker_set) == 2:
        back = _run(recording, marker_set, range(count - 1, -1, -1), advance)
        spline, variances = bridged(measured, there & forward.seen & back.seen, recording.rate_hz)
        # What the skeleton does not explain is the same in both runs: each counts half.
        precisions = 1.0 / np.stack([2.0 * forward.variances, 2.0 * back.variances, variances])
        positions = np.stack([forward.positions, back.positions, spline])
        filled = (precisions[..., None] * positions).sum(axis=0) / precisions.sum(axis=0)[..., None]
        usable, variance = forward.valid | back.valid, 1.0 / precisions.sum(axis=0)
    segments, parents = _tree(marker_set)
    away = np.linalg.norm(measured - forward.positions, axis=-1)
    elsewhere = RestartSettings().elsewhere
    return TrackedRecording(
        marker_set=marker_set,
        rate_hz=recording.rate_hz,
        measured=measured,
        there=there,
        skeleton=forward.skeleton,
        disbelieved=there & np.isfinite(forward.headings)[:, None] & (~forward.seen | (away > elsewhere)),
        filled=np.where(there[..., None], measured, filled),
        usable=there | usable,
        filled_sd=np.where(~there & there.any(axis=0) & usable, np.sqrt(variance), np.nan),
        angles=_unwrapped(forward.angles),
        deviations=forward.deviations,
        segments=segments,
        parents=parents,
        centres=forward.centres,
        headings=forward.headings,
        arm=forward.arm,
    )


def track(path: Path | str, person: str | None = None, marker_set: str | None = None) -> TrackedRecording:
    """Runs one person of a C3D file through the tracker; see :func:`track_recording`.

    Args:
        path: the file.
        person: prefix of the person's labels; None takes the only person with a right arm.
        marker_set: name or file of a marker set; None finds the one that fits the labels.

    Raises:
        HighFiveError: the file is not usable, it holds several people, or the labels do not fit.
    """
    one = read_person(Path(path), person, marker_set)
    return track_recording(one.recording, one.marker_set)


def passes(recording: Recording, marker_set: MarkerSet) -> int:
    """How often the tracker runs through a recording: twice if a marker is hidden somewhere."""
    _, there = marker_set.arrange(recording.names, recording.points, recording.valid)
    return 2 if (~there & there.any(axis=0)).any() else 1


def _run(recording: Recording, marker_set: MarkerSet, order: Iterable[int], advance: Callable[[], object]) -> _Pass:
    """One run of the tracker through the frames in this ``order``; all results stand at their own frame."""
    tracker, estimate = Tracker(marker_set, recording.rate_hz), HumanArmEstimator(marker_set)
    count, markers = len(recording), len(marker_set)
    segments, _ = _tree(marker_set)
    facing = next(
        (segments.index(name) for name in ("thoracic_8", "thoracic_12", "pelvis", "head") if name in segments), 0
    )
    found = _Pass(
        positions=np.zeros((count, markers, 3)),
        skeleton=np.full((count, markers, 3), np.nan),
        variances=np.full((count, markers), BLIND),
        seen=np.zeros((count, markers), dtype=bool),
        valid=np.zeros((count, markers), dtype=bool),
        angles=np.full((count, len(ANGLES)), np.nan),
        deviations=np.full((count, len(ANGLES)), np.nan),
        centres=np.full((count, len(segments), 3), np.nan),
        headings=np.full(count, np.nan),
        arm=np.full((count, 5, 3), np.nan),
    )
    for step, number in enumerate(order):
        tracked = tracker.update(recording.frame(number, step, recording.rate_hz))
        found.positions[number], found.seen[number], found.valid[number] = (
            tracked.positions,
            tracked.seen,
            tracked.valid,
        )
        variance = np.trace(tracked.covariances, axis1=1, axis2=2)
        found.variances[number] = np.where(tracked.valid, np.maximum(variance, 1e-12), BLIND)
        if (pose := tracker.pose) is not None:
            found.centres[number], found.skeleton[number] = pose[1], tracker.skeleton_markers
            ahead = pose[2][facing][:, 0]
            found.headings[number] = np.arctan2(ahead[1], ahead[0])
            arm = estimate(tracked)
            found.arm[number] = arm.head_position, arm.shoulder, arm.elbow, arm.wrist, arm.knuckles
        if (angles := tracker.arm_angles) is not None:
            found.angles[number] = np.where(angles.seen, angles.angles, np.nan)
            found.deviations[number] = np.where(angles.seen, angles.deviations, np.nan)
        advance()
    return found


def _unwrapped(angles: Array) -> Array:
    """Angles (T, n), rad, without jumps by whole turns, gaps left out; each is mostly within half a turn of zero."""
    result = angles.copy()
    for column in result.T:
        known = np.isfinite(column)
        if known.any():
            run = np.unwrap(column[known])
            column[known] = run - 2.0 * np.pi * np.round(np.median(run) / (2.0 * np.pi))
    return result


def _tree(marker_set: MarkerSet) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    """The segments in the tracker's order, and each one's parent."""
    names = tuple(segment_order(marker_set))
    above = [marker_set.segments[name].parent for name in names]
    return names, np.array([-1 if parent is None else names.index(parent) for parent in above], dtype=np.intp)

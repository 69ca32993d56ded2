"""From a folder of C3D pairs to trials that a model learns from: any lab's recordings, nothing else needed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from highfive.calibration.subject import Subject, fit_subject, same_bodies
from highfive.hil.datasets.dyads import Role, read_pairs
from highfive.hil.runtime.console import say_aside
from highfive.hil.runtime.threads import parallel_map, use_one_blas_thread
from highfive.hil.sim.avatar import avatar_skeleton, right_palm
from highfive.mocap_bridge.body.body_solver import solve_body
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.files.trial_table import TrialRow, read_table, with_held_out
from highfive.mocap_bridge.markers.joint_centres import canonical_names
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.sources.source import RATE_HZ, C3DSource
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trials import Trial

SOLVE_RATE_HZ = 30.0
"""Rate at which the avatar actor's joints are solved; between, splines: a body moves at less than 10 Hz."""

SAME_SIZE = 0.02
"""An actor whose size differs from the avatar's by less counts as of the same size."""

APART = 0.3
"""Palms that come no nearer do not meet, m."""

MEETING = 0.003
"""Palms that are nearly as near as they come, m."""

WHOLE = 0.5
"""Share of the frames in which an arm that is learned from has to be known."""


@dataclass(frozen=True)
class SolvedPair:
    """A trial as the model sees it, and how well the avatar actor's markers were met.

    Attributes:
        trial: the trial at 120 Hz.
        markers: M marker names of the avatar actor.
        rms: (M,) m, residual of each marker; 0 where it was never seen.
    """

    trial: Trial
    markers: tuple[str, ...]
    rms: Array


def load_trials(
    folder: Path,
    human: str = "human",
    avatar: str = "avatar",
    human_set: str | None = None,
    avatar_set: str | None = None,
    progress: Callable[[int], Callable[[], None]] = lambda total: lambda: None,
    say: Callable[[str], None] = say_aside,
    learn_only: bool = False,
    hold_out: bool = False,
    lengths: Callable[[list[float]], None] = lambda seconds: None,
) -> list[SolvedPair]:
    """The trials of a folder, solved, in the avatar's world.

    Args:
        folder: C3D files and ``trials.csv``.
        human: prefix of the person's markers.
        avatar: prefix of the avatar actor's.
        human_set: marker set of the person, a name or a path; None finds the one that fits.
        avatar_set: likewise of the avatar actor.
        progress: called with the number of trials; what comes back is called after each.
        say: called with a line about each thing that had to be found out.
        learn_only: held-out trials are not solved, but still tell where the set's floor, vertical and hands are.
        hold_out: if the table marks no trial as test, some are held out all the same.
        lengths: called, before any marker is solved, with the length of each trial that will be, s; what it raises
            ends the whole.

    Raises:
        HighFiveError: the folder, a file or the people's points are not what is needed.
    """
    use_one_blas_thread()
    rows = read_table(folder, say)
    rows = with_held_out(rows, say) if hold_out else rows
    if learn_only and all(row.test for row in rows):
        raise HighFiveError(f"every trial of {folder} is held out; give those to learn from the split train")
    read = read_pairs([folder / row.file for row in rows], Role(human, human_set), Role(avatar, avatar_set), say)
    wanted = [actor for n, (_, actor) in zip(read.kept, read.pairs, strict=True) if not (learn_only and rows[n].test)]
    lengths([len(actor) / actor.rate_hz for actor in wanted])
    subjects = _fit_actors([actor for _, actor in read.pairs], read.actors)
    if (bodies := len({id(subject) for subject in subjects})) > 1:
        say(f"the limbs are those of {bodies} actors; each was measured")
    jobs = [
        _Job(rows[n], *pair, read.people, subject, read.reflected)
        for n, pair, subject in zip(read.kept, read.pairs, subjects, strict=True)
        if not (learn_only and rows[n].test)
    ]
    solved, files = [], []
    for job, pair in zip(jobs, parallel_map(_solve_or_say, jobs, progress), strict=True):
        if isinstance(pair, SolvedPair):
            solved.append(pair)
            files.append(job.row.file)
        else:
            say(f"{job.row.file} is left out: {pair}")
    for twin, first in _repeated([pair.trial for pair in solved]):
        say(f"{files[twin]} shows the very motion of {files[first]}")
    far = sum(_gap_at_contact(pair.trial) > APART for pair in solved)
    if far:
        nowhere = f"in {far} of {len(solved)} trials the palms come no nearer than {APART} m"
        say(f"{nowhere}; contact is when they are nearest")
    if not solved:
        raise HighFiveError(f"no trial of {folder} can be solved; the reasons are above")
    return solved


def _fit_actors(actors: Sequence[Recording], marker_set: MarkerSet) -> list[Subject | str]:
    """The actor's body of each trial, from up to ten trials of the same person, or in a line why there is none."""
    groups = same_bodies(actors, marker_set)
    jobs = [([actors[i] for i in group[:: max(1, len(group) // 10)]], marker_set) for group in groups]
    fitted = parallel_map(_fit_or_say, jobs, lambda total: lambda: None)
    of_trial = {i: subject for group, subject in zip(groups, fitted, strict=True) for i in group}
    return [of_trial[i] for i in range(len(actors))]


def _fit_or_say(job: tuple[Sequence[Recording], MarkerSet]) -> Subject | str:
    chosen, marker_set = job
    arranged = [marker_set.arrange(actor.names, actor.points, actor.valid) for actor in chosen]
    points = np.concatenate([points for points, _ in arranged])
    valid = np.concatenate([valid for _, valid in arranged])
    try:
        return fit_subject(avatar_skeleton(), marker_set, points, valid)
    except HighFiveError as error:
        return str(error)


def _repeated(trials: Sequence[Trial]) -> list[tuple[int, int]]:
    """Indices of trials that repeat an earlier one, and of that one."""
    first: dict[bytes, int] = {}
    known = [first.setdefault(np.round(trial.hand_points, 4).tobytes(), n) for n, trial in enumerate(trials)]
    return [(n, earlier) for n, earlier in enumerate(known) if n != earlier]


def _gap_at_contact(trial: Trial) -> float:
    return float(np.linalg.norm(trial.palm[trial.contact_frame] - trial.person_palm[trial.contact_frame]))


@dataclass(frozen=True)
class _Job:
    """A trial to be solved; ``reflected``: the person was mirrored to be tracked, the actor was not, or vice versa."""

    row: TrialRow
    person: Recording
    actor: Recording
    people: MarkerSet
    subject: Subject | str
    reflected: bool


def _solve_or_say(job: _Job) -> SolvedPair | str:
    """The solved trial, or in a line why it cannot be: one bad take shall not cost the others."""
    if isinstance(job.subject, str):
        return job.subject
    try:
        return _solve_pair(job, job.subject)
    except HighFiveError as error:
        return str(error)


def _solve_pair(job: _Job, subject: Subject) -> SolvedPair:
    row, actor = job.row, job.actor
    hand_points, person_palm, arm_points = track_hand(job.person, job.people)
    if job.reflected:
        mirror = np.array([1.0, -1.0, 1.0])
        hand_points, person_palm = hand_points * mirror, person_palm * mirror
        arm_points = None if arm_points is None else arm_points * mirror
    times = np.arange(len(hand_points)) / RATE_HZ
    points, valid = subject.marker_set.arrange(actor.names, actor.points, actor.valid)
    step = max(1, round(actor.rate_hz / SOLVE_RATE_HZ))
    keys = np.unique(np.append(np.arange(0, len(points), step), len(points) - 1))
    solution = solve_body(subject.skeleton, subject.marker_set, points[keys], valid[keys])
    skeleton = avatar_skeleton()
    turns = unwrapped(skeleton.to_rotation_vectors(solution.quaternions))
    # The avatar stands on its own legs, not on the actor's. If their sizes differ, the scene shrinks or grows with it:
    # else the avatar's palm would not be where the person's is when the actor's was.
    size = skeleton.offsets[0, 2] / subject.skeleton.offsets[0, 2]
    scene = 1.0 if abs(size - 1.0) < SAME_SIZE else size
    root = solution.root * [scene, scene, size]
    motion = CubicSpline(keys / actor.rate_hz, np.concatenate([turns, root], axis=-1))(times)
    joints, root = motion[:, :-3], motion[:, -3:]
    pose = skeleton.from_rotation_vectors(joints)
    own = subject.skeleton
    own_palm, _, _ = right_palm(own, *own.forward_kinematics(root / [scene, scene, size], pose))
    contact = contact_frame(np.linalg.norm(own_palm - person_palm, axis=-1), RATE_HZ)
    palm, _, _ = right_palm(skeleton, *skeleton.forward_kinematics(root, pose))
    trial = Trial(
        rate_hz=RATE_HZ,
        hand_points=scene * hand_points,
        joints=joints,
        root=root,
        palm=palm,
        person_palm=scene * person_palm,
        contact_frame=contact,
        emotion=row.emotion,
        cell=row.cell,
        repetition=row.repetition,
        test=row.test,
        arm_points=None if arm_points is None else scene * arm_points,
    )
    return SolvedPair(trial, subject.marker_set.names, solution.rms)


def contact_frame(distance: Array, rate_hz: float) -> int:
    """Frame at which two palms come together, from their distance (T,), m.

    Palms that meet stay together for a while, press and slide; which frame of it is the nearest is up to noise. It is
    the first of those that are hardly further apart than the nearest, with at most 0.1 s from one to the next. A slow
    palm, which is hardly further for a while before it meets, is followed for as long as that takes at its speed.
    """
    frame, window = int(np.argmin(distance)), round(0.1 * rate_hz)
    hardly = max(MEETING, 0.1 * float(distance[frame]))
    near = distance <= distance[frame] + hardly
    while len(earlier := np.flatnonzero(near[max(0, frame - window) : frame])):
        frame = max(0, frame - window) + int(earlier[0])
    before = max(0, frame - window // 2)
    speed = float(distance[before] - distance[frame]) / max(frame - before, 1)  # m per frame
    on_its_way = math.ceil(hardly / speed) if 2 * window * speed > hardly else 0
    frame += int(np.argmin(distance[frame : frame + on_its_way + 1]))
    return frame


def unwrapped(turns: Array) -> Array:
    """Rotation vectors (T, 3 J), rad, in which no joint jumps by a full turn from frame to frame."""
    vectors = turns.reshape(len(turns), -1, 3).copy()
    for frame in range(1, len(vectors)):
        now, before = vectors[frame], vectors[frame - 1]
        angle = np.linalg.norm(now, axis=-1, keepdims=True)
        round_trip = now - 2.0 * np.pi * now / np.maximum(angle, 1e-9)
        nearer = np.linalg.norm(round_trip - before, axis=-1) < np.linalg.norm(now - before, axis=-1)
        vectors[frame] = np.where(nearer[:, None], round_trip, now)
    return vectors.reshape(turns.shape)


def track_hand(
    person: Recording, marker_set: MarkerSet, towards_partner: tuple[float, float, float] = (-1.0, 0.0, 0.0)
) -> tuple[Array, Array, Array | None]:
    """Hand points (T, 2, 3), palm centre (T, 3) and elbow, shoulder and head (T, 3, 3), m, at 120 Hz.

    By the tracker and the arm that run online. Where elbow, shoulder and head are not known in :data:`WHOLE` of the
    frames, as where one of their markers is never seen, None stands for the last.

    Where the tracker does not know a point, it is between where it was and where it will be.

    Raises:
        HighFiveError: the hand is seen in less than a tenth of the frames.
    """
    recipe = marker_set.arm
    marker_set = marker_set.subset(recipe.markers) if canonical_names(marker_set) else marker_set
    hand = marker_set.indices((*recipe.elbow, *recipe.wrist, *recipe.hand))
    tracker, arm = Tracker(marker_set, RATE_HZ), HumanArmEstimator(marker_set, towards_partner)
    tracked = [tracker.update(frame) for frame in C3DSource(person)]
    known = np.flatnonzero([markers.valid[hand].all() for markers in tracked])
    if len(known) < max(1, len(tracked) // 10):
        raise HighFiveError(f"{person.source} shows the person's right hand in {len(known)} of {len(tracked)} frames")
    arms = [arm(tracked[frame]) for frame in known]
    hands = np.array([[*a.hand_points.reshape(-1), *a.palm.position] for a in arms])
    hands = _everywhere(known, hands, len(tracked))
    points = None
    if np.mean(whole := [a.whole for a in arms]) >= WHOLE:
        others = np.array([a.arm_points.reshape(-1) for a in arms])[whole]
        points = _everywhere(known[whole], others, len(tracked)).reshape(-1, 3, 3)
    return hands[:, :6].reshape(-1, 2, 3), hands[:, 6:], points


def _everywhere(known: NDArray[np.int64], values: Array, frames: int) -> Array:
    """Values (K, C) of the frames ``known`` (K,), and interpolated ones between, (frames, C)."""
    if len(known) == frames:
        return values
    return np.stack([np.interp(np.arange(frames), known, column) for column in values.T], axis=1)

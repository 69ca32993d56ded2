"""From a folder of C3D pairs to trials that a model learns from: any lab's recordings, nothing else needed."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from calibration.subject import Subject, fit_subject
from hil.avatar import avatar_skeleton, right_palm
from hil.sim.capture import COLUMNS, TABLE
from hil.threads import parallel_map, use_one_blas_thread
from mocap_bridge.body_solver import solve_body
from mocap_bridge.c3d import read_c3d
from mocap_bridge.human_arm import HumanArmEstimator
from mocap_bridge.marker_sets import MarkerSet, find_marker_set, load_marker_set
from mocap_bridge.recording import Recording
from mocap_bridge.sources import RATE_HZ, C3DSource
from mocap_bridge.tracker import Tracker
from model.errors import HighFiveError
from model.rotations import Array
from model.trials import Trial

SOLVE_RATE_HZ = 30.0
"""Rate at which the avatar actor's joints are solved; between, splines: a body moves at less than 10 Hz."""


@dataclass(frozen=True)
class TrialRow:
    """A row of ``trials.csv``."""

    file: str
    emotion: str
    cell: str
    repetition: int
    test: bool


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


def read_table(folder: Path) -> list[TrialRow]:
    """The trials of a folder.

    Raises:
        HighFiveError: no folder, no table, columns missing, a value that is none, or no trial in it.
    """
    path = folder / TABLE
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            rows, columns = list(reader), reader.fieldnames or []
    except OSError as error:
        wanted = f"a {TABLE} with the columns {','.join(COLUMNS)}"
        raise HighFiveError(
            f"cannot read {path}: {error.strerror}; a data folder holds C3D files and {wanted}"
        ) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise HighFiveError(f"{path} is not a table: {error}") from None
    missing = [name for name in COLUMNS if name not in columns]
    if missing:
        raise HighFiveError(f"{path} has the columns {', '.join(columns) or 'none'}; missing are {', '.join(missing)}")
    if not rows:
        raise HighFiveError(f"{path} lists no trial")
    return [_row(path, number, row) for number, row in enumerate(rows, start=2)]


def _row(path: Path, line: int, row: dict[str, str | None]) -> TrialRow:
    text = {key: (row.get(key) or "").strip() for key in COLUMNS}
    if not text["file"] or not text["emotion"]:
        raise HighFiveError(f"{path}, line {line}: a trial needs a file and an emotion")
    if text["split"] not in ("train", "test"):
        raise HighFiveError(f"{path}, line {line}: split is {text['split']!r}; expected train or test")
    try:
        repetition = int(text["repetition"] or -1)
    except ValueError:
        raise HighFiveError(f"{path}, line {line}: repetition is {text['repetition']!r}; expected a number") from None
    return TrialRow(text["file"], text["emotion"], text["cell"], repetition, text["split"] == "test")


def load_trials(
    folder: Path,
    human: str = "human",
    avatar: str = "avatar",
    human_set: str | None = None,
    avatar_set: str | None = None,
    progress: Callable[[int], Callable[[], None]] = lambda total: lambda: None,
) -> list[SolvedPair]:
    """All trials of a folder, solved. The avatar actor's body is fitted once, on the first trials.

    Args:
        folder: C3D files and ``trials.csv``.
        human: prefix of the person's markers.
        avatar: prefix of the avatar actor's.
        human_set: marker set of the person, a name or a path; None finds the one that fits.
        avatar_set: likewise of the avatar actor.
        progress: called with the number of trials; what comes back is called after each.
    """
    use_one_blas_thread()
    rows = read_table(folder)
    recordings = [_read_pair(folder / row.file, human, avatar) for row in rows]
    person, actor = recordings[0]
    people = load_marker_set(human_set) if human_set else find_marker_set(person.names)
    actors = load_marker_set(avatar_set) if avatar_set else find_marker_set(actor.names)
    subject = _fit_actor([actor for _, actor in recordings], actors)
    jobs = [(row, person, actor, people, subject) for row, (person, actor) in zip(rows, recordings, strict=True)]
    return list(parallel_map(_solve_pair, jobs, progress))


def _read_pair(path: Path, human: str, avatar: str) -> tuple[Recording, Recording]:
    recording = read_c3d(path)
    return recording.person(human), recording.person(avatar)


def _fit_actor(actors: Sequence[Recording], marker_set: MarkerSet) -> Subject:
    """The actor's body from up to ten trials spread over the session."""
    chosen = actors[:: max(1, len(actors) // 10)]
    arranged = [marker_set.arrange(actor.names, actor.points, actor.valid) for actor in chosen]
    points = np.concatenate([points for points, _ in arranged])
    valid = np.concatenate([valid for _, valid in arranged])
    return fit_subject(avatar_skeleton(), marker_set, points, valid)


def _solve_pair(job: tuple[TrialRow, Recording, Recording, MarkerSet, Subject]) -> SolvedPair:
    row, person, actor, people, subject = job
    hand_points, person_palm = track_hand(person, people)
    times = np.arange(len(hand_points)) / RATE_HZ
    points, valid = subject.marker_set.arrange(actor.names, actor.points, actor.valid)
    step = max(1, round(actor.rate_hz / SOLVE_RATE_HZ))
    keys = np.unique(np.append(np.arange(0, len(points), step), len(points) - 1))
    solution = solve_body(subject.skeleton, subject.marker_set, points[keys], valid[keys])
    skeleton = avatar_skeleton()
    # The avatar stands on its own legs, not on the actor's.
    root = solution.root * [1.0, 1.0, skeleton.offsets[0, 2] / subject.skeleton.offsets[0, 2]]
    sampled = np.concatenate([skeleton.to_rotation_vectors(solution.quaternions), root], axis=-1)
    motion = CubicSpline(keys / actor.rate_hz, sampled)(times)
    joints, root = motion[:, :-3], motion[:, -3:]
    kinematics = skeleton.forward_kinematics(root, skeleton.from_rotation_vectors(joints))
    palm, _, _ = right_palm(skeleton, *kinematics)
    trial = Trial(
        rate_hz=RATE_HZ,
        hand_points=hand_points,
        joints=joints,
        root=root,
        palm=palm,
        person_palm=person_palm,
        contact_frame=int(np.argmin(np.linalg.norm(palm - person_palm, axis=-1))),
        emotion=row.emotion,
        cell=row.cell,
        repetition=row.repetition,
        test=row.test,
    )
    return SolvedPair(trial, subject.marker_set.names, solution.rms)


def track_hand(
    person: Recording, marker_set: MarkerSet, towards_partner: tuple[float, float, float] = (-1.0, 0.0, 0.0)
) -> tuple[Array, Array]:
    """Hand points (T, 2, 3) and palm centre (T, 3), m, at 120 Hz, by the tracker and the arm that run online."""
    tracker, arm = Tracker(marker_set, RATE_HZ), HumanArmEstimator(marker_set, towards_partner)
    arms = [arm(tracker.update(frame)) for frame in C3DSource(person)]
    return np.array([a.hand_points for a in arms]), np.array([a.palm.position for a in arms])

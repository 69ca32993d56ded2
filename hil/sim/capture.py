"""What motion capture would have seen of the simulated pair: noisy markers, occlusions and ghosts, as C3D files."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.sim.actors import CELLS, RATE_HZ, ActorMotion, PairTrial, simulate_pair
from hil.sim.emotions import EMOTIONS, emotion_style
from hil.threads import parallel_map
from mocap_bridge.c3d import write_c3d
from mocap_bridge.marker_sets import MarkerSet, load_marker_set
from mocap_bridge.recording import Recording
from model.errors import HighFiveError
from model.rotations import Array

PERSON_SET, AVATAR_SET = "paper", "full_body"
TABLE = "trials.csv"
COLUMNS = ("file", "emotion", "cell", "repetition", "split")


@dataclass(frozen=True)
class Defects:
    """What goes wrong in a capture."""

    noise: float = 0.0005
    """Standard deviation of each coordinate, m."""
    gaps_a_second: float = 0.02
    """Occlusions of each marker, a second."""
    gap_s: tuple[float, float] = (0.03, 0.25)
    """Shortest and longest occlusion, s."""
    ghosts_a_second: float = 1.0
    """Ghost markers that appear, a second; each lasts some frames."""


CLEAN = Defects(0.0, 0.0, (0.0, 0.0), 0.0)


def trial_seed(seed: int, emotion: str, cell: str, repetition: int) -> np.random.Generator:
    """The generator of one trial: the same whatever other trials are made."""
    return np.random.default_rng([seed, list(EMOTIONS).index(emotion), CELLS.index(cell), repetition])


def markers_of(motion: ActorMotion, marker_set: MarkerSet) -> Array:
    """True marker positions (T, M, 3), m, of an actor who wears ``marker_set``."""
    kinematics = motion.skeleton.forward_kinematics(motion.root_in_world, motion.quaternions)
    return marker_set.simulate(motion.skeleton, *kinematics)


def record(actors: Sequence[tuple[str, Array, MarkerSet]], defects: Defects, rng: np.random.Generator) -> Recording:
    """A capture of several actors.

    Args:
        actors: a prefix (with its colon, or empty), the true markers (T, M, 3), m, and their set, for each.
        defects: noise, occlusions and ghosts.
        rng: where the defects come from.
    """
    names = tuple(prefix + name for prefix, _, marker_set in actors for name in marker_set.names)
    truth = np.concatenate([points for _, points, _ in actors], axis=1)
    seen = _occlusions(truth.shape[:2], defects, rng)
    noisy = truth + rng.normal(0.0, defects.noise, truth.shape)
    ghosts, ghosts_seen = _ghosts(truth, defects, rng)
    return Recording(
        RATE_HZ, names, np.where(seen[..., None], noisy, 0.0), seen, ghosts, ghosts_seen, "simulated capture"
    )


def record_pair(trial: PairTrial, defects: Defects, rng: np.random.Generator) -> Recording:
    """Both actors of a trial: ``human:`` with head and right arm, ``avatar:`` with the whole body."""
    person, avatar = load_marker_set(PERSON_SET), load_marker_set(AVATAR_SET)
    actors = [
        ("human:", markers_of(trial.person, person), person),
        ("avatar:", markers_of(trial.avatar, avatar), avatar),
    ]
    return record(actors, defects, rng)


def _occlusions(shape: tuple[int, int], defects: Defects, rng: np.random.Generator) -> NDArray[np.bool_]:
    frames, markers = shape
    seen = np.ones(shape, dtype=bool)
    for marker in range(markers):
        for _ in range(rng.poisson(defects.gaps_a_second * frames / RATE_HZ)):
            start = rng.integers(frames)
            seen[start : start + max(1, round(rng.uniform(*defects.gap_s) * RATE_HZ)), marker] = False
    return seen


def _ghosts(truth: Array, defects: Defects, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """Two tracks of unlabelled points (T, 2, 3), m, near the actors, each seen for 1 to 20 frames at a time."""
    frames = len(truth)
    points, seen = np.zeros((frames, 2, 3)), np.zeros((frames, 2), dtype=bool)
    low, high = truth.min(axis=(0, 1)), truth.max(axis=(0, 1))
    for _ in range(rng.poisson(defects.ghosts_a_second * frames / RATE_HZ)):
        start, track = rng.integers(frames), rng.integers(2)
        run = slice(start, start + int(rng.integers(1, 21)))
        points[run, track], seen[run, track] = rng.uniform(low, high), True
    return points, seen


@dataclass(frozen=True)
class _Job:
    folder: Path
    emotion: str
    cell: str
    repetition: int
    split: str
    seed: int

    @property
    def file(self) -> str:
        return f"{self.emotion}_{self.cell}_{self.repetition + 1}.c3d"


def _write_trial(job: _Job) -> None:
    rng = trial_seed(job.seed, job.emotion, job.cell, job.repetition)
    trial = simulate_pair(job.emotion, job.cell, job.repetition, rng)
    write_c3d(job.folder / job.file, record_pair(trial, Defects(), rng))


def capture(
    folder: Path,
    emotions: Sequence[str] = tuple(EMOTIONS),
    repetitions: int = 3,
    test_repetitions: int = 0,
    seed: int = 0,
    progress: Callable[[int], Callable[[], None]] = lambda total: lambda: None,
) -> int:
    """Captures every emotion at every cell, ``repetitions`` times, into ``folder``; returns the number of trials.

    Writes one C3D file a trial and ``trials.csv``, the table last: a folder without it is an unfinished capture. The
    last ``test_repetitions`` of each are marked as held out.

    Raises:
        HighFiveError: an unknown emotion, nothing to capture, or a folder that cannot be written.
    """
    for emotion in emotions:
        emotion_style(emotion)
    if repetitions < 1 or not 0 <= test_repetitions < repetitions:
        raise HighFiveError(
            f"{repetitions} repetitions of which {test_repetitions} held out leave nothing to learn from; "
            "at least one repetition has to be for training"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / TABLE).unlink(missing_ok=True)
    except OSError as error:
        raise HighFiveError(f"cannot write to {folder}: {error.strerror}") from None
    jobs = [
        _Job(folder, emotion, cell, r, "test" if r >= repetitions - test_repetitions else "train", seed)
        for emotion in emotions
        for cell in CELLS
        for r in range(repetitions)
    ]
    for _ in parallel_map(_write_trial, jobs, progress):
        pass
    write_table(folder, [(j.file, j.emotion, j.cell, str(j.repetition + 1), j.split) for j in jobs])
    return len(jobs)


def write_table(folder: Path, rows: Sequence[tuple[str, str, str, str, str]]) -> None:
    """Writes ``trials.csv``."""
    try:
        with (folder / TABLE).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            writer.writerows(rows)
    except OSError as error:
        raise HighFiveError(f"cannot write {folder / TABLE}: {error.strerror}") from None

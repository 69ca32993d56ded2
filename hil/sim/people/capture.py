"""What motion capture would have seen of the simulated pair: noisy markers, occlusions and ghosts, as C3D files."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree

import numpy as np
from numpy.typing import NDArray

from highfive.hil.runtime.console import counted, say_aside
from highfive.hil.runtime.folders import results_folder
from highfive.hil.runtime.threads import interrupts_held, parallel_map
from highfive.hil.sim.people.actors import PairTrial, simulate_pair
from highfive.hil.sim.people.emotions import EMOTIONS, emotion_style
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.people.role import RATE_HZ, ActorMotion
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.files.trial_table import LARGEST_TABLE, TABLE, table_bytes, write_table
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError
from highfive.model.files import leftovers, read_bounded, unfinished
from highfive.model.geometry.rotations import Array

PERSON_SET, AVATAR_SET = "paper", "full_body"


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
    overwrite: bool = False,
) -> int:
    """Captures every emotion at every cell, ``repetitions`` times, into ``folder``; returns the number of trials.

    Writes one C3D file per trial and ``trials.csv``, last. The last ``test_repetitions`` of each are marked as
    held out. A capture that fails, or is interrupted, leaves nothing; an earlier set, which ``overwrite`` lets it
    replace, stays as it is until the new one is whole.

    Raises:
        HighFiveError: an unknown emotion, nothing to capture, or a folder that holds something or cannot be written.
    """
    with results_folder(folder, overwrite) as locked:
        return _capture(folder, emotions, repetitions, test_repetitions, seed, progress, locked)


def _capture(
    folder: Path,
    emotions: Sequence[str],
    repetitions: int,
    test_repetitions: int,
    seed: int,
    progress: Callable[[int], Callable[[], None]],
    locked: bool,
) -> int:
    for emotion in emotions:
        emotion_style(emotion)
    if repetitions < 1 or not 0 <= test_repetitions < repetitions:
        raise HighFiveError(
            f"{repetitions} repetitions of which {test_repetitions} held out leave nothing to learn from; "
            "at least one repetition has to be for training"
        )
    with _beside(folder, locked) as beside:
        jobs = _jobs(beside, emotions, repetitions, test_repetitions, seed)
        for _ in parallel_map(_write_trial, jobs, progress):
            pass
        with interrupts_held():  # what is whole takes its place in one go
            _put_in_place(folder, jobs)
    return len(jobs)


def _jobs(folder: Path, emotions: Sequence[str], repetitions: int, test_repetitions: int, seed: int) -> list[_Job]:
    return [
        _Job(folder, emotion, cell, r, "test" if r >= repetitions - test_repetitions else "train", seed)
        for emotion in emotions
        for cell in CELLS
        for r in range(repetitions)
    ]


@contextmanager
def _beside(folder: Path, locked: bool) -> Iterator[Path]:
    """A folder inside ``folder`` for recordings until all are there; gone in the end."""
    beside = unfinished(folder / "capture")
    for left in leftovers(folder / "capture") if locked else ():  # nobody else's: the folder's lock is held
        if left.is_dir() and not left.is_symlink():
            rmtree(left, ignore_errors=True)
            done = "could not be removed" if left.exists() else "removed"
            say_aside(f"{left.name} {done} from {folder}, which a killed capture left unfinished")
    try:
        beside.mkdir()
        yield beside
    except OSError as error:
        raise HighFiveError(f"cannot write to {folder}: {error.strerror}") from None
    finally:
        rmtree(beside, ignore_errors=True)


def _put_in_place(folder: Path, jobs: Sequence[_Job]) -> None:
    """Recordings, table, and away with what only the table of an earlier capture named; says what goes and stays."""
    stale = _captured_before(folder) - {job.file for job in jobs}
    for job in jobs:
        os.replace(job.folder / job.file, folder / job.file)
    write_table(folder, _rows(jobs))
    gone = [folder / name for name in stale if (folder / name).is_file()]
    for path in gone:
        path.unlink()
    if gone:
        say_aside(f"{counted(len(gone), 'recording')} of the earlier capture removed, which this one does not have")
    if others := sorted({path.name for path in folder.glob("*.c3d")} - {job.file for job in jobs}):
        say_aside(f"not of this capture, left as they are and not in {TABLE}: {_some(others)}")


def _some(names: Sequence[str]) -> str:
    return f"{', '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''}"


def _captured_before(folder: Path) -> set[str]:
    """Files that the table names, if it is to the byte the one that a capture writes; of any other table none."""
    try:
        content = read_bounded(folder / TABLE, LARGEST_TABLE)
        rows = list(csv.DictReader(io.StringIO(content.decode("utf-8"))))
        emotions = list(dict.fromkeys(row["emotion"] for row in rows))
        repetitions = {int(row["repetition"]) for row in rows}
        held_out = {int(row["repetition"]) for row in rows if row["split"] == "test"}
    except (HighFiveError, OSError, ValueError, KeyError, TypeError, csv.Error):
        return set()
    if not set(emotions) <= set(EMOTIONS):
        return set()
    jobs = _jobs(folder, emotions, len(repetitions), len(held_out), 0)
    return {job.file for job in jobs} if table_bytes(_rows(jobs)) == content else set()


def _rows(jobs: Sequence[_Job]) -> list[tuple[str, str, str, str, str]]:
    return [(job.file, job.emotion, job.cell, str(job.repetition + 1), job.split) for job in jobs]

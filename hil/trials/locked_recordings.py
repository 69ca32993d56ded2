"""The locked set as a data folder: what a motion capture system would have of its people, and of who meets them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from highfive.hil.runtime.threads import parallel_map
from highfive.hil.sim.people.capture import AVATAR_SET, markers_of, record
from highfive.hil.trials.locked_set import SEED, SUBJECTS, LockedTrial, locked_pair, locked_trials
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.files.trial_table import write_table
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set

Progress = Callable[[int], Callable[[], None]]


@dataclass(frozen=True)
class _Job:
    folder: Path
    number: int
    trial: LockedTrial

    @property
    def file(self) -> str:
        return f"locked_{self.number:03d}.c3d"


def write_locked(
    folder: Path, progress: Progress = lambda total: lambda: None, trials: Sequence[LockedTrial] | None = None
) -> None:
    """Writes C3D files and ``trials.csv``, all of them held out; trials in which nobody can meet are not in it.

    Args:
        folder: is there, and empty.
        progress: called with the number of trials; what comes back is called after each.
        trials: a part of the set; None for all of it.

    Raises:
        HighFiveError: it cannot be written.
    """
    jobs = [_Job(folder, number, trial) for number, trial in enumerate(trials or locked_trials(), 1)]
    written = parallel_map(_write, jobs, progress)
    rows = [
        (job.file, job.trial.emotion, job.trial.cell, str(job.number), "test")
        for job, there in zip(jobs, written, strict=True)
        if there
    ]
    write_table(folder, rows)


def _write(job: _Job) -> bool:
    found = locked_pair(job.trial)
    if found is None:
        return False
    partner, pair = found
    avatar = load_marker_set(AVATAR_SET)
    rng = np.random.default_rng([SEED, job.number])  # the person's markers are those of all else that uses the set
    other = record([("", markers_of(pair.avatar, avatar), avatar)], SUBJECTS[job.trial.subject].defects, rng)
    write_c3d(job.folder / job.file, _together(partner.recording, other))
    return True


def _together(person: Recording, avatar: Recording) -> Recording:
    """One recording of both; the points without a label are the person's."""
    return Recording(
        person.rate_hz,
        (*(f"human:{name}" for name in person.names), *(f"avatar:{name}" for name in avatar.names)),
        np.concatenate([person.points, avatar.points], axis=1),
        np.concatenate([person.valid, avatar.valid], axis=1),
        person.unlabelled,
        person.unlabelled_valid,
        "simulated capture",
    )

"""Trainings of an evaluation shared out among processes and hosts, through one folder in which they are kept.

Each process goes through all trainings: one that is there is skipped, one that another process is at is left for later,
any other is begun under a lock. A process that is killed holds no lock, and its checkpoint goes on elsewhere. There is
no scheduler and nothing to install; the folder may lie on a network file system with locks (NFS 4, Lustre).
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path

from highfive.hil.evaluation.model_cache import fit
from highfive.hil.runtime.threads import use_one_blas_thread
from highfive.model.errors import HighFiveError
from highfive.model.files import UNFINISHED
from highfive.model.gp.optimise import ProgressCallback
from highfive.model.hgpdm.presets import Preset
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

WAIT_S = 2.0
"""Between two looks for trainings that others are at."""


@dataclass(frozen=True)
class Training:
    """One training of an evaluation, see :func:`highfive.hil.evaluation.model_cache.fit`."""

    name: str
    trials: tuple[Trial, ...]
    preset: Preset
    inducing: int
    seed: int
    prior: HGPDM | None = None

    @property
    def key(self) -> str:
        """A name that is the same on all hosts, and that of no other training of the same folder and data."""
        learned = [(n, t.emotion, len(t.joints)) for n, t in enumerate(self.trials) if not t.test]
        what = f"{self.name} {self.preset!r} {self.inducing} {self.seed} {learned}"
        return sha256(what.encode()).hexdigest()[:16]

    def run(self, kept: Path, progress: ProgressCallback | None = None) -> None:
        """Trains what is not in the folder yet."""
        fit(self.trials, self.preset, self.inducing, self.seed, kept, progress, prior=self.prior)


@contextmanager
def claimed(path: Path) -> Iterator[bool]:
    """Whether this process has the lock of that file until this is left. Where there are no locks it always has."""
    if fcntl is None:
        yield True
        return
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield False
            return
        yield True
    finally:
        os.close(descriptor)


def share_out(trainings: Sequence[Training], kept: Path, first: int = 0) -> None:
    """Works off all trainings, beginning at the ``first``, beside whoever does the same with the same folder.

    Raises:
        HighFiveError: the folder cannot be written to, or the data cannot be learned from.
    """
    try:
        kept.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HighFiveError(f"cannot write to {kept}: {error.strerror}; give another --models") from None
    left = [*trainings[first:], *trainings[:first]]
    while left:
        later: list[Training] = []
        for training in left:
            with claimed(kept / f"{UNFINISHED}{training.key}.lock") as mine:
                if mine:
                    training.run(kept)
                else:
                    later.append(training)
        if len(later) == len(left):
            time.sleep(WAIT_S)
        left = later


def in_processes(trainings: Sequence[Training], kept: Path, jobs: int) -> None:
    """Works off all trainings in so many processes, each with its share of the cores.

    Raises:
        HighFiveError: as :func:`share_out`; what a process that dies leaves is done by this one.
    """
    context, cores = get_context("spawn"), sorted(_cores())
    each = max(1, len(trainings) // jobs)
    others = [
        context.Process(target=_beside, args=(trainings, kept, number * each % len(trainings), cores[number::jobs]))
        for number in range(1, min(jobs, len(trainings)))
    ]
    for process in others:
        process.start()
    try:
        share_out(trainings, kept)
    finally:
        for process in others:
            process.terminate()  # of no effect on one that is through: nothing is left to do, or all is to end
            process.join()


def _cores() -> set[int]:
    return os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set(range(os.cpu_count() or 1))


def _beside(trainings: Sequence[Training], kept: Path, first: int, cores: Sequence[int]) -> None:
    """A process of its own: XLA takes as many threads as it has cores, so that they do not wait for each other's."""
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)
    use_one_blas_thread()
    share_out(trainings, kept, first)

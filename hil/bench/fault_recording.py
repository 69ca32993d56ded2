"""What a session under faults leaves on the disk, which may be full.

As in the product the arm's ticks and cycles are written once its high five is over and it rests, with the arm still
switched on: a disk that is full from any instant before is met at that write, after so many bytes of it.
"""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.bench.laws import Laws
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording


def record(recorder: SessionRecorder, trial: ArmTrial, room: int | None) -> None:
    """Writes what the arm did; with ``room``, bytes, once more, onto a disk that takes no more than those.

    Raises:
        HighFiveError: it does not fit.
    """
    recorder.record_played(trial)
    if room is not None:
        with _full_disk(recorder.path.stat().st_size + room):
            recorder.record_played(trial)


def judge_recording(laws: Laws, trial: ArmTrial, path: Path) -> None:
    """Every tick and cycle of what was written first can be read, whatever came of the second."""
    found = read_recording(path).channels
    lost = max(len(trial.ticks) - len(found["/safety"]), len(trial.cycles) - len(found["/arm"]))
    laws.judge("recorded messages that are lost", float(max(0, lost)), 0.0)


@contextmanager
def _full_disk(size: int) -> Iterator[None]:
    """Files cannot grow beyond that, bytes, as on a disk that is full."""
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)

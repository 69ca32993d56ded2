"""Files of one high five each: BVH of the avatar, C3D of both people's markers with their table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from highfive.hil.recording.exports.bvh import bvh
from highfive.hil.recording.exports.even_times import even_times
from highfive.hil.recording.exports.export_file import ExportFile, of_bytes
from highfive.hil.recording.exports.trial_arrays import ExportTrial, TrialArrays
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.recording import Recording, make_recording
from highfive.mocap_bridge.files.trial_table import TABLE, table_bytes
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError

AVATAR_SET = "full_body"
"""Of the markers that the avatar would wear: those of the simulated data set."""
PERSON, AVATAR = "human:", "avatar:"


def bvh_files(trials: Sequence[ExportTrial], names: Sequence[str]) -> list[ExportFile]:
    """The avatar's motion, a file a high five."""
    return [
        of_bytes(name, partial(_bvh, trial, name), trial.span.ticks) for trial, name in zip(trials, names, strict=True)
    ]


def _bvh(trial: ExportTrial, name: str) -> bytes:
    arrays = trial.load()
    even = even_times(arrays.times, name)
    return bvh(avatar_skeleton(), even.between(arrays.root), even.turns_between(arrays.quaternions), even.rate_hz)


def c3d_files(trials: Sequence[ExportTrial], names: Sequence[str]) -> list[ExportFile]:
    """Both people's markers, a file a high five, and ``trials.csv``: a folder that ``highfive train`` reads.

    Raises:
        HighFiveError: no markers were recorded.
    """
    if not trials[0].load().names:
        raise HighFiveError(
            "the recording holds no markers (/markers): it was made before version 0.2.0, or not by a session; "
            "csv, npz and bvh can be had of it"
        )
    files = [
        ExportFile(name, partial(_c3d, trial), trial.span.ticks) for trial, name in zip(trials, names, strict=True)
    ]
    rows = [
        (name, trial.span.text("emotion"), trial.span.text("cell"), "", "")
        for trial, name in zip(trials, names, strict=True)
    ]
    return [*files, of_bytes(TABLE, partial(table_bytes, rows))]


def _c3d(trial: ExportTrial, path: Path) -> None:
    write_c3d(path, marker_recording(trial.load(), path.name))


def marker_recording(trial: TrialArrays, name: str) -> Recording:
    """The person's tracked markers, missing where they were not measured, and those that the avatar would wear."""
    even, skeleton, worn = even_times(trial.times, name), avatar_skeleton(), load_marker_set(AVATAR_SET)
    placed = skeleton.forward_kinematics(even.between(trial.root), even.turns_between(trial.quaternions))
    avatar = worn.simulate(skeleton, *placed)
    seen = np.concatenate([even.seen_between(trial.seen), np.ones(avatar.shape[:2], dtype=bool)], axis=1)
    labels = [*(PERSON + marker for marker in trial.names), *(AVATAR + marker for marker in worn.names)]
    return make_recording(even.rate_hz, labels, np.concatenate([even.between(trial.markers), avatar], axis=1), seen)

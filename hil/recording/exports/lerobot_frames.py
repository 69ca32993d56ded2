"""A high five as frames of a lerobot episode: what a policy sees and does.

Angles are in degrees and named ``JOINT.pos``, as of lerobot's own arms; the person is in metres, in the world. An
action is what was commanded at the time of its frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from highfive.hil.recording.exports.arm_arrays import ArmArrays
from highfive.hil.recording.exports.even_times import EVEN, times_of_rate
from highfive.hil.recording.exports.trial_arrays import POINTS, TrialArrays
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.geometry.rotations import Array

STATE, PERSON, ACTION = "observation.state", "observation.environment_state", "action"


@dataclass(frozen=True)
class Frames:
    """N frames of an episode: names of the numbers, and these, (N, D)."""

    names: Mapping[str, tuple[str, ...]]
    values: Mapping[str, Array]


def arm_frames(arrays: TrialArrays, arm: ArmArrays, fps: int) -> Frames:
    """Of a high five in which a servo arm took part, as long as it did."""
    there = (arrays.times, arm.times, arm.commanded_times)
    start, end = max(times[0] for times in there), min(times[-1] for times in there)
    at = start + np.arange(max(0, int((end - start) * fps + EVEN)) + 1) / fps
    names = tuple(f"{joint}.pos" for joint in arm.names)
    return Frames(
        {STATE: names, PERSON: _person_names(), ACTION: names},
        {
            STATE: np.degrees(_between(at, arm.times, arm.positions)),
            PERSON: _between(at, arrays.times, _person(arrays)),
            ACTION: np.degrees(_between(at, arm.commanded_times, arm.commanded)),
        },
    )


def avatar_frames(arrays: TrialArrays, fps: int) -> Frames:
    """Of a high five without an arm: the avatar is the robot, and its action is its pose a frame later."""
    even = times_of_rate(arrays.times, float(fps), float(np.median(np.diff(arrays.times))))
    turns = even.turns_between(arrays.quaternions).reshape(len(even.left), -1)
    poses = np.concatenate([even.between(arrays.root), turns], axis=1)
    joints = [f"{joint}.q{axis}" for joint in avatar_skeleton().names for axis in "wxyz"]
    names = (*_xyz("root"), *joints)
    return Frames(
        {STATE: names, PERSON: _person_names(), ACTION: names},
        {STATE: poses, PERSON: even.between(_person(arrays)), ACTION: np.concatenate([poses[1:], poses[-1:]])},
    )


def _between(at: Array, times: Array, values: Array) -> Array:
    """(N, D) at times (N,), between values (T, D) at times (T,): along straight lines."""
    return np.stack([np.interp(at, times, column) for column in values.T], axis=1)


def _person(arrays: TrialArrays) -> Array:
    """(T, 21) m: her points, and which way her palm looks."""
    return np.concatenate([*arrays.points.values(), arrays.palm_normal], axis=1)


def _person_names() -> tuple[str, ...]:
    return tuple(name for point in (*POINTS, "palm_normal") for name in _xyz(point))


def _xyz(name: str) -> tuple[str, ...]:
    return tuple(f"{name}.{axis}" for axis in "xyz")

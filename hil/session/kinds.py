"""What streams are of, and what lies between two samples of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from highfive.hil.session.shown import Shown
from highfive.hil.sim.avatar import Pose
from highfive.mocap_bridge.frames import HumanArm, MarkerFrame, PalmPose
from highfive.mocap_bridge.sources.marker_mix import mix_frames
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

Sample = TypeVar("Sample")


@dataclass(frozen=True)
class Kind(Generic[Sample]):
    """What a stream is of.

    Attributes:
        name: in messages: "there are no ... yet".
        mix: what is ``share`` (float) of the way from one sample to the next, or beyond, at a time, ns; None for what
            holds until the next one comes.
        layout: what stays the same from sample to sample: names, a shape.
        usable: the sample itself says that it may be used.
    """

    name: str
    mix: Callable[[Sample, Sample, float, int], Sample] | None
    layout: Callable[[Sample], object] = lambda sample: None
    usable: Callable[[Sample], bool] = lambda sample: True


def _mix_poses(a: Pose, b: Pose, share: float, time_ns: int) -> Pose:
    return Pose(
        a.root_in_world + share * (b.root_in_world - a.root_in_world),
        a.hinges + share * (b.hinges - a.hinges),
    )


def _mix_people(a: HumanArm, b: HumanArm, share: float, time_ns: int) -> HumanArm:
    points = ("head_position", "shoulder", "elbow", "wrist", "knuckles", "hand_points")
    mixed = {name: getattr(a, name) + share * (getattr(b, name) - getattr(a, name)) for name in points}
    return replace(
        b,
        **mixed,
        head_orientation=rotations.slerp(a.head_orientation, b.head_orientation, share),
        palm=_mix_palms(a.palm, b.palm, share),
        valid=a.valid and b.valid,
        time_ns=time_ns,
    )


def _mix_palms(a: PalmPose, b: PalmPose, share: float) -> PalmPose:
    normal, fingers = a.normal + share * (b.normal - a.normal), a.fingers + share * (b.fingers - a.fingers)
    normal = normal / (normal @ normal) ** 0.5
    fingers = fingers - normal * (fingers @ normal)
    return PalmPose(
        a.position + share * (b.position - a.position),
        normal,
        fingers / (fingers @ fingers) ** 0.5,
        a.velocity + share * (b.velocity - a.velocity),
    )


def _mix_vectors(a: Array, b: Array, share: float, time_ns: int) -> Array:
    return a + share * (b - a)


def _slerp(a: Array, b: Array, share: float, time_ns: int) -> Array:
    return rotations.slerp(a, b, share)


POSES = Kind[Pose]("poses of the avatar", _mix_poses)
PEOPLE = Kind[HumanArm]("frames of the person", _mix_people, usable=lambda person: person.valid)
MARKERS = Kind[MarkerFrame]("markers", mix_frames, layout=lambda frame: frame.names)
VECTORS = Kind[Array]("numbers", _mix_vectors, layout=np.shape)
"""Channels of an eye tracker, of EEG, joint angles of an arm: arrays of one shape, or scalars."""
ROTATIONS = Kind[Array]("rotations", _slerp, layout=np.shape)
"""Array w, x, y, z."""
EVENTS = Kind[Any]("events", None)
"""Markers of an experiment, a state: whatever holds until the next one."""
SHOWN = Kind[Shown]("reports of what was shown", None)
"""Of a renderer or a headset."""

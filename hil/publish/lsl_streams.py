"""The streams that a session is for the Lab Streaming Layer: what they are called, hold, and say of themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from highfive.hil.publish.publisher import ShownPicture
from highfive.hil.session.session import Sighting
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.mocap_bridge.wire.lsl import channel_descriptions
from highfive.model.geometry.rotations import Array

PERSON, AVATAR, EVENTS, SHOWN = "HighFive-Person", "HighFive-Avatar", "HighFive-Events", "HighFive-Shown"
MOCAP, MARKERS = "MoCap", "Markers"
"""Types of streams by which other programs look for them."""
POINTS = ("wrist", "knuckles", "palm", "head")
"""Of the person, behind her markers."""


@dataclass(frozen=True)
class Stream:
    """A stream.

    Attributes:
        name, kind: LSL's name and type.
        rate_hz: nominal rate; 0 where samples come as things happen.
        channels: of each channel, what is said of it.
        lag_s: what its time stamps make up for: from when the person was seen until her system sent it.
        text: a sample is one text; otherwise numbers, float32.
    """

    name: str
    kind: str
    rate_hz: float
    channels: Sequence[Mapping[str, str]]
    lag_s: float = 0.0
    text: bool = False


def person_stream(markers: Sequence[str], rate_hz: float, lag_s: float) -> Stream:
    """The person at the frames' own times; see :func:`person_sample`."""
    names = [f"person:{name}" for name in (*markers, *POINTS)]
    return Stream(PERSON, MOCAP, rate_hz, channel_descriptions(names), lag_s)


def avatar_stream(rate_hz: float) -> Stream:
    """The avatar at the times for which its poses are; see :func:`avatar_sample`."""
    names = avatar_skeleton().names
    channels = channel_descriptions([f"avatar:{names[0]}"])
    for name in names:
        for part in "ABCD":  # of a quaternion, A is the scalar
            about = {"label": f"avatar:{name}_{part}", "marker": name, "object": "avatar"}
            channels.append({**about, "type": f"Orientation{part}", "unit": "normalized"})
    return Stream(AVATAR, MOCAP, rate_hz, channels)


def events_stream() -> Stream:
    """What happens, as JSON."""
    return Stream(EVENTS, MARKERS, 0.0, [{"label": "event", "type": "Marker"}], text=True)


def shown_stream() -> Stream:
    """What pages and headsets have shown, at the times at which it was seen; see :func:`shown_sample`."""
    units = {"page": "", "frame": "", "pose_age": "ms", "dropped": "", "clock_bound": "ms"}
    return Stream(
        SHOWN, "Display", 0.0, [{"label": name, "type": "Misc", "unit": unit} for name, unit in units.items()]
    )


def shown_sample(picture: ShownPicture) -> Array:
    """(5,): the page's number, the picture's, how old its pose was when it was seen, ms, pictures dropped before it,
    and how far off the page's clock may be, ms.
    """
    shown = picture.shown
    age, bound = 1e-6 * (shown.display_ns - shown.pose_ns), 1e-6 * picture.bound_ns
    return np.array([picture.page, shown.frame, age, shown.dropped, bound], dtype=float)


def person_sample(sighting: Sighting) -> Array:
    """(3 M + 12,) m: the markers as tracked, NaN where this frame did not show one, then :data:`POINTS`, NaN where they
    rest on markers that have been out of sight for too long.
    """
    markers, person = sighting.markers, sighting.person
    points = np.array([person.wrist, person.knuckles, person.palm.position, person.head_position])
    seen = np.where(markers.seen[:, None], markers.positions, np.nan)
    return np.concatenate([seen, np.where(person.valid, points, np.nan)]).ravel()


def avatar_sample(pose: Pose) -> Array:
    """(3 + 53 × 4,): the pelvis, m, then each joint's rotation relative to its parent, w x y z, the pelvis' relative to
    the world.
    """
    return np.concatenate([pose.root_in_world, pose.quaternions.ravel()])

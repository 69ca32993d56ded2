"""One head as a headset and a motion capture system saw it, as the tracks that a registration is fitted to.

The markers of the head, as the marker set has them, make a body: the rigid transform that brings the set's places to
where they were seen (Kabsch 1976). Only a frame that shows all of them counts: with others the body's frame would
shift.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.headset_fit import Track
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.wire.headset import HeadsetPose
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

FEWEST_MARKERS, NARROWEST = 3, 0.01
"""A head's body needs so many markers, and they must lie so far off one line, m (root mean square)."""
LEAST_SEEN = 0.7
"""Of what came, so much must show the head, in the headset's messages and in the markers."""
LEAST_POSES = 100
TURNED = {"nod": (0, np.radians(15.0)), "turn": (1, np.radians(20.0))}
"""What the head must do, about which axis of the eyes (x right, y up), from the 5th to the 95th percentile, rad: two
axes fix a rotation, and the lever between eyes and markers shows only where the head turns."""


def head_markers(marker_set: MarkerSet) -> NDArray[np.intp]:
    """Indices (H,) of the markers that make the head's body.

    Raises:
        HighFiveError: they are too few, or on one line.
    """
    names = marker_set.arm.head
    rows = marker_set.indices(names)
    joints = {marker_set.joints[row] for row in rows}
    places = marker_set.local_positions[rows]
    spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False) / np.sqrt(max(len(rows), 1))
    if joints != {"head"} or len(rows) < FEWEST_MARKERS or spread[1] < NARROWEST:
        raise HighFiveError(
            f"marker set {marker_set.name} has {', '.join(names) or 'nothing'} on the head; a headset is registered to "
            f"at least {FEWEST_MARKERS} markers there, not on one line"
        )
    return rows


def body_track(marker_set: MarkerSet, times: Sequence[float], points: Sequence[Array]) -> Track:
    """The head's body.

    Args:
        marker_set: the set.
        times: (T,) s.
        points: (H, 3) m each, of :func:`head_markers`, all seen.
    """
    places = marker_set.local_positions[head_markers(marker_set)]
    centre, seen = places.mean(axis=0), np.array(points).reshape(-1, len(places), 3)
    middle = seen.mean(axis=1)
    turned = rotations.nearest_rotation(np.einsum("thi,hj->tij", seen - middle[:, None], places - centre))
    turns = rotations.from_matrix(turned)
    return Track(np.array(times, dtype=float), turns, middle - rotations.rotate(turns, centre))


def eyes_track(poses: Sequence[HeadsetPose]) -> Track:
    """The eyes in the headset's space, of poses that have seen the head."""
    viewers = np.array([pose.viewer for pose in poses]).reshape(-1, 7)
    return Track(1e-3 * np.array([pose.holds_ms for pose in poses], dtype=float), viewers[:, 3:], viewers[:, :3])


def check_head(poses: Sequence[HeadsetPose], shown: int, frames: int) -> None:
    """What was recorded is enough for a registration.

    Args:
        poses: all that came, with those in which tracking was lost.
        shown: frames in which all markers of the head were seen.
        frames: that came.

    Raises:
        HighFiveError: too little came, tracking was lost, the space was set anew meanwhile, or the head hardly turned
            about an axis.
    """
    seen = [pose for pose in poses if pose.viewer_seen]
    for count, of, what in (
        (len(seen), len(poses), "messages of the headset show its place"),
        (shown, frames, "frames show all markers of the head"),
    ):
        if of < LEAST_POSES:
            raise HighFiveError(f"{count} {what}, expected {LEAST_POSES} at least: watch for 20 s, both systems on")
        if count < LEAST_SEEN * of:
            raise HighFiveError(
                f"{count} of {of} {what}, expected {100 * LEAST_SEEN:.0f} %: tracking was lost; mend that, and again"
            )
    if len({pose.place for pose in poses}) > 1:
        raise HighFiveError("the headset was recentred meanwhile: its space lies elsewhere now; again, without that")
    quaternions = np.array([pose.viewer[3:] for pose in seen])
    turns = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(quaternions[0]), quaternions))
    for name, (axis, least) in TURNED.items():
        low, high = np.percentile(turns[:, axis], [5.0, 95.0])
        if high - low < least:
            raise HighFiveError(
                f"the head did not {name} enough: {np.degrees(high - low):.0f}°, expected {np.degrees(least):.0f}; "
                "nod and turn it for 20 s"
            )

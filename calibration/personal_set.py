"""The marker set of one person: the body's own lengths and the markers where this person wears them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from highfive.calibration.subject import Subject
from highfive.mocap_bridge.markers.marker_set import MarkerSet, Segment, segment_lengths
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton

SPREAD = 0.005
"""Least standard deviation of a marker's place on its own person, m, per coordinate: skin moves, markers are glued on
again. What the fit left over comes on top."""

_DIGITS = 5  # of a metre: a hundredth of a millimetre


def personal_set(subject: Subject, name: str, description: str) -> MarkerSet:
    """The subject's marker set, written for the subject's own body.

    Markers that the recording never showed (their ``rms`` is 0) keep the spread of the set that was fitted.

    Args:
        subject: from :func:`highfive.calibration.subject.fit_subject`.
        name: name of the new set.
        description: what it is, in a line.
    """
    fitted = subject.marker_set
    spreads = np.where(subject.rms > 0.0, np.hypot(SPREAD, subject.rms / 3**0.5), fitted.spreads)
    own = on_body(fitted, subject.skeleton, spreads)
    segments = {
        joint: replace(segment, sigma=round(subject.length_sigmas[joint], _DIGITS))
        for joint, segment in own.segments.items()
    }
    return replace(own, name=name, description=description, segments=segments)


def on_body(marker_set: MarkerSet, body: Skeleton, spreads: Array) -> MarkerSet:
    """The set on ``body``: its segments, the markers where they are on them, and ``spreads`` (M,), m."""
    upright = np.tile(rotations.IDENTITY, (len(body), 1))
    centres, _ = body.forward_kinematics(body.offsets[0], upright)
    lengths = segment_lengths(body)
    segments = {
        joint: Segment(
            round(float(lengths[body.index(joint)]), _DIGITS),
            np.round(centres[body.index(joint)], _DIGITS),
            segment.parent,
        )
        for joint, segment in marker_set.segments.items()
    }
    return replace(
        marker_set,
        local_positions=np.round(marker_set.positions_on(body), _DIGITS) + 0.0,
        spreads=np.round(spreads, _DIGITS),
        segments=segments,
    )

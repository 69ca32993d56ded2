"""The marker set of one person: the body's own lengths and the markers where this person wears them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.subject import Subject
from mocap_bridge.marker_sets import MarkerSet, Segment, segment_lengths
from model import rotations

SPREAD = 0.003
"""Standard deviation of a marker's place on its own person, m: skin moves, and markers are glued on again."""

_DIGITS = 5  # of a metre: a hundredth of a millimetre


def personal_set(subject: Subject, name: str, description: str) -> MarkerSet:
    """The subject's marker set, written for the subject's own body.

    Markers that the recording never showed (their ``rms`` is 0) keep the spread of the set that was fitted.

    Args:
        subject: from :func:`calibration.subject.fit_subject`.
        name: name of the new set.
        description: what it is, in a line.
    """
    body, fitted = subject.skeleton, subject.marker_set
    upright = np.tile(rotations.IDENTITY, (len(body), 1))
    centres, _ = body.forward_kinematics(body.offsets[0], upright)
    lengths = segment_lengths(body)
    segments = {
        joint: Segment(
            round(float(lengths[body.index(joint)]), _DIGITS),
            np.round(centres[body.index(joint)], _DIGITS),
            segment.parent,
        )
        for joint, segment in fitted.segments.items()
    }
    return replace(
        fitted,
        name=name,
        description=description,
        local_positions=np.round(fitted.positions_on(body), _DIGITS) + 0.0,
        spreads=np.where(subject.rms > 0.0, SPREAD, fitted.spreads),
        segments=segments,
    )

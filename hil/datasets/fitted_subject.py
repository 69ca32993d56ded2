"""A marker set on a recorded person's own body."""

from __future__ import annotations

from highfive.calibration.subject import Subject, fit_subject
from highfive.hil.runtime.console import Bar
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.markers.one_person import OnePerson


def fitted_subject(person: OnePerson, bar: Bar) -> Subject:
    """The marker set on this person's own body.

    Raises:
        HighFiveError: the recording shows too little of it.
    """
    base = person.marker_set
    points, seen = base.arrange(person.recording.names, person.recording.points, person.recording.valid)
    advance = bar("fitting the body", 1)
    try:
        return fit_subject(avatar_skeleton(), base, points, seen)
    finally:
        advance()

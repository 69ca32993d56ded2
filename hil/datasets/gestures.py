"""Recordings of raised hands to which no contact comes: one person a file is enough."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from highfive.calibration.placement import place_person
from highfive.hil.datasets.dyads import person_in
from highfive.hil.datasets.training_data import track_hand
from highfive.hil.runtime.console import say_aside
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.files.trial_table import TrialRow, read_without_contact
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.source import RATE_HZ
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trials import Gesture

HEAD = (1.0, 2.3)
"""m, between which the head of a person is who is in the avatar's world; ..."""
AHEAD = (0.5, 3.0)
"""... and how far in front of the avatar she stands, m."""


def load_gestures(
    folder: Path, human: str = "human", human_set: str | None = None, say: Callable[[str], None] = say_aside
) -> list[Gesture]:
    """The hands of a folder's trials without a contact, in the avatar's world, held-out ones too.

    A person who stands before the avatar is taken as recorded; any other is placed as a single person is
    (:func:`highfive.calibration.placement.place_person`). A file that cannot be used is left out, with a line.

    Args:
        folder: C3D files and ``trials.csv``.
        human: prefix of the person's markers.
        human_set: marker set, a name or a path; None finds the one that fits.
        say: called with a line about each file that is left out.

    Raises:
        HighFiveError: the table cannot be used.
    """
    found = []
    for row in read_without_contact(folder):
        try:
            found.append(_gesture(folder, row, human, human_set))
        except HighFiveError as error:
            say(f"{row.file} is left out: {error}")
    return found


def _gesture(folder: Path, row: TrialRow, human: str, human_set: str | None) -> Gesture:
    whole = read_c3d(folder / row.file, trust_unit=False)
    person = person_in(whole, human) if any(":" in name for name in whole.names) else whole
    marker_set = load_marker_set(human_set) if human_set else find_marker_set(person.names)
    return gesture_of(person, marker_set, row.cell, row.test)


def gesture_of(person: Recording, marker_set: MarkerSet, name: str = "", test: bool = False) -> Gesture:
    """The hand of a recorded person, tracked.

    Raises:
        HighFiveError: her head or arm is not in it.
    """
    if not _before_the_avatar(person, marker_set):
        person = place_person(person, marker_set).apply_to(person)
    return Gesture(RATE_HZ, track_hand(person, marker_set)[0], name, test)


def _before_the_avatar(person: Recording, marker_set: MarkerSet) -> bool:
    points, seen = marker_set.arrange(person.names, person.points, person.valid)
    columns = marker_set.indices(marker_set.arm.head)
    heads = points[:, columns][seen[:, columns]]
    if not len(heads):
        return False
    x, _, z = np.median(heads, axis=0)
    return bool(HEAD[0] < z < HEAD[1] and AHEAD[0] < x < AHEAD[1])

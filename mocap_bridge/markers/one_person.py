"""Whose markers of a recording are meant, and by which marker set: what ``track`` and ``calibrate`` ask alike."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import Recording, prefixes_listed
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.wire.plausible import of_another_unit, spans
from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class OnePerson:
    """One person of a file.

    Attributes:
        path: the file.
        prefix: what stands before the colon of the person's labels; ``''`` for none.
        recording: the person's markers, the prefix taken off.
        marker_set: the set that is used.
        others: prefixes of who else is in the file, where nobody was asked for.
        refused: frames of which nothing is used: their markers span what no person does, so they are of another unit.
    """

    path: Path
    prefix: str
    recording: Recording
    marker_set: MarkerSet
    refused: int = 0
    others: tuple[str, ...] = ()

    @property
    def missing(self) -> tuple[str, ...]:
        """Markers of the set that no label of the recording names."""
        columns = self.marker_set.match(self.recording.names)
        return tuple(name for name, column in zip(self.marker_set.names, columns, strict=True) if column < 0)

    @property
    def unused(self) -> tuple[str, ...]:
        """Labels that the set does not know."""
        used = set(self.marker_set.match(self.recording.names).tolist())
        return tuple(name for column, name in enumerate(self.recording.names) if column not in used)

    def label(self, marker: int) -> str | None:
        """The file's own label of a marker of the set, prefix and all; None where it has none."""
        column = int(self.marker_set.match(self.recording.names)[marker])
        if column < 0:
            return None
        name = self.recording.names[column]
        return f"{self.prefix}:{name}" if self.prefix else name


def read_person(path: Path, person: str | None, requested: str | None) -> OnePerson:
    """Reads a file and chooses person and marker set.

    Without ``person`` it is the only one in the file, or the only one with the markers of a right arm.

    Args:
        path: a C3D file.
        person: prefix of the labels, with or without the colon.
        requested: name or file of a marker set; None finds the one that fits the labels best.

    Raises:
        HighFiveError: the file is not usable, it holds several people, or the labels do not fit.
    """
    whole = read_c3d(path)
    named = person is not None
    chosen = None if requested is None else load_marker_set(requested)
    if person is None and len(whole.prefixes) > 1:
        fitting = [prefix for prefix in whole.prefixes if shows_right_arm(whole.person(prefix), chosen)]
        person = fitting[0] if len(fitting) == 1 else None
    if person is None and len(whole.prefixes) > 1:
        known = prefixes_listed(whole.prefixes)
        raise HighFiveError(f"{whole.source} holds several persons: {known}; say which one with --person")
    one = whole.person(person)
    marker_set = find_marker_set(one.names) if chosen is None else chosen
    one_frame = np.zeros((len(one.names), 3)), np.zeros(len(one.names), dtype=bool)
    marker_set.arrange(one.names, *one_frame, required=marker_set.arm.markers)
    prefix = "".join(whole.prefixes) if person is None else person.removesuffix(":")
    strange = of_another_unit(spans(one.points, one.valid))  # a live system that changed its unit was recorded so
    others = () if named else tuple(other for other in whole.prefixes if other != prefix)
    seen = replace(one, valid=one.valid & ~strange[:, None])
    return OnePerson(path, prefix, seen, marker_set, int(strange.sum()), others)


def shows_right_arm(one: Recording, chosen: MarkerSet | None) -> bool:
    """Whether the labels give a right arm by the set that was requested, or by any that is there."""
    if chosen is not None:
        return bool(np.all(chosen.match(one.names)[chosen.indices(chosen.arm.markers)] >= 0))
    try:
        find_marker_set(one.names)
    except HighFiveError:
        return False
    return True

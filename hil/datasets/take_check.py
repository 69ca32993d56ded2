"""Whether a take of two people is one to learn from: both seen, palms meeting, long enough, where it was asked for.

It is read as ``train`` reads it, so that what passes here is not left out there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from highfive.hil.datasets.dyads import Role, read_pairs
from highfive.hil.datasets.training_data import contact_frame
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class TakeSettings(Settings):
    """What a take has to have. Set by hand; 80 simulated takes with their gaps pass (tests)."""

    shortest_s: float = setting(1.0, "s", above=0.0)
    """Both people are seen for so long."""
    seen: float = setting(0.9, least=0.0, most=1.0)
    """Share of the frames that show each person's hand."""
    gap_s: float = setting(0.4, "s", above=0.0)
    """A hand is unseen for no longer at a time: the tracker predicts for a tenth of that, training fills the rest."""
    apart: float = setting(0.2, "m", above=0.0)
    """The middles of the hands' markers come that near: they sit on backs and fingers of palms that touch."""
    before_s: float = setting(0.3, "s", above=0.0)
    """What leads to the contact is shown for so long, ..."""
    after_s: float = setting(0.1, "s", least=0.0)
    """... and what follows for so long."""


TAKE = TakeSettings()


@dataclass(frozen=True)
class TakeCheck:
    """What a take shows.

    Attributes:
        seconds: for which both are seen.
        seen: share of the frames that show each hand, the person's first.
        gap_s: for which a hand is unseen at most.
        apart: m, how near the hands' markers come.
        contact_s: from the take's beginning.
        place: (3,) m, of the hands then, in the avatar's world.
        cell: the grid's nearest to it.
        troubles: why it is not one to learn from, a line each; none where it is.
    """

    seconds: float
    seen: tuple[float, float]
    gap_s: float
    apart: float
    contact_s: float
    place: tuple[float, float, float]
    cell: str
    troubles: tuple[str, ...]


def check_take(
    path: Path, human: Role, avatar: Role, cells: Mapping[str, tuple[float, float]], wanted: str = "",
    settings: TakeSettings = TAKE,
) -> TakeCheck:  # fmt: skip
    """Looks at a take's file.

    Args:
        path: a C3D file of both people.
        human: the person.
        avatar: who the avatar learns from.
        cells: their y and z in the avatar's world, m.
        wanted: the cell that was asked for; empty for any.
        settings: what it has to have.

    Raises:
        HighFiveError: it shows no two people.
    """
    read = read_pairs([path], human, avatar, lambda line: None)
    if not read.pairs:
        raise HighFiveError("it does not show both people")
    person, actor = read.pairs[0]
    hands = [_hand(person, read.people), _hand(actor, read.actors)]
    known = [np.isfinite(hand).all(axis=1) for hand in hands]
    together = np.logical_and(known[0], known[1])
    if not together.any():
        raise HighFiveError("both hands are never seen at once")
    distance = np.where(together, np.linalg.norm(hands[0] - hands[1], axis=1), np.inf)
    met, rate = contact_frame(distance, actor.rate_hz), actor.rate_hz
    place = 0.5 * (hands[0][met] + hands[1][met])
    found = TakeCheck(
        seconds=len(person) / rate, seen=(float(known[0].mean()), float(known[1].mean())),
        gap_s=max(_longest(one) for one in known) / rate, apart=float(distance.min()), contact_s=met / rate,
        place=(float(place[0]), float(place[1]), float(place[2])), cell=_nearest(place, cells), troubles=(),
    )  # fmt: skip
    return TakeCheck(**{**vars(found), "troubles": tuple(_troubles(found, wanted, settings))})


def _troubles(found: TakeCheck, wanted: str, s: TakeSettings) -> list[str]:
    troubles: list[str] = []
    if found.seconds < s.shortest_s:
        troubles.append(f"both are seen for {found.seconds:.1f} s, expected {s.shortest_s:g} s")
    for who, share in zip(("person", "actor"), found.seen, strict=True):
        if share < s.seen:
            troubles.append(f"the {who}'s hand is seen in {share:.0%} of the frames, expected {s.seen:.0%}")
    if found.gap_s > s.gap_s:
        troubles.append(f"a hand is unseen for {found.gap_s:.2f} s at a time, expected {s.gap_s:g} s at most")
    if found.apart > s.apart:
        troubles.append(f"the hands come no nearer than {found.apart:.2f} m: they did not meet")
    elif found.contact_s < s.before_s or found.seconds - found.contact_s < s.after_s:
        troubles.append(
            f"hands meet {found.contact_s:.2f} s after it begins, of {found.seconds:.1f} s: it is cut short"
        )
    elif wanted and found.cell != wanted:
        y, z = found.place[1:]
        troubles.append(f"hands met in {found.cell} (y {y:.2f} m, z {z:.2f} m), asked for was {wanted}")
    return troubles


def _hand(recording: Recording, marker_set: MarkerSet) -> Array:
    """Middle (T, 3), m, of the markers of the right hand that are seen; NaN where none is."""
    points, seen = marker_set.arrange(recording.names, recording.points, recording.valid)
    columns = marker_set.indices(marker_set.arm.hand or marker_set.arm.wrist)
    weights = seen[:, columns, None].astype(float)
    total = weights.sum(axis=1)
    return np.where(total > 0.0, (weights * points[:, columns]).sum(axis=1) / np.maximum(total, 1.0), np.nan)


def _longest(known: ArrayLike) -> int:
    """How many in a row are not known (T,), at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], np.asarray(known), [True]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _nearest(place: Array, cells: Mapping[str, tuple[float, float]]) -> str:
    return min(cells, key=lambda name: float(np.hypot(place[1] - cells[name][0], place[2] - cells[name][1])))

"""The moments of a trial that pictures, film and figures are about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hil.sim.actors import CELLS
from hil.summary import emotion_of
from hil.trial import TrialResult

_MOVED = 0.05
"""m that the person's palm has to move to count as started."""
_PARTED = 0.05
"""m between the palms from which on they count as released."""


@dataclass(frozen=True)
class Moments:
    """Ticks of a trial: the person starts, is half way, the palms meet (or are nearest), part, and all is over."""

    start: int
    half_way: int
    contact: int
    release: int
    end: int


def contact_tick(result: TrialResult) -> int:
    """Tick at which the palms met, or were nearest."""
    contact = result.contact
    time_ns = contact.nearest_time_ns if contact.met_time_ns is None else contact.met_time_ns
    return int(np.argmin(np.abs(result.times - 1e-9 * time_ns)))


def moments_of(result: TrialResult) -> Moments:
    """The moments of a trial."""
    contact, last = contact_tick(result), len(result.times) - 1
    moved = np.linalg.norm(result.person_palm - result.person_palm[0], axis=-1) > _MOVED
    start = min(int(np.argmax(moved)), contact) if moved.any() else 0
    to_go = np.linalg.norm(result.person_palm - result.person_palm[contact], axis=-1)
    half = start + int(np.argmax(to_go[start : contact + 1] <= 0.5 * to_go[start]))
    apart = np.linalg.norm(result.palm - result.person_palm, axis=-1)[contact:] > apart_at_contact(result) + _PARTED
    release = contact + int(np.argmax(apart)) if apart.any() else last
    return Moments(start, half, contact, release, last)


def apart_at_contact(result: TrialResult) -> float:
    """Distance of the palms at contact, m."""
    i = contact_tick(result)
    return float(np.linalg.norm(result.palm[i] - result.person_palm[i]))


def showpieces(results: Sequence[TrialResult]) -> list[TrialResult]:
    """One trial an emotion, the one to show: palms met near the middle of the grid, nothing else touched."""
    groups: dict[str, list[TrialResult]] = {}
    for result in results:
        groups.setdefault(emotion_of(result), []).append(result)
    return [min(group, key=_blemishes) for group in groups.values()]


def _blemishes(result: TrialResult) -> tuple[bool, bool, int, float]:
    row, column = divmod(CELLS.index(result.cell), 3) if result.cell in CELLS else (1, 1)
    off_centre = abs(row - 1) + abs(column - 1)
    touched = 2 * bool(result.contact.unwanted)
    return not result.contact.met, result.out_of_reach, off_centre + touched, result.error

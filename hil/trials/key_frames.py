"""The key frames of a trial, which pictures, film and figures are about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from highfive.hil.trials.summary import style_of
from highfive.hil.trials.trial_result import TrialResult

_MOVED = 0.05
"""m that the person's palm has to move to count as started."""
_PARTED = 0.05
"""m between the palms from which on they count as released."""


@dataclass(frozen=True)
class KeyFrames:
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


def key_frames_of(result: TrialResult) -> KeyFrames:
    """The key frames of a trial."""
    contact, last = contact_tick(result), len(result.times) - 1
    moved = np.linalg.norm(result.person_palm - result.person_palm[0], axis=-1) > _MOVED
    start = min(int(np.argmax(moved)), contact) if moved.any() else 0
    to_go = np.linalg.norm(result.person_palm - result.person_palm[contact], axis=-1)
    half = start + int(np.argmax(to_go[start : contact + 1] <= 0.5 * to_go[start]))
    apart = np.linalg.norm(result.palm - result.person_palm, axis=-1)[contact:] > apart_at_contact(result) + _PARTED
    release = contact + int(np.argmax(apart)) if apart.any() else last
    return KeyFrames(start, half, contact, release, last)


def apart_at_contact(result: TrialResult) -> float:
    """Distance of the palms at contact, m."""
    i = contact_tick(result)
    return float(np.linalg.norm(result.palm[i] - result.person_palm[i]))


def showpieces(results: Sequence[TrialResult]) -> list[TrialResult]:
    """One trial a style, the one to show: the median one, in how far the palms were apart. One without a touch is the
    worst; of an even number it is the nearer one of the middle."""
    groups: dict[str, list[TrialResult]] = {}
    for result in results:
        if result.whole:
            groups.setdefault(style_of(result), []).append(result)
    return [sorted(group, key=_apart)[(len(group) - 1) // 2] for group in groups.values()]


def _apart(result: TrialResult) -> tuple[bool, float]:
    """To the true palm at first touch, where it is known; else to the tracked one."""
    return not result.contact.met, result.error if np.isnan(result.touch_error) else result.touch_error

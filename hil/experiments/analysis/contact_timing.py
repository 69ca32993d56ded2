"""When and how two palms came to meet: figures of one high five, from both palms' tracks.

Tracks are (T, 3), m, at ``rate_hz``, one row a frame, of one clock, without gaps. Times are s after the first row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from highfive.model.errors import HighFiveError
from highfive.model.evaluation.metrics import speeds
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class TimingSettings(Settings):
    """What counts as moving, waiting and touching."""

    onset: float = setting(0.05, above=0.0, below=1.0)
    """Share of the peak speed at which a reach begins: of smooth reaches some 2 % of their way."""
    peak: float = setting(0.1, above=0.0, below=1.0)
    """Share of the peak speed that another peak stands out by."""
    near: float = setting(0.02, "m", above=0.0)
    """Who waits is nearer than this to the place of contact…"""
    still: float = setting(0.1, "m/s", above=0.0)
    """… and slower than this."""
    fast: float = setting(0.6, "m/s", above=0.0)
    """From this closing speed on, contact is where a line through the last frames before ends."""
    apart: float = setting(0.006, "m", above=0.0)
    """The line goes through frames with a gap above this: nearer, hands give way to each other."""
    line: int = setting(5, least=2, most=100)
    """Frames of the line."""


@dataclass(frozen=True)
class Reach:
    """One palm's way to the contact.

    Attributes:
        onset: s, at which its speed first stays above 5 % of its peak.
        time_to_contact: s, from the onset to the contact.
        waiting: s before the contact for which it was at the place already, and still.
        arrival: s, of its least distance to the place of contact.
        peak_speed: m/s.
        peak_at: when, as a share of the time to contact.
        peaks: of its speed, from onset to contact: one in a smooth reach.
    """

    onset: float
    time_to_contact: float
    waiting: float
    arrival: float
    peak_speed: float
    peak_at: float
    peaks: int


@dataclass(frozen=True)
class ContactTiming:
    """One high five.

    Attributes:
        person, avatar: their reaches.
        asynchrony: s, the person's arrival minus the avatar's: below 0, she was there first.
        closing_speed: m/s, at which the palms came nearer just before the contact.
        miss: m, the least distance of the palms' points.
    """

    person: Reach
    avatar: Reach
    asynchrony: float
    closing_speed: float
    miss: float


def contact_timing(
    person: Array, avatar: Array, rate_hz: float, contact: float, place: Array, settings: TimingSettings | None = None
) -> ContactTiming:
    """The figures of one high five.

    Args:
        person, avatar: palms (T, 3), m.
        rate_hz: of both.
        contact: s, time of the contact.
        place: (3,) of the contact, m.
        settings: what counts as what.

    Raises:
        HighFiveError: tracks of other shapes, with gaps, or without three frames before the contact.
    """
    settings = settings or TimingSettings()
    if person.shape != avatar.shape or person.ndim != 2 or person.shape[1:] != (3,):
        raise HighFiveError(f"palms of shapes {person.shape} and {avatar.shape}; expected (T, 3) twice")
    if not (np.all(np.isfinite(person)) and np.all(np.isfinite(avatar))):
        raise HighFiveError("a palm's track has gaps; cut it there, or fill them first")
    if not 3.0 <= contact * rate_hz <= len(person) - 1.0:
        raise HighFiveError(
            f"contact at {contact} s of {len(person)} frames at {rate_hz} Hz; expected 3 frames before it"
        )
    reaches = [_reach(track, rate_hz, contact, place, settings) for track in (person, avatar)]
    gap = np.linalg.norm(person - avatar, axis=1)
    last = int(np.floor(contact * rate_hz))
    return ContactTiming(
        *reaches,
        asynchrony=reaches[0].arrival - reaches[1].arrival,
        closing_speed=float((gap[last - 3] - gap[last]) * rate_hz / 3.0),
        miss=_least(person - avatar)[1],
    )


def contact_time(gap: Array, rate_hz: float, settings: TimingSettings | None = None) -> float | None:
    """When palms met, s, from the gap between their surfaces (T,), m; None if they did not.

    Of fast contacts the end of a line through the last frames before it (± 0.4 ms with 0.7 mm of noise at 1.5 m/s and
    120 Hz), of slow ones where the gap crosses nought between two frames (± 2 ms).

    Raises:
        HighFiveError: it has gaps, or is no row of numbers.
    """
    settings = settings or TimingSettings()
    if gap.ndim != 1 or not np.all(np.isfinite(gap)):
        raise HighFiveError(f"gap of shape {gap.shape}; expected (T,) finite numbers")
    closed = np.flatnonzero(gap <= 0.0)
    if not len(closed) or closed[0] == 0:
        return None
    after = int(closed[0])
    crossing = after - 1 + gap[after - 1] / (gap[after - 1] - gap[after])
    before = np.flatnonzero(gap[:after] > settings.apart)[-settings.line :]
    if len(before) == settings.line:
        slope, offset = np.polyfit(before.astype(float), gap[before], 1)
        if -slope * rate_hz >= settings.fast:
            return float(-offset / slope / rate_hz)
    return float(crossing / rate_hz)


def onset_time(speed: Array, rate_hz: float, share: float) -> float:
    """When a speed (T,) last rose above ``share`` of its peak before the peak, s, between frames."""
    peak = int(np.argmax(speed))
    level = share * speed[peak]
    below = np.flatnonzero(speed[:peak] <= level)
    if not len(below):
        return 0.0
    last = int(below[-1])
    rise = speed[last + 1] - speed[last]
    return float((last + (level - speed[last]) / rise) / rate_hz)


def _reach(track: Array, rate_hz: float, contact: float, place: Array, settings: TimingSettings) -> Reach:
    speed, distance = speeds(track, rate_hz), np.linalg.norm(track - place, axis=1)
    last = int(np.floor(contact * rate_hz))
    before = speed[: last + 1]
    onset = onset_time(before, rate_hz, settings.onset)
    peak = int(np.argmax(before))
    found, _ = find_peaks(np.append(before, 0.0), prominence=settings.peak * before[peak])
    there = (distance[:last] < settings.near) & (speed[:last] < settings.still)
    waited = last if there.all() else int(np.argmin(there[::-1]))
    to_contact = contact - onset
    return Reach(
        onset=onset,
        time_to_contact=to_contact,
        waiting=waited / rate_hz,
        arrival=_least(track - place)[0] / rate_hz,
        peak_speed=float(before[peak]),
        peak_at=float((peak / rate_hz - onset) / to_contact) if to_contact > 0.0 else 0.0,
        peaks=max(1, len(found)),
    )


def _least(apart: Array) -> tuple[float, float]:
    """Frame, with its fraction, and size of the least of vectors (T, 3) on the straight lines between them."""
    start, step = apart[:-1], np.diff(apart, axis=0)
    squares = np.einsum("ti,ti->t", step, step)
    along = np.clip(-np.einsum("ti,ti->t", start, step) / np.where(squares > 0.0, squares, 1.0), 0.0, 1.0)
    sizes = np.linalg.norm(start + along[:, None] * step, axis=1)
    best = int(np.argmin(sizes))
    return best + float(along[best]), float(sizes[best])

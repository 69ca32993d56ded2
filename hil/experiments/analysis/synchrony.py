"""Whether two people's speeds go together, and more so than those of people who did not meet.

Every two reaches correlate: both begin slowly, speed up and slow down. What counts is how much more a pair does than
pseudo-pairs of it: the person of one high five with the avatar of another of the same style and cell (Bernieri &
Rosenthal 1991). Speeds are (T,), m/s, at one rate, of one clock, both from the same event on.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class SynchronySettings(Settings):
    """Windows and lags. The window matters more than the lags; smaller ones tell pairs from pseudo-pairs better."""

    window: float = setting(0.5, "s", above=0.0)
    """Length of a window: of 0.5 to 1 s, the smaller."""
    lag: float = setting(0.3, "s", least=0.0)
    """Most that one may be behind the other: a reaction's time."""
    most: int = setting(40, least=1)
    """Pseudo-pairs of a pair; of more, as many evenly spread over them: a share to ± .08 is enough of one trial."""


@dataclass(frozen=True)
class Synchrony:
    """Of one pair.

    Attributes:
        height: the largest mean correlation over the windows, −1 to 1.
        lag: s, at which it is; above 0, the second is behind the first.
    """

    height: float
    lag: float


@dataclass(frozen=True)
class AgainstPseudoPairs:
    """A pair beside its pseudo-pairs.

    Attributes:
        pair: as it was.
        pseudo: mean height of its pseudo-pairs.
        count: of them.
        share_below: of them, lower than the pair (half of the ties): 0.5 is chance.
    """

    pair: Synchrony
    pseudo: float
    count: int
    share_below: float


def synchrony(first: Array, second: Array, rate_hz: float, settings: SynchronySettings | None = None) -> Synchrony:
    """How two speeds go together; of unequal length, as far as both go.

    Raises:
        HighFiveError: gaps, or too few frames for a window and the lags.
    """
    settings = settings or SynchronySettings()
    lags, heights = lag_profile(first, second, rate_hz, settings)
    best = int(np.argmax(heights))
    return Synchrony(float(heights[best]), float(lags[best]))


def lag_profile(
    first: Array, second: Array, rate_hz: float, settings: SynchronySettings | None = None
) -> tuple[Array, Array]:
    """Lags (L,), s, and the mean over windows of the correlation at each (L,), through Fisher's z.

    A window of the first begins at every frame that leaves room for all lags; the same windows count at every lag. A
    window in which somebody stands still says nothing and is left out.

    Raises:
        HighFiveError: gaps, too few frames for a window and the lags, or nobody moves.
    """
    settings = settings or SynchronySettings()
    frames = min(len(first), len(second))
    window, most = round(settings.window * rate_hz), round(settings.lag * rate_hz)
    if window < 3 or frames < window + 2 * most + 1:
        raise HighFiveError(
            f"{frames} frames at {rate_hz:g} Hz; expected {max(window, 3) + 2 * most + 1} or more for a window of "
            f"{settings.window:g} s and lags of {settings.lag:g} s"
        )
    one, other = _standard_windows(first[:frames], window), _standard_windows(second[:frames], window)
    places = np.arange(most, len(one) - most)
    lags = np.arange(-most, most + 1)
    r = np.stack([np.einsum("wt,wt->w", one[places], other[places + lag]) for lag in lags])
    moving = np.all(np.isfinite(r), axis=0)
    if not moving.any():
        raise HighFiveError("one of the two does not move: there is nothing to correlate")
    z = np.arctanh(np.clip(r[:, moving], -0.999999, 0.999999))
    return lags / rate_hz, np.tanh(z.mean(axis=1))


def against_pseudo_pairs(
    firsts: Sequence[Array],
    seconds: Sequence[Array],
    alike: Sequence[Hashable],
    rate_hz: float,
    settings: SynchronySettings | None = None,
) -> list[AgainstPseudoPairs | None]:
    """Each high five's pair beside its pseudo-pairs; None where no other is like it.

    Args:
        firsts, seconds: both speeds of each high five.
        alike: what pseudo-pairs must share, such as (style, cell).
        rate_hz: of all.
        settings: windows and lags.

    Raises:
        HighFiveError: as :func:`lag_profile`.
    """
    found: list[AgainstPseudoPairs | None] = []
    for trial, (one, its) in enumerate(zip(firsts, seconds, strict=True)):
        others = [seconds[t] for t in range(len(seconds)) if t != trial and alike[t] == alike[trial]]
        if not others:
            found.append(None)
            continue
        pair, most = synchrony(one, its, rate_hz, settings), (settings or SynchronySettings()).most
        if len(others) > most:
            others = [others[place] for place in np.linspace(0, len(others) - 1, most).round().astype(int)]
        heights = np.array([synchrony(one, other, rate_hz, settings).height for other in others])
        below = np.mean(heights < pair.height) + 0.5 * np.mean(heights == pair.height)
        found.append(AgainstPseudoPairs(pair, float(heights.mean()), len(others), float(below)))
    return found


def _standard_windows(speed: Array, window: int) -> Array:
    """(W, window): each window less its mean, of unit length; NaN where nothing moves."""
    if not np.all(np.isfinite(speed)):
        raise HighFiveError("a speed has gaps; cut it there, or fill them first")
    windows = sliding_window_view(speed, window)
    centred = windows - windows.mean(axis=1, keepdims=True)
    size = np.linalg.norm(centred, axis=1, keepdims=True)
    return np.divide(centred, size, out=np.full_like(centred, np.nan), where=size > 1e-9)

"""How long each style's actors take to bring the hand back after a high five.

How fast the avatar's hand leaves is learned, as its reach is, as a function of how the *person's* hand leaves. After
contact nothing has to be met, so a style can keep the pace of its own actors. It is taken from the training trials as
the model gives them: the median times at which a tenth, half and nine tenths of the way to rest are done, and the
minimum-jerk movement (Flash & Hogan 1985) that is there nearest to these times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.belief import packed
from highfive.model.online.layer import predict_layer

SHARES = (0.1, 0.5, 0.9)
PASSED = np.array([0.249, 0.5, 0.751])
"""Shares of its duration after which a minimum-jerk movement has done these shares of its way."""
_NEAREST = 0.1  # m, that a hand has to come back at least to say how long that takes
_BACK = 0.35  # of the way: a hand that is left further from where it began was still on its way
_TRIALS = 2  # of an emotion at least


@dataclass(frozen=True)
class ReturnPace:
    """Onset and duration of the way back of K styles.

    Attributes:
        onset: (K,) s after contact.
        duration: (K,) s.
    """

    onset: Array
    duration: Array

    def of(self, style: Array) -> tuple[float, float]:
        """Onset and duration, s, with style weights (K,)."""
        return float(style @ self.onset), float(style @ self.duration)


def return_pace(model: HGPDM) -> ReturnPace | None:
    """The pace of a model's styles; None where too few trials of one show how a hand comes back."""
    times: list[list[Array]] = [[] for _ in model.emotions]
    for number in np.unique(model.trial):
        own = np.flatnonzero(model.trial == number)
        emotion = int(model.emotion[own[0]])
        if (found := _times(*_palm_and_clock(model, own, emotion), model.lag)) is not None:
            times[emotion].append(found)
    if min(map(len, times)) < _TRIALS:
        return None
    onset, duration = np.array([_minimum_jerk(np.median(found, axis=0)) for found in times]).T
    return ReturnPace(onset, duration)


def _minimum_jerk(times: Array) -> tuple[float, float]:
    """Onset, not before contact, and duration, s, of the movement that is nearest to the times at :data:`SHARES`."""
    duration, onset = np.polyfit(PASSED, times, 1)
    if onset < 0.0:
        return 0.0, float(PASSED @ times / (PASSED @ PASSED))
    return float(onset), float(duration)


def _palm_and_clock(model: HGPDM, points: NDArray[np.int64], emotion: int) -> tuple[Array, Array]:
    """The palm (T, 3), m, and contact clock (T,) as the model gives them at training points, in order of time."""
    layer, style = packed(model.avatar, len(model.emotions)), np.eye(len(model.emotions))[emotion]
    means = np.array([predict_layer(layer, model.avatar_latents[point].astype(float), style)[0] for point in points])
    return means[:, model.channels.palm], means[:, model.channels.clock]


def _times(palm: Array, clock: Array, lag: float) -> Array | None:
    """Times, s after contact, at which :data:`SHARES` of the way back are done; None where a trial does not show it."""
    after = np.flatnonzero(clock <= 0.0)
    if len(after) < 2 or after[0] == 0:
        return None
    way = palm[-1] - palm[after[0]]
    length = float(way @ way)
    if length < _NEAREST**2 or np.linalg.norm(palm[-1] - palm[0]) > _BACK * np.sqrt(length):
        return None
    gone = np.maximum.accumulate((palm[after[0] :] - palm[after[0]]) @ way / length)
    return np.interp(SHARES, gone, lag * np.arange(len(gone)))

"""The person's whole arm over the last ticks, and where and when the palms will meet by it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from highfive.model.compiled import compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.arm_features import (
    COORDINATES,
    HISTORY,
    LINEAR,
    SIZE,
    features_of,
    pulled_back,
)
from highfive.model.hgpdm.contact_layer import CHANNELS, ArmContactLayer, pooled
from highfive.model.hgpdm.dataset import KNUCKLES
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.belief import packed, tick_weights
from highfive.model.online.contact_forecast import ContactForecast, contact_forecast
from highfive.model.online.layer import predict_layer

MEASURED = 3e-3
"""m, standard deviation of a point: one that is known so well is as in training, and the layer's noise has that."""


class ArmPoints(NamedTuple):
    """Of the person's arm, beside the hand.

    Attributes:
        points: (3, 3) m, elbow, shoulder and centre of the head in the world.
        covariance: (3, 3, 3) m², of each.
    """

    points: Array
    covariance: Array


def arm_at(trial: Trial, frame: int) -> ArmPoints | None:
    """The arm in a frame of a trial, known as well as in training; None where the trial has none."""
    return None if trial.arm_points is None else ArmPoints(trial.arm_points[frame], np.zeros((3, 3, 3)))


class ArmTrack:
    """The last ticks of an arm. They are a window of a longer array, which moves down it: rows are written once."""

    def __init__(self, layer: ArmContactLayer, rate_hz: float) -> None:
        """At so many ticks per second; compiles what is called later."""
        self._layer, self._contact = layer.layer, packed(layer.layer.posterior)
        self._features = layer.features
        self._ticks = tick_weights(HISTORY, rate_hz)
        self.reset()
        nothing = np.zeros(6), np.zeros(6), ArmPoints(np.zeros((3, 3)), np.zeros((3, 3, 3)))
        self.step(*nothing)
        self.reset()
        self.forecast(np.zeros((self._ticks.shape[1], 2, COORDINATES)), (np.zeros(CHANNELS), np.eye(CHANNELS)))

    def reset(self) -> None:
        """Nobody is there yet: whoever comes first has stood still before."""
        self._rows, self._first, self._started, self._away = np.empty((0, 2, COORDINATES)), 0, False, 0

    def step(self, hand: Array | None, variance: Array, arm: ArmPoints | None) -> Array | None:
        """One tick: the arm's last ticks (L, 2, 15), m, and variances, m², newest first, for :meth:`forecast`.

        None while a point is hidden, and for as long after as the history reaches back to where one was.

        Args:
            hand: (6,) m, wrist and knuckles; None where it is hidden.
            variance: (6,) m², of it.
            arm: the rest; None where it is not known.
        """
        if hand is None or arm is None:
            self.hide()
            return None
        count = self._ticks.shape[1]
        if self._first == 0:
            rows = np.empty((_WINDOWS * count, 2, COORDINATES))
            self._first = len(rows) - count
            rows[self._first :] = self._rows[:count] if self._started else 0.0
            self._rows = rows
        self._first -= 1
        _write(self._rows[self._first], hand, variance, arm.points, arm.covariance)
        if not self._started:
            self._rows[self._first + 1 :] = self._rows[self._first]
        self._started, self._away = True, max(self._away - 1, 0)
        return self._rows[self._first : self._first + count] if self._away == 0 else None

    def hide(self) -> None:
        """A point is hidden in this tick."""
        if self._started:
            self._away = self._ticks.shape[1]

    def forecast(self, arms: Array, hand: tuple[Array, Array]) -> ContactForecast:
        """Where and when the palms will meet, by the last ticks (L, 2, 15) of an arm, and what the hand's layer says.

        ``hand`` is way and time left by that, (4,) and (4, 4).
        """
        features = self._features
        by_arm = _forecast(LINEAR, features.centre, features.factor, self._ticks, self._contact, arms)
        left, covariance = (pooled(one, other) for one, other in zip(by_arm, hand, strict=True))
        return contact_forecast(arms[0, 0, KNUCKLES], left, covariance, self._layer)


_WINDOWS = 8
"""Of ticks, that an array holds: it is made anew when they are used up."""


@compiled_entry
def _write(row: Array, hand: Array, variance: Array, points: Array, covariance: Array) -> None:
    """A tick (2, 15): places, and the variances beyond what they had in training."""
    for p in range(6):
        row[0, p], row[1, p] = hand[p], max(variance[p] - MEASURED**2, 0.0)
    for n in range(3):
        for i in range(3):
            row[0, 6 + 3 * n + i] = points[n, i]
            row[1, 6 + 3 * n + i] = max(covariance[n, i, i] - MEASURED**2, 0.0)


@compiled_entry
def _forecast(
    linear: Array, centre: Array, factor: Array, ticks: Array, contact: Array, arms: Array
) -> tuple[Array, Array]:
    """Way and time left: mean (4,) and covariance (4, 4)."""
    arm, doubts = np.zeros(len(ticks) * COORDINATES), np.zeros(len(ticks) * COORDINATES)
    for time in range(len(ticks)):
        for tick in range(len(arms)):
            weight = ticks[time, tick]
            if weight != 0.0:
                for p in range(COORDINATES):
                    arm[time * COORDINATES + p] += weight * arms[tick, 0, p]
                    doubts[time * COORDINATES + p] += weight * arms[tick, 1, p]
    value = np.empty(SIZE)
    vectors = features_of(linear, arm, value)
    for f in range(SIZE):
        value[f] = (value[f] - centre[f]) * factor[f]
    mean, slope, variances = predict_layer(contact, value, np.ones(1))
    for d in range(len(slope)):
        for f in range(SIZE):
            slope[d, f] *= factor[f]
    by_arm = pulled_back(linear, vectors, slope)
    covariance = np.zeros((len(mean), len(mean)))
    for i in range(len(mean)):
        covariance[i, i] = variances[i]
        for j in range(len(mean)):
            for p in range(len(doubts)):
                covariance[i, j] += by_arm[i, p] * doubts[p] * by_arm[j, p]
    return mean, covariance

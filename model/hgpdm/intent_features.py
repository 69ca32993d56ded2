"""What tells whether a contact is coming: where the hand is, where it points, and how it went there.

Features of the last :data:`HISTORY` of wrist and knuckles. Beside places and velocities they have lengths, which no
direction changes, as :mod:`highfive.model.hgpdm.arm_features` has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.dataset import HAND_DIMS
from highfive.model.hgpdm.features import scales

HISTORY = (0.05, 0.1, 0.2, 0.4)
"""s before now."""
_SPEEDS = len(HISTORY)
_VECTORS = 3 + _SPEEDS  # knuckles, hand now, hand 0.2 s ago, velocity in each span
SIZE = 3 * _VECTORS + _SPEEDS
"""F, of the features."""
STILL = 0.01
"""m, and m/s: what varies less counts as if it varied so much."""


@dataclass(frozen=True)
class IntentFeatures:
    """How the features are scaled: ``(raw − centre) · factor``.

    Attributes:
        centre, factor: (F,).
    """

    centre: Array
    factor: Array

    def __call__(self, hands: Array) -> Array:
        """Features (N, F) of hands (N, H + 1, 6), m: now, and at each of :data:`HISTORY` before."""
        return (raw_features(hands) - self.centre) * self.factor


def fit_intent_features(hands: Array) -> IntentFeatures:
    """Scales vectors and lengths of hands (N, H + 1, 6) by one factor each, which keeps the vectors' directions."""
    return IntentFeatures(*scales(raw_features(hands), _VECTORS, STILL))


def raw_features(hands: Array) -> Array:
    """Features (N, F), not scaled, of hands (N, H + 1, 6), m."""
    return _raw(LINEAR, np.ascontiguousarray(hands.reshape(len(hands), -1)))


def _linear() -> Array:
    """(3 V, 6 (H + 1)): the vectors of one hand."""
    times = len(HISTORY) + 1
    wrist, knuckles = np.eye(2 * times).reshape(times, 2, -1).transpose(1, 0, 2)
    ago = np.array([0.0, *HISTORY])
    rows = [knuckles[0], knuckles[0] - wrist[0], knuckles[3] - wrist[3]]
    rows += [(knuckles[n] - knuckles[n + 1]) / (ago[n + 1] - ago[n]) for n in range(_SPEEDS)]
    return np.kron(np.array(rows), np.eye(3)).astype(float)


LINEAR = _linear()


@compiled
def intent_features_of(linear: Array, hand: Array, value: Array) -> None:
    """Puts the features of one hand (6 (H + 1),) into ``value`` (F,), not scaled."""
    rows = len(linear)
    for row in range(rows):
        total = 0.0
        for column in range(len(hand)):
            total += linear[row, column] * hand[column]
        value[row] = total
    for number in range(len(value) - rows):
        total = 0.0
        for i in range(3):
            part = value[rows - 3 * (len(value) - rows) + 3 * number + i]
            total += part * part
        value[rows + number] = np.sqrt(total)


@compiled_entry
def _raw(linear: Array, hands: Array) -> Array:
    result = np.empty((len(hands), SIZE))
    for number in range(len(hands)):
        intent_features_of(linear, hands[number], result[number])
    return result


assert LINEAR.shape[1] == HAND_DIMS * (len(HISTORY) + 1)

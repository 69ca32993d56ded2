"""Whether a contact is coming, from the hand's last ticks."""

from __future__ import annotations

import numpy as np

from highfive.model.compiled import compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.dataset import HAND_DIMS
from highfive.model.hgpdm.intent_features import HISTORY, LINEAR, SIZE, intent_features_of
from highfive.model.hgpdm.intent_layer import IntentLayer, squashed
from highfive.model.online.belief import packed, tick_weights
from highfive.model.online.layer import predict_layer
from highfive.model.online.tick import history_of


class Intent:
    """The layer at a tick rate, ready to answer; it holds no state."""

    def __init__(self, layer: IntentLayer, rate_hz: float, ticks: int) -> None:
        """For the hand's last ``ticks`` at so many a second; compiles."""
        weights = tick_weights(HISTORY, rate_hz)
        self._ticks = np.zeros((len(HISTORY) + 1, ticks))
        self._ticks[:, : weights.shape[1]] = weights
        self._centre, self._factor = np.array(layer.features.centre), np.array(layer.features.factor)
        self._layer, self._squash = packed(layer.posterior), np.array(layer.squash)
        self.probability(np.zeros((ticks, 2, HAND_DIMS)))

    def probability(self, hands: Array) -> float:
        """Of the hand's last ticks (L, 2, 6), m, as a belief holds them."""
        return _probability(LINEAR, self._centre, self._factor, self._ticks, self._layer, self._squash, hands)


@compiled_entry
def _probability(
    linear: Array, centre: Array, factor: Array, ticks: Array, layer: Array, squash: Array, hands: Array
) -> float:
    value = np.empty(SIZE)
    intent_features_of(linear, history_of(ticks, hands, 0), value)
    for f in range(SIZE):
        value[f] = (value[f] - centre[f]) * factor[f]
    mean, _, variances = predict_layer(layer, value, np.ones(1), False)
    return squashed(mean[0], variances[0], squash[0], squash[1])

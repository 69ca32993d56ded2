"""Whether a contact is coming: a raised hand that scratches a head is no high five.

A sparse GP from the hand and its history to labels, 1 for an approach and −1 for anything else, squashed to a
probability (least-squares classification, Rasmussen & Williams 2006, section 6.5):

    p = Φ((slope · mean + bias) / √(1 + slope² · variance)),

its slope and bias by what was said of trials and gestures that were left out of its weights (Platt 2000). Far from all
that was learned the variance grows, and the probability goes to where nothing is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.intent_features import IntentFeatures

PRIOR = 0.5
"""Share of approaches among what raises a hand, as the layer is calibrated: classes count alike in training."""


@dataclass(frozen=True)
class IntentLayer:
    """The trained layer.

    Attributes:
        features: of the hand and its history.
        posterior: from these to a label, (1,).
        squash: (2,) slope and bias of the probit.
    """

    features: IntentFeatures
    posterior: Posterior
    squash: Array


@compiled
def squashed(mean: float, variance: float, slope: float, bias: float) -> float:
    """The probability that belongs to a label's mean and variance."""
    z = (slope * mean + bias) / math.sqrt(1.0 + slope * slope * variance)
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


@compiled_entry
def probabilities(means: Array, variances: Array, squash: Array) -> Array:
    """(N,) of labels' means and variances (N,)."""
    result = np.empty(len(means))
    for n in range(len(means)):
        result[n] = squashed(means[n], variances[n], squash[0], squash[1])
    return result

"""The palm in task space: where the contact layer says the palms will meet, carried by the pose.

A regression of joint angles bends back to the places that it learned, the hierarchy and its neighbours alike, where the
contact layer goes on linearly: in cells left out it knows the contact to 1.4 cm when the palms are near, and the pose
is 11 cm off. So the palm is led to

    palm + s₁(t) (contact layer's point − pool's point) + s₂(t) (contact layer's point − palm),

with the pool's palm and point as it generates them beside the joints, t the time left, and s learned from trials that
were left out; and the joints are what they most likely are with the palm there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.model.geometry.arm_chain import ArmChain
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.dataset import Channels

KNOTS = np.array([-0.4, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.45, 0.65, 0.85])  # s left, of the functions s₁ and s₂
BEGIN, END = 0.85, -0.4  # s left; outside the contact layer knows nothing
APART = 0.3  # s; where the pool's clock and the contact layer's time are so far apart, nobody comes


@dataclass(frozen=True)
class TaskSpace:
    """How the palm is led.

    Attributes:
        chain: the joints that carry the palm.
        covariance: (3 + 3 n, 3 + 3 n) of root, m, and the chain's rotation vectors, rad, about what the pool says.
        slopes: (2, KNOTS) s₁ and s₂.
    """

    chain: ArmChain
    covariance: Array
    slopes: Array


def led_channels(chain: ArmChain, where: Channels) -> NDArray[np.int64]:
    """Indices (3 + 3 n,) of root and rotation vectors that carry the palm, among the avatar's channels."""
    turns: NDArray[np.int64] = (3 * chain.joints[:, None] + np.arange(3)).reshape(-1)
    root: NDArray[np.int64] = where.root.start + np.arange(3)
    return np.concatenate([root, turns])


def time_weights(time: Array) -> Array:
    """Weights (N, KNOTS) that interpolate linearly at times (N,), s."""
    at = np.clip(time, KNOTS[0], KNOTS[-1])
    low = np.clip(np.searchsorted(KNOTS, at) - 1, 0, len(KNOTS) - 2)
    share = (at - KNOTS[low]) / (KNOTS[low + 1] - KNOTS[low])
    weights = np.zeros((len(at), len(KNOTS)))
    rows = np.arange(len(at))
    weights[rows, low], weights[rows, low + 1] = 1.0 - share, share
    return weights

"""Direct answers beside the hierarchy: what is pooled with its pose.

The hierarchy answers through latents of few dimensions. A plain regression from the same features errs elsewhere, and
so do the nearest training points: a linear pool of the three (Clemen 1989, "Combining forecasts") errs less than each.
On the way to contact the hierarchy blurs where hands were raised, and neighbours do not. Where people walk, elbow,
shoulder and head tell more of the partner's pose than the hand does: a fourth answer comes from the whole arm, where
trials that were left out say that it is worth it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from highfive.model.geometry.rotations import Array
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.arm_features import ArmFeatures

HIERARCHY, REGRESSION, NEIGHBOURS = 0.4, 0.3, 0.3
"""Shares in the pool. Equal ones are hard to beat by learned ones; 0.34 each, or half for the hierarchy, are the same
within 2 % (simulated pairs that stand, and that walk)."""
NEAREST = 16  # training points of a style; 8 to 24 are the same within 3 %


@dataclass(frozen=True)
class Neighbours:
    """The training points, for locally weighted averages.

    Attributes:
        features: (N, F), ordered by style.
        first: (K + 1,) where each style's points begin, and N.
        scores: (N, R) coordinates of the channels, scaled, in ``basis``.
        basis: (R, channels) with their scale.
        offset: (channels,).
        usual: () distance of the :data:`NEAREST`-th point, as far as it was in 99 % of trials that were left out.
    """

    features: Float[NDArray[Any], "N F"]
    first: NDArray[np.int64]
    scores: Float[NDArray[Any], "N R"]
    basis: Array
    offset: Array
    usual: Array


@dataclass(frozen=True)
class ArmAnswer:
    """What the whole arm says of the pose.

    Attributes:
        features: of the arm.
        regression: sparse GP from these to the channels, with styles.
        share: () in the pool; the others have the rest, as among themselves.
    """

    features: ArmFeatures
    regression: Posterior
    share: Array


@dataclass(frozen=True)
class PoseEnsemble:
    """What answers beside the hierarchy, from the features of the back projection and the style.

    Attributes:
        regression: sparse GP to the channels, with styles.
        neighbours: of the training points.
        spread: (channels,) factors of the hierarchy's standard deviations that make them the pool's, without the arm.
        arm: what the whole arm says, while it is known; None where that is not worth it, or was not learned.
    """

    regression: Posterior
    neighbours: Neighbours
    spread: Array
    arm: ArmAnswer | None = None

"""Looking ahead: where and when the palms will meet, and how far to trust that.

The contact layer is a sparse GP beside the hierarchy, from what the back projection sees of the hand to the way and
the time that are left. It knows the approach alone, and no style: the person is the same whatever style the avatar
has. Rolling the latent dynamics ahead was the alternative; it forecasts less well, since X¹ keeps only as much of
where in the room the palms will meet as the pose needs (36 held-out simulated trials, 0.2 s before contact, median:
2.0 cm against 3.3 to 3.4).

Where elbow, shoulder and head are known, another such layer sees them, too, and further back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.model.geometry.rotations import Array
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.arm_features import ArmFeatures

CHANNELS = 4  # way (3) and time (1)
BEGIN, END = 0.9, -0.3  # s before contact, of the frames that the layer learns from; past contact it should know
REGION = 0.9  # share of contacts that the calibrated regions hold
ARM_SHARE = 2.0 / 3.0  # of the arm's layer in a pooled forecast; by the training trials, see fit_contact_layers
KNOTS = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8])  # s of forecast time at which it is calibrated


@dataclass(frozen=True)
class ContactLayer:
    """The trained layer.

    Attributes:
        posterior: from the features to the way (3, m) from the knuckles to the contact point, and the time (1, s).
        scales: (KNOTS, 2) factors of the variances of way and time at the forecast times ``KNOTS``.
    """

    posterior: Posterior
    scales: Array

    def calibrated(self, time: float, covariance: Array) -> Array:
        """Covariance (4, 4) of a forecast of that time, as cross-validation says it must be."""
        way, clock = (np.sqrt(np.interp(time, KNOTS, self.scales[:, column])) for column in (0, 1))
        factors = np.array([way, way, way, clock])
        return covariance * factors * factors[:, None]


@dataclass(frozen=True)
class ArmContactLayer:
    """The same from the whole arm, elbow, shoulder and head beside the hand: for as long as all of them are seen.

    What it says is pooled with what the hand's layer says, the arm's with :data:`ARM_SHARE`: they err apart, and slow
    hands are known better by the second.

    Attributes:
        features: of the arm and its history.
        layer: from these to way and time; its factors are those of the pooled forecast.
    """

    features: ArmFeatures
    layer: ContactLayer


def pooled(arm: Array, hand: Array, share: float = ARM_SHARE) -> Array:
    """A linear pool of what both layers say, means, errors or covariances (…, 4); ``share`` is the arm's."""
    return share * arm + (1.0 - share) * hand

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

from highfive.model.compiled import compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.arm_features import ArmFeatures

CHANNELS = 4  # way (3) and time (1)
BEGIN, END = 0.9, -0.3  # s before contact, of the frames that the layer learns from; past contact it should know
REGION = 0.9  # share of contacts that the calibrated regions hold
ARM_SHARE = 2.0 / 3.0  # of the arm's layer in a pooled forecast, where no trials were left out to tell it
KNOTS = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8])  # s of forecast time at which it is calibrated
SPEEDS = np.array([0.1, 0.35, 1.2])  # m/s of the knuckles at which it is, too
SPEED_SPAN = 0.1  # s over which that speed is measured


@dataclass(frozen=True)
class ContactLayer:
    """The trained layer.

    Attributes:
        posterior: from the features to the way (3, m) from the knuckles to the contact point, and the time (1, s).
        calibration: (KNOTS, SPEEDS, 3), by how much later contact comes than forecast, s, in the median, and factors of
            the variances of way and time, at the forecast times ``KNOTS`` and the speeds ``SPEEDS``.
    """

    posterior: Posterior
    calibration: Array

    def calibrated(self, time: float, speed: float, covariance: Array) -> tuple[float, Array]:
        """Time, s, and covariance (4, 4) of a forecast of ``time``, s, for knuckles of ``speed``, m/s, as
        cross-validation says that they must be: a slow hand is soon taken for one that has arrived, and where a quick
        one ends is known less well than its time."""
        late, way, clock = _between(self.calibration, KNOTS, SPEEDS, time, speed)
        factors = np.sqrt([way, way, way, clock])
        return time + float(late), covariance * factors * factors[:, None]


@compiled_entry
def _between(table: Array, knots: Array, speeds: Array, time: float, speed: float) -> Array:
    """What a ``table`` (KNOTS, SPEEDS, C) of ``knots``, s, and ``speeds``, m/s, has (C,) between them: linear in time
    and in the logarithm of the speed, beyond them that of the last."""
    row, down = 0, 0.0
    for i in range(1, len(knots)):
        if time > knots[i - 1]:
            row, down = i - 1, min((time - knots[i - 1]) / (knots[i] - knots[i - 1]), 1.0)
    column, right = 0, 0.0
    for i in range(1, len(speeds)):
        if speed > speeds[i - 1]:
            column, right = i - 1, min(np.log(speed / speeds[i - 1]) / np.log(speeds[i] / speeds[i - 1]), 1.0)
    upper = (1.0 - right) * table[row, column] + right * table[row, column + 1]
    lower = (1.0 - right) * table[row + 1, column] + right * table[row + 1, column + 1]
    return (1.0 - down) * upper + down * lower


@dataclass(frozen=True)
class ArmContactLayer:
    """The same from the whole arm, elbow, shoulder and head beside the hand: for as long as all of them are seen.

    What it says is pooled with what the hand's layer says: they err apart, and slow hands are known better by the
    second.

    Attributes:
        features: of the arm and its history.
        layer: from these to way and time; its calibration is that of the pooled forecast.
        share: of this layer in it; the more trials there are to learn from, the larger.
    """

    features: ArmFeatures
    layer: ContactLayer
    share: float = ARM_SHARE


def pooled(arm: Array, hand: Array, share: float) -> Array:
    """A linear pool of what both layers say, means, errors or covariances (…, 4); ``share`` is the arm's."""
    return share * arm + (1.0 - share) * hand

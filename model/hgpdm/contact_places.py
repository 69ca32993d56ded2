"""Where reaches go: the places where palms met, as a mixture of hypotheses.

Before a hand is raised nothing says which of them it will be, and the mean of all is none of them. The forecast of the
contact layer weighs them as the hand rises (:attr:`highfive.model.online.responder.Response.hypotheses`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from highfive.model.gp.mixture import GaussianMixture, fitted
from highfive.model.hgpdm.trials import Trial

MOST = 16
"""Places at most; and one for so many different contacts at most:"""
CONTACTS = 3
STARTS = 5
"""Of expectation–maximisation, for each number: from one, places that are far apart are taken for one."""
FLOOR = 0.01
"""m, added to the deviation in each direction."""


def contact_places(trials: Sequence[Trial], seed: int = 0) -> GaussianMixture:
    """The places, m, of the trials' contacts. They have one covariance: 108 simulated ones, at nine places, are then
    nine hypotheses; with a covariance each, BIC takes those above one another for one."""
    points = np.array([trial.palm[trial.contact_frame] for trial in trials])
    most = max(1, min(MOST, len(np.unique(points, axis=0)) // CONTACTS))
    return fitted(points, range(1, most + 1), seed, FLOOR**2, STARTS, tied=True)

"""What the tracker's filter is tuned by: noise, gates and times, each with its unit and reason."""

from __future__ import annotations

import numpy as np

MARKER_SIGMA = 0.0012
"""Standard deviation of a measured marker, m."""


PULL_S = 2.0
"""Time in which the expected pose weighs as much as one look at it, s."""


SLIP = 0.001
"""How far a marker wanders on its segment, m per √s: skin moves."""


FADING_S = 0.15
"""Time in which what a hidden marker was last seen beside its place falls to a third, s."""


SLIDE = 0.012
"""Most that a marker moves on its segment, or otherwise than before, from one frame to the next, m."""


FIRST_STEP = 0.04
"""Most that a marker moves in the frame after it was seen again, m: 5 m/s."""


RETURN_NS = 40_000_000
"""A marker that was not seen for so long brings back a part of the body whose speed is not known any more."""


RETURN_SPEED = 6.0
"""How fast that part may be, rad/s."""


UNSURE = 0.1
"""A freedom counts as out of sight from this standard deviation on, rad."""


MISFIT_S = 0.5
"""Time over which the misfit between markers and chain is averaged, s."""


LARGEST_MISFIT = 0.02
"""Most that a marker's misfit may count, m."""


GATE = 25.0
"""Squared Mahalanobis distance, three degrees of freedom, beyond which a point is not believed (15 in a million)."""


TAKE_UP_GATE = 11.3
"""The same within which a point without a label may be taken for a marker (1 in 100 missed)."""


GHOSTS = 20.0
"""Points without a label that belong to nothing, in a m³ about the body."""


TAKEN = 0.02
"""How probable it is that a hidden marker has a point without a label, over the odds that are asked for to take it."""


CAUTION = 0.1
"""Share of what was not known of a marker that is added to its variance in the frame in which it is seen again.

A wrong point may come under a right label; it must not shut out the right one in the next frame.
"""


REACH = 0.10
"""Most that a point without a label may be away from the marker that it is taken for, m."""


DRIFT = 0.15
"""How much further off a marker may reappear than its covariance says, m per second hidden: no model is right."""


USABLE_SIGMA = 0.06
"""An estimate is valid up to this standard deviation a coordinate, m."""


RESET_NS = 250_000_000
"""A marker that was not believed for so long is believed: it has slipped on its segment."""


SLIPPED = 0.15
"""Further off than this, m, from where the set has it, it is no marker of this segment."""


LOST_SHARE = 0.6
"""More than this share of the visible markers not believed, and the frame counts as astray."""


NEVER = np.iinfo(np.int64).max


ROUNDS = 3  # linearisations of one update at most


SMALL = 2e-3  # rad or m: after a step below it, the next one would be a thousandth of that

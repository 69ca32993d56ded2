"""What the tracker's filter is tuned by: noise, gates and times, each with its unit and reason."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.model.settings import Settings, named_tuple, setting

NEVER = np.iinfo(np.int64).max
"""Age, ns, of a marker that was never seen."""

ALIKE = np.zeros((0, 3, 3))
"""The noise (M, 3, 3) of a frame whose markers are all measured with :attr:`FilterSettings.marker_sigma`: no rows."""


@dataclass(frozen=True)
class FilterSettings(Settings):
    """Chosen on simulated motion and a part of a real recording (CMU 85, 12), gates and iterations aside."""

    marker_sigma: float = setting(0.0012, "m", above=0.0)
    """Standard deviation of a measured marker, where a frame does not say what its own are."""
    passing: float = setting(10.0, "m", above=0.0)
    """Of the standard deviation that a frame states of a marker, in any direction, at most so much passes from frame to
    frame. The rest lasts: no average takes it out, so that it has no part in the filter, and is stated on top."""
    pull_s: float = setting(2.0, "s", above=0.0)
    """Time in which the expected pose weighs as much as one look at it."""
    slip: float = setting(0.001, "m/√s", above=0.0)
    """How far a marker wanders on its segment: skin moves."""
    fading_s: float = setting(0.15, "s", above=0.0)
    """Time in which what a hidden marker was last seen beside its place falls to a third."""
    slide: float = setting(0.012, "m", above=0.0)
    """Most that a marker moves on its segment, or otherwise than before, from one frame to the next."""
    first_step: float = setting(0.04, "m", above=0.0)
    """Most that a marker moves in the frame after it was seen again: 5 m/s."""
    return_ns: int = setting(40_000_000, "ns", least=0)
    """A marker that was not seen for so long brings back a part of the body whose speed is not known any more."""
    return_speed: float = setting(6.0, "rad/s", above=0.0)
    """How fast that part may be."""
    unsure: float = setting(0.1, "rad", above=0.0)
    """A freedom counts as out of sight from this standard deviation on."""
    misfit_s: float = setting(0.5, "s", above=0.0)
    """Time over which the misfit between markers and chain is averaged."""
    largest_misfit: float = setting(0.02, "m", above=0.0)
    """Most that a marker's misfit may count."""
    gate: float = setting(25.0, above=0.0)
    """Squared Mahalanobis distance, three degrees of freedom, beyond which no point is believed: χ², 15 in a
    million of the right ones."""
    take_up_gate: float = setting(11.3, above=0.0)
    """The same within which a point without a label may be taken for a marker: χ², 1 in 100 missed."""
    ghosts: float = setting(20.0, "1/m³", above=0.0)
    """Points without a label that belong to nothing, about the body."""
    taken: float = setting(0.02, above=0.0)
    """How probable it is that a hidden marker has a point without a label, over the odds required to take it."""
    caution: float = setting(0.1, least=0.0)
    """Share of what was not known of a marker that is added to its variance in the frame in which it is seen again.

    A wrong point may come under a right label; it must not shut out the right one in the next frame.
    """
    reach: float = setting(0.10, "m", above=0.0)
    """Most that a point without a label may be away from the marker that it is taken for."""
    coasting: float = setting(1.0, above=0.0)
    """How long speeds are kept where nothing is seen, over how long they are for hidden markers. A source that is late
    is predicted for long all the time, and hands brake as they come near."""
    drift: float = setting(0.15, "m/s", least=0.0)
    """How much further off a marker may reappear than its covariance says, per second hidden: no model is right."""
    usable_sigma: float = setting(0.06, "m", above=0.0)
    """An estimate is valid up to this standard deviation per coordinate."""
    reset_ns: int = setting(250_000_000, "ns", least=0)
    """A marker that was not believed for so long is believed: it has slipped on its segment."""
    slipped: float = setting(0.15, "m", above=0.0)
    """Further off than this from where the set has it, it is no marker of this segment."""
    lost_share: float = setting(0.6, above=0.0, most=1.0)
    """More than this share of the visible markers not believed, and the frame counts as astray."""
    rounds: int = setting(3, least=1)
    """Linearisations of one update at most: they bound the cost of a frame."""
    small: float = setting(2e-3, "rad or m", above=0.0)
    """After a step below it no more is linearised: the next one would be a thousandth of that."""


HEADSET = FilterSettings(usable_sigma=0.3, coasting=0.8)
"""For the joints that a headset tells of. Chosen on simulated high fives of seed 7 (``highfive bench headset``)."""
WEBCAM = FilterSettings(usable_sigma=0.25, largest_misfit=0.05, passing=0.05)
"""For joint centres by a webcam, good across its view and bad along it (``highfive bench webcam``)."""

FilterSettingsValues = named_tuple(FilterSettings)

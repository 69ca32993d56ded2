"""When and how the avatar's palm is led to the person's: what may be set of :mod:`highfive.hil.session.reach`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class ReachSettings(Settings):
    """When and how the avatar's palm is led to the person's.

    Chosen on simulated high fives of seed 0 and one real one (CMU 20/21, 11), ``braking`` aside.
    """

    fade_in: float = setting(0.6, "s", above=0.0)
    """The correction starts this long before contact, later if contact is seen later."""
    shortest_fade_in: float = setting(0.25, "s", above=0.0)
    longest: float = setting(1.0, "s", least=0.0)
    """An approach that has taken so long, of a hand that hangs again, has missed it."""
    touch: float = setting(0.06, "s", least=0.0)
    """How long the palms stay together."""
    fade_out: float = setting(0.5, "s", above=0.0)
    landing: float = setting(0.06, "s", above=0.0)
    """Over this last stretch the closing speed runs out, as flesh would take it up."""
    touching: float = setting(0.002, "m", least=0.0)
    """Palms this near touch; they lie on each other a little later."""
    sure: float = setting(0.35, "s", least=0.0)
    """A clock with a larger standard deviation than this is not read."""
    near: float = setting(0.08, "m", least=0.0)
    """Palms this close meet, where the clock cannot be read."""
    horizon: float = setting(0.35, "s", least=0.0)
    """Closer than this, where the clock cannot be read, the time to the nearest approach at constant speed counts."""
    soon: float = setting(3.0, "s", least=0.0)
    """A palm that would take longer than this to be here at its present speed is not on its way."""
    slowest: float = setting(0.1, least=0.0)
    fastest: float = setting(2.0, least=0.0)
    """Bounds of the rate at which the remaining time runs out, against the clock."""
    catching_up: float = setting(0.08, "s", above=0.0)
    """A difference between both clocks is made up for in about this time."""
    smoothing: float = setting(0.03, "s", above=0.0)
    """Time constant of the relative velocity and of the rate."""
    steady: float = setting(26.0, "rad/s", above=0.0)
    """Bandwidth of the miss, ..."""
    homing: float = setting(0.2, "s", above=0.0)
    """... which opens over this last stretch, so that the palms meet."""
    easing: float = setting(0.05, "s", above=0.0)
    """Time constant with which the difference runs out between where a hidden hand was left and where it comes back."""
    bend: float = setting(0.12, "m", above=0.0)
    """A larger miss than this is not believed in full before the palms are about to meet."""
    raised: float = setting(1.05, "m", least=0.0)
    """An unfamiliar hand above this height is held out to be met; no hand below is, ..."""
    rising: float = setting(0.1, "m/s", least=0.0)
    """... unless it comes up at this speed, ..."""
    arm: float = setting(1.15, "m", least=0.0)
    """... and an unfamiliar one only if it comes this near the avatar's shoulder."""
    closing: float = setting(0.16, "m/s", least=0.0)
    """Palms close in at this speed at least, as slow people's do, of 0, 0.1, 0.16 and 0.25 tried on sad hands of seeds
    303 and 404: below, the time of their touch spreads, ..."""
    held: float = setting(0.08, "s", above=0.0)
    """... for about so long: the palm waits by as much before a hand that creeps up, or meets it on the way."""
    braking: float = setting(3.0, "m/s²", least=0.0)
    """A hand brakes otherwise than assumed by about this much in each direction: 36 held-out simulated trials."""
    quickest: float = setting(100.0, "m/s", above=0.0)
    """A hand that moves faster is not touched yet: the palm waits for it (no hand is, of this), ..."""
    waiting: float = setting(0.2, "s", least=0.0)
    """... as if contact were this far away. For sources that see a hand too late to say where it is on its way."""
    late: float = setting(0.3, "s", least=0.0)
    """A clock that says contact was up to this long ago means now; beyond, it is past."""

    def target_rate(self, remaining: float, expected: float) -> float:
        """The rate at which ``remaining`` s should run out where ``expected`` s are left, infinite if nobody knows."""
        if not math.isfinite(expected):
            return 1.0
        return min(max(1.0 + (remaining - expected) / self.catching_up, self.slowest), self.fastest)

    def next_rate(self, rate: float, target: float, dt: float) -> float:
        """The rate ``dt`` s later."""
        return rate + (1.0 - math.exp(-dt / self.smoothing)) * (target - rate)


SEEN_LATE = ReachSettings(quickest=0.3)
"""For who is seen with a delay of some 0.1 s at 15 pictures a second. Chosen on 18 high fives
(``hil/bench/webcam_choice.npz``)."""

"""What happens in a high five, named as it happens."""

from __future__ import annotations

import numpy as np

from highfive.hil.session.reach import Phase
from highfive.hil.session.session import Tick
from highfive.hil.sim.playout import PlayState

TOUCHING, PARTED = 0.015, 0.05
"""m between the middles of the palms: nearer they touch, and from then on until they are further they are together."""


class PalmsTogether:
    """Whether the palms are together, tick by tick."""

    def __init__(self) -> None:
        """Apart."""
        self.together = False

    def __call__(self, distance: float) -> bool:
        """Have they come together with this tick? ``distance`` is from palm to palm, m."""
        before, self.together = self.together, distance < (PARTED if self.together else TOUCHING)
        return self.together and not before


class TrialEvents:
    """``hand_raised``, ``contact`` and ``released`` of one high five, each at most once."""

    def __init__(self) -> None:
        """Nothing has happened."""
        self._palms = PalmsTogether()
        self._happened: set[str] = set()

    def __call__(self, tick: Tick, state: PlayState) -> list[str]:
        """What happened in a tick, in order."""
        came = self._palms(float(np.linalg.norm(state.palm.position - state.person_palm.position)))
        now = {
            "hand_raised": tick.target.phase is not Phase.IDLE,
            "contact": came,
            "released": not self._palms.together and "contact" in self._happened,
        }
        found = [event for event, happens in now.items() if happens and event not in self._happened]
        self._happened.update(found)
        return found

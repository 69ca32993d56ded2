"""Whether a contact is coming at all, as the model's probability says from tick to tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class DoubtSettings(Settings):
    """When a raised hand is met. Chosen on simulated gestures and high fives of seeds 12 and 31."""

    likely: float = setting(0.85, least=0.0, most=1.0)
    """A reach begins only if a contact has been coming with at least this probability ..."""
    certain: float = setting(0.03, "s", least=0.0)
    """... for so long, ..."""
    stranger: float = setting(0.4, least=0.0, most=1.0)
    """... or this, of a hand that does what no hand did in training: of it the model can say less; ..."""
    unlikely: float = setting(0.2, least=0.0, most=1.0)
    """... with less than this it goes back while it has not gone half of its way, and no pose answers the hand."""

    def enough(self, familiar: bool) -> float:
        """The probability with which a reach begins."""
        return self.likely if familiar else self.stranger


DOUBT = DoubtSettings()


class Doubt:
    """What is doubted of a hand. A model that does not say leaves no doubt.

    Attributes:
        unlikely: no contact is coming.
        met: the hand was met, and has not hung still since: its way back is part of a high five.
    """

    def __init__(self, settings: DoubtSettings = DOUBT) -> None:
        """Nobody is there yet."""
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Another person."""
        self.unlikely, self.met, self._likely_s = False, False, 0.0

    def weigh(self, probability: float | None, familiar: bool, dt: float) -> None:
        """Takes in a tick of ``dt`` s; ``familiar``: the hand does what hands did in training."""
        if probability is None:
            self.unlikely, self._likely_s = False, math.inf
            return
        self.unlikely = probability < self._settings.unlikely
        self._likely_s = self._likely_s + dt if probability >= self._settings.enough(familiar) else 0.0

    @property
    def likely(self) -> bool:
        """A contact is coming, and has been for long enough."""
        return self._likely_s >= self._settings.certain - 1e-9

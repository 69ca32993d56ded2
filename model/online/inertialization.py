"""A pose that stays smooth where what it follows jumps: the difference runs out along a quintic (Bollo 2018)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

PEAK = 10.0 / math.sqrt(3.0)  # largest acceleration of the quintic that takes away 1 in 1 from rest, to rest
DRIFT_PEAK = 3.94  # the same of the one that takes away a speed of 1


@dataclass(frozen=True)
class InertializationSettings(Settings):
    """How a difference runs out. All set by hand."""

    gentle: float = setting(30.0, "rad/s² or m/s²", above=0.0)
    """What the difference may add to the acceleration, of 80, 40 and 30 tried on angry hands that were hidden from 0.5
    to 0.2 s before contact (seeds 3, 6): a hinge's speed changes by 5.9 and 6.1 rad/s in a tick, by 80 7.3 and 8.0."""
    settling: int = setting(3, least=1)
    """Ticks for which values that jumped are not yet to be trusted."""
    shortest: float = setting(0.08, "s", above=0.0)
    longest: float = setting(0.35, "s", above=0.0)
    """Bounds of the time in which a difference runs out."""


class Inertializer:
    """Follows values from tick to tick; what it says has no step in position or speed when they jump."""

    def __init__(self, seconds: float, settings: InertializationSettings | None = None) -> None:
        """Begins with the first values, ``seconds`` per tick."""
        self.settings = settings or InertializationSettings()
        self._seconds = seconds
        self.reset()

    def reset(self) -> None:
        """Forgets what was."""
        self._said: Array | None = None
        self._velocity = self._offset = self._drift = np.zeros(0)
        self._target, self._age, self._length = np.zeros(0), 0, 0.0

    def step(self, values: Array, jumps: bool) -> Array:
        """What to say for ``values`` (C,), which are not where they would be from the tick before if it ``jumps``."""
        if self._said is None:
            said, self._velocity = values, np.zeros_like(values)
            self._said, self._target = said, values
            return said
        if jumps:
            self._age = -self.settings.settling
        if self._age < 0:  # on as before, until it shows how fast the values go now
            said = self._said + self._velocity * self._seconds
            self._offset, self._age = said - values, self._age + 1 or 1
            self._length = 0.0
        elif self._age == 1 and self._length == 0.0:
            self._drift = self._velocity - (values - self._target) / self._seconds
            gentle, drift = self.settings.gentle, float(np.abs(self._drift).max())
            needed = max(math.sqrt(PEAK * float(np.abs(self._offset).max()) / gentle), DRIFT_PEAK * drift / gentle)
            self._length = min(max(needed, self.settings.shortest), self.settings.longest)
            said = values + self._left()
        elif self._age:
            said = values + self._left()
        else:
            said = values
        self._velocity = (said - self._said) / self._seconds
        self._said, self._target = said, values
        return said

    def ahead(self, values: Array, seconds: float) -> Array:
        """What to say for ``values`` (C,), predicted for some ``seconds`` after the last step; changes nothing."""
        if self._said is None:
            return values
        if self._age < 0:  # nobody knows yet how fast the values go
            return self._said + self._velocity * seconds
        return values + (self._said - self._target)

    def _left(self) -> Array:
        """The difference that is left, (C,): from offset and drift, at no acceleration, to nothing."""
        t, x, v = self._length, self._offset, self._drift
        s = self._age * self._seconds / t
        self._age += 1
        if s >= 1.0:
            self._age = 0
            return np.zeros_like(x)
        fall = 1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        glide = s - s**3 * (6.0 - 8.0 * s + 3.0 * s**2)
        return x * fall + v * t * glide

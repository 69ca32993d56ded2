"""A hidden hand that is seen again is not where it was thought to be: it goes there quickly, but not in one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from highfive.mocap_bridge.frames import HumanArm
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class ReacquisitionSettings(Settings):
    """Chosen on simulated high fives of seed 0 and one real one (CMU 20/21, 11)."""

    bandwidth: float = setting(45.0, "rad/s", above=0.0)
    """How fast the difference runs out: of the 3 cm that 0.3 s of guessing cost, 1 mm is left after 0.1 s.

    Slower is smoother, but a hand that comes back just before contact is then met where it was guessed to be.
    """
    averaging: float = setting(0.029, "s", above=0.0)
    """Time constant of the speed of a hand: a guessed one trembles."""


class ReacquisitionSmoother:
    """Carries a hand from where it was guessed to where it is seen, along a critically damped curve."""

    def __init__(self, settings: ReacquisitionSettings | None = None) -> None:
        """Starts without a hand."""
        self.settings = settings or ReacquisitionSettings()
        self.reset()

    def reset(self) -> None:
        """Forgets the hand; the next one is taken as it is."""
        self._age_ns = 0
        self._raw, self._said, self._velocity = (np.zeros((3, 3)) for _ in range(3))
        self._difference, self._rate = np.zeros((3, 3)), np.zeros((3, 3))
        self._known, self._new, self._differs = False, False, False

    def __call__(self, arm: HumanArm, dt: float, ahead_ns: int = 0) -> HumanArm:
        """The arm with wrist, knuckles and palm on that curve.

        Args:
            arm: as estimated.
            dt: s since the last call.
            ahead_ns: how much of the arm's age is prediction beyond the newest frame, which hides nothing.
        """
        raw, age_ns = _points(arm), arm.age_ns - ahead_ns
        if self._known and age_ns < self._age_ns:  # on as it went, until it shows how fast it goes now
            self._difference, self._new, self._differs = self._said + self._velocity * dt - raw, True, True
        elif self._differs:
            if self._new:
                self._rate, self._new = self._velocity - (raw - self._raw) / dt, False
            # x'' = -w² x - 2 w x', which is x = (x0 + (x0' + w x0) t) exp(-w t).
            fall, start = (
                math.exp(-self.settings.bandwidth * dt),
                self._rate + self.settings.bandwidth * self._difference,
            )
            self._difference = (self._difference + start * dt) * fall
            self._rate = (self._rate - self.settings.bandwidth * start * dt) * fall
            if np.abs(self._difference).max() < 1e-5:
                self._difference, self._rate, self._differs = np.zeros((3, 3)), np.zeros((3, 3)), False
        said = raw + self._difference if self._differs else raw
        if self._known:  # each point on its own: a hand turns, and its wrist is not as fast as its palm
            share = 1.0 - math.exp(-dt / self.settings.averaging)
            self._velocity = self._velocity + share * ((said - self._said) / dt - self._velocity)
        self._raw, self._said, self._age_ns, self._known = raw, said, age_ns, True
        if not self._differs:
            return arm
        wrist, knuckles, palm = said
        return replace(
            arm,
            wrist=wrist,
            knuckles=knuckles,
            hand_points=np.array([wrist, knuckles]),
            palm=replace(arm.palm, position=palm, velocity=arm.palm.velocity + self._rate[2]),
        )


def _points(arm: HumanArm) -> Array:
    """Wrist, knuckles and palm (3, 3), m."""
    return np.array([arm.wrist, arm.knuckles, arm.palm.position])

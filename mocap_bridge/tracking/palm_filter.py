"""A steadier palm: less jitter where the hand is slow, little lag where it is fast.

The palm's centre lies outside the markers and its normal rests on a few centimetres between two of them, so that a
marker's noise comes out enlarged. Whoever follows the palm with a joint would shake.

Position: a critically damped alpha–beta–gamma filter (constant acceleration; Bar-Shalom, Li & Kirubarajan 2001,
sec. 6.5), whose bandwidth rises with the hand's speed (as in the 1€ filter of Casiez, Roussel & Vogel 2012).
Direction: a critically damped second-order low pass, whose output changes its speed smoothly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class PalmFilterSettings(Settings):
    """How much is smoothed. All set by hand."""

    slow: float = setting(18.0, "rad/s", above=0.0)
    """Bandwidth of the position where the hand rests."""
    faster: float = setting(30.0, "rad/m", above=0.0)
    """How much wider it gets with each m/s of the hand's speed."""
    fastest: float = setting(60.0, "rad/s", above=0.0)
    """Bound of the bandwidth."""
    turning: float = setting(14.0, "rad/s", above=0.0)
    """Bandwidth of the palm's directions."""


class PalmFilter:
    """Smooths a palm tick by tick."""

    def __init__(self, settings: PalmFilterSettings | None = None) -> None:
        """Starts without a palm."""
        self.settings = settings or PalmFilterSettings()
        self.reset()

    def reset(self) -> None:
        """Forgets the palm; the next one is taken as it is."""
        self._state: tuple[Array, Array, Array] | None = None
        self._directions, self._turning = np.zeros((2, 3)), np.zeros((2, 3))

    def __call__(self, palm: PalmPose, dt: float) -> PalmPose:
        """The smoothed palm; its velocity is the filter's own.

        Args:
            palm: as measured.
            dt: s since the last call.
        """
        directions = np.array([palm.normal, palm.fingers])
        if self._state is None:
            self._state = palm.position, palm.velocity, np.zeros(3)
            self._directions, self._turning = directions, np.zeros((2, 3))
            return palm
        self._state = _alpha_beta_gamma(self.settings, self._state, palm.position, dt)
        pull = self.settings.turning**2 * (directions - self._directions) - 2.0 * self.settings.turning * self._turning
        self._turning = self._turning + pull * dt
        self._directions = self._directions + self._turning * dt
        normal, fingers = self._directions
        normal = normal / math.sqrt(normal @ normal)
        fingers = fingers - normal * (fingers @ normal)
        return PalmPose(self._state[0], normal, fingers / math.sqrt(fingers @ fingers), self._state[1])


def _alpha_beta_gamma(
    settings: PalmFilterSettings, state: tuple[Array, Array, Array], measured: Array, dt: float
) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration, (3,) each, after a measured position (3,)."""
    position, velocity, acceleration = state
    bandwidth = min(settings.slow + settings.faster * math.sqrt(velocity @ velocity), settings.fastest)
    forget = math.exp(-bandwidth * dt)
    alpha = 1.0 - forget**3
    beta = 1.5 * (1.0 - forget) ** 2 * (1.0 + forget)
    gamma = (1.0 - forget) ** 3
    change = acceleration * dt
    predicted = position + (velocity + 0.5 * change) * dt
    innovation = measured - predicted
    return (
        predicted + alpha * innovation,
        velocity + change + beta / dt * innovation,
        acceleration + gamma / (dt * dt) * innovation,
    )

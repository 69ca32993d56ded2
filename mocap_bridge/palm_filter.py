"""A steadier palm: less jitter where the hand is slow, little lag where it is fast.

The palm's centre lies outside the markers and its normal rests on a few centimetres between two of them, so that a
marker's noise comes out enlarged. Whoever follows the palm with a joint would shake.

Position: a critically damped alpha–beta–gamma filter (constant acceleration; Bar-Shalom, Li & Kirubarajan 2001, sec. 6.5),
whose bandwidth rises with the hand's speed (as in the 1€ filter of Casiez, Roussel & Vogel 2012). Direction: a critically
damped second-order low pass, whose output changes its speed smoothly.
"""

from __future__ import annotations

import math

import numpy as np

from mocap_bridge.frames import PalmPose
from model.rotations import Array

SLOW = 18.0
"""Bandwidth of the position where the hand rests, rad/s."""

FASTER = 30.0
"""How much wider it gets with the speed of the hand, rad/s for each m/s."""

FASTEST = 60.0
"""Bound of the bandwidth, rad/s."""

TURNING = 14.0
"""Bandwidth of the palm's directions, rad/s."""


class PalmFilter:
    """Smooths a palm tick by tick."""

    def __init__(self) -> None:
        """Starts without a palm."""
        self.reset()

    def reset(self) -> None:
        """Forgets the palm; the next one is taken as it is."""
        self._state: Array | None = None
        self._directions, self._turning = np.zeros((2, 3)), np.zeros((2, 3))

    def __call__(self, palm: PalmPose, dt: float) -> PalmPose:
        """The smoothed palm; its velocity is the filter's own.

        Args:
            palm: as measured.
            dt: s since the last call.
        """
        directions = np.array([palm.normal, palm.fingers])
        if self._state is None:
            self._state = np.array([palm.position, palm.velocity, np.zeros(3)])
            self._directions, self._turning = directions, np.zeros((2, 3))
            return palm
        self._state = _alpha_beta_gamma(self._state, palm.position, dt)
        pull = TURNING**2 * (directions - self._directions) - 2.0 * TURNING * self._turning
        self._turning = self._turning + pull * dt
        self._directions = self._directions + self._turning * dt
        position, velocity, _ = self._state
        normal = self._directions[0] / np.linalg.norm(self._directions[0])
        fingers = self._directions[1] - normal * (self._directions[1] @ normal)
        return PalmPose(position, normal, fingers / np.linalg.norm(fingers), velocity)


def _alpha_beta_gamma(state: Array, measured: Array, dt: float) -> Array:
    """Position, velocity and acceleration (3, 3) after a measured position (3,)."""
    bandwidth = min(SLOW + FASTER * float(np.linalg.norm(state[1])), FASTEST)
    forget = math.exp(-bandwidth * dt)
    alpha = 1.0 - forget**3
    beta = 1.5 * (1.0 - forget) ** 2 * (1.0 + forget)
    gamma = (1.0 - forget) ** 3
    acceleration = state[2]
    velocity = state[1] + acceleration * dt
    position = state[0] + state[1] * dt + 0.5 * acceleration * dt * dt
    innovation = measured - position
    return np.array(
        [
            position + alpha * innovation,
            velocity + beta / dt * innovation,
            acceleration + gamma / (dt * dt) * innovation,
        ]
    )

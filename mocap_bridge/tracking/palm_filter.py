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
from highfive.model.compiled import compiled_entry
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
        """Starts without a palm, and compiles."""
        self.settings = settings or PalmFilterSettings()
        self._bandwidths = self.settings.slow, self.settings.faster, self.settings.fastest, self.settings.turning
        x, y, z = np.eye(3)
        _follow(np.vstack([np.zeros((3, 3)), y, z, np.zeros((2, 3))]), self._bandwidths, (x, y, z), 1.0)
        self.reset()

    def reset(self) -> None:
        """Forgets the palm; the next one is taken as it is."""
        self._state: Array | None = None

    def __call__(self, palm: PalmPose, dt: float) -> PalmPose:
        """The smoothed palm; its velocity is the filter's own.

        Args:
            palm: as measured.
            dt: s since the last call.
        """
        if self._state is None:
            still = np.zeros(3)
            self._state = np.array([palm.position, palm.velocity, still, palm.normal, palm.fingers, still, still])
            return palm
        position, normal, fingers, velocity = _follow(
            self._state, self._bandwidths, (palm.position, palm.normal, palm.fingers), dt
        )
        return PalmPose(position, normal, fingers, velocity)


@compiled_entry
def _follow(
    state: Array, bandwidths: tuple[float, float, float, float], measured: tuple[Array, Array, Array], dt: float
) -> Array:
    """Position, normal, fingers and velocity (4, 3) after a measured position, normal and fingers, (3,) each.

    Args:
        state: (7, 3) position, velocity, acceleration, normal, fingers, and the speeds of both; goes on by ``dt``, s.
        bandwidths: ``slow``, ``faster``, ``fastest`` and ``turning`` of :class:`PalmFilterSettings`.
        measured: likewise.
    """
    slow, faster, fastest, turning = bandwidths
    position, normal, fingers = measured
    said, square = np.empty((4, 3)), 0.0
    for i in range(3):
        square += state[1, i] ** 2
    forget = math.exp(-min(slow + faster * math.sqrt(square), fastest) * dt)
    alpha, beta, gamma = 1.0 - forget**3, 1.5 * (1.0 - forget) ** 2 * (1.0 + forget), (1.0 - forget) ** 3
    along = across = tilt = 0.0
    for i in range(3):
        change = state[2, i] * dt
        predicted = state[0, i] + (state[1, i] + 0.5 * change) * dt
        innovation = position[i] - predicted
        state[0, i] = predicted + alpha * innovation
        state[1, i] += change + beta / dt * innovation
        state[2, i] += gamma / (dt * dt) * innovation
        state[5, i] += (turning**2 * (normal[i] - state[3, i]) - 2.0 * turning * state[5, i]) * dt
        state[6, i] += (turning**2 * (fingers[i] - state[4, i]) - 2.0 * turning * state[6, i]) * dt
        state[3, i] += state[5, i] * dt
        state[4, i] += state[6, i] * dt
        along += state[3, i] ** 2
    for i in range(3):
        said[0, i], said[1, i], said[3, i] = state[0, i], state[3, i] / math.sqrt(along), state[1, i]
        tilt += state[4, i] * said[1, i]
    for i in range(3):
        said[2, i] = state[4, i] - tilt * said[1, i]
        across += said[2, i] ** 2
    for i in range(3):
        said[2, i] /= math.sqrt(across)
    return said

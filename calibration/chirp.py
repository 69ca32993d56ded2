"""What excites a joint whose lag is measured: a logarithmic chirp below every limit of speed and acceleration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class ChirpSettings(Settings):
    """Of the excitation. Tried on a model of the arm's servos: with 10 s the lag is known to 0.2 ms."""

    seconds: float = setting(10.0, "s", least=1.0)
    lowest: float = setting(0.3, "Hz", above=0.0)
    highest: float = setting(4.0, "Hz", above=0.0)
    amplitude: float = setting(0.087, "rad", above=0.0)
    """Five degrees at the lower frequencies; less where the joint would be too fast."""
    fade: float = setting(0.3, "s", least=0.0)
    """So long it comes in and goes out: a joint must not be jerked."""
    share: float = setting(0.7, above=0.0, most=1.0)
    """Of the limits that are used: a servo at its limit of speed, or of torque, is later than a linear model says."""


def chirp(times: Array, speed: float, acceleration: float, settings: ChirpSettings | None = None) -> Array:
    """Angles of a joint about where it stands, rad, whose frequency rises exponentially with time.

    Speed and acceleration stay below a share of their limits, as a grid of 1 ms shows them.

    Args:
        times: (T,) s from the beginning; before it and after the end the joint rests.
        speed, acceleration: rad/s and rad/s², the lowest limits that hold for the joint.
        settings: of the excitation.

    Raises:
        HighFiveError: the frequencies do not rise, or the limits leave no motion.
    """
    s = settings or ChirpSettings()
    if s.highest <= s.lowest:
        raise HighFiveError(f"a chirp from {s.lowest:g} to {s.highest:g} Hz; expected a rising frequency")
    if not (speed > 0.0 and acceleration > 0.0):
        raise HighFiveError(f"a chirp within {speed:g} rad/s and {acceleration:g} rad/s²; expected limits above 0")
    grid = np.arange(0.0, s.seconds, 1e-3)
    shape = _shape(grid, speed, acceleration, s)
    fastest = np.gradient(shape, 1e-3)  # the fades and the amplitude's own change add to what a sine's is
    most = max(np.abs(fastest).max() / speed, np.abs(np.gradient(fastest, 1e-3)).max() / acceleration, s.share)
    return s.share / most * _shape(np.asarray(times, float), speed, acceleration, s)


def _shape(times: Array, speed: float, acceleration: float, s: ChirpSettings) -> Array:
    """With the amplitude that a sine of each frequency may have."""
    inside = np.clip(times, 0.0, s.seconds)
    ratio = math.log(s.highest / s.lowest)
    phase = math.tau * s.lowest * s.seconds / ratio * np.expm1(ratio * inside / s.seconds)
    turning = math.tau * s.lowest * np.exp(ratio * inside / s.seconds)
    # A smooth minimum: where one bound takes over from another the speed must not jump.
    bounds = np.stack([np.full_like(turning, s.amplitude), speed / turning, acceleration / turning**2])
    return np.sum(bounds**-4.0, axis=0) ** -0.25 * _faded(inside, s) * np.sin(phase)


def _faded(times: Array, s: ChirpSettings) -> Array:
    """Raised cosines at both ends."""
    if s.fade == 0.0:
        return np.ones_like(times)
    left = np.clip(np.minimum(times, s.seconds - times) / s.fade, 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(math.pi * left)

"""How late a servo is: a transport delay and a second-order system, fitted to what it was told and where it went.

A command stays until the next one: that alone looks like a delay of half a period, and is a part of the model. What
is found is the *servo's* lag, free of the rate at which it was commanded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from highfive.calibration.spread import standard_errors
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class ServoLagSettings(Settings):
    """Of the fit."""

    memory: float = setting(1.0, "s", above=0.0)
    """A command so long ago is answered in full."""
    noise: float = setting(0.0015, "rad", above=0.0)
    """Beyond about this an error counts less (soft L1): a count of the encoder."""
    motion: float = setting(0.01, "rad", above=0.0)
    """Least standard deviation of the commands: below it the encoder's counts rule."""
    told: float = setting(5e-4, "rad", above=0.0)
    """A parameter that changes the answer by less (root mean square, by its unit; a frequency by a factor of e) is not
    told, and says nothing of how sure the lag is."""
    worst: float = setting(0.5, above=0.0)
    """Most that the residual may be, of the motion: beyond it the servo did not follow."""


BOUNDS = np.array([[0.0, np.log(3.0), np.log(0.1), 0.2, -np.inf], [0.2, np.log(1000.0), np.log(20.0), 2.0, np.inf]])
"""Of delay, s, logarithms of frequency, rad/s, and damping, gain and offset, rad."""


@dataclass(frozen=True)
class ServoLag:
    """A joint from command to encoder.

    Attributes:
        delay: s, until anything happens.
        omega, zeta: rad/s and 1, natural frequency and damping of the second-order system after it.
        lag_error: s, of :attr:`lag`, 95 %.
        gain: of the answer; 1 for a servo that comes where it is sent.
        residual: rad, root mean square.
        apart: delay, frequency and damping are told apart; else they lie at a bound, and their sum, the lag, is told
            alone.
    """

    delay: float
    omega: float
    zeta: float
    lag_error: float
    gain: float
    residual: float
    apart: bool = True

    @property
    def lag(self) -> float:
        """s by which slow motion is late: delay + 2 ζ / ω."""
        return self.delay + 2.0 * self.zeta / self.omega

    def lag_at(self, frequency: float) -> float:
        """s by which a sine of a ``frequency``, Hz, is late: its phase over its angular frequency."""
        ratio = 2.0 * np.pi * frequency / self.omega
        return self.delay + float(np.arctan2(2.0 * self.zeta * ratio, 1.0 - ratio**2)) / (2.0 * np.pi * frequency)


def answer(at: Array, times: Array, commands: Array, delay: float, omega: float, zeta: float, memory: float) -> Array:
    """(N,) answer of a second-order system with a delay to commands, each held until the next.

    The sum of the step answers of all changes (superposition); exact for what is younger than ``memory``.

    Args:
        at: (N,) s, when.
        times, commands: (T,) s, rising, and rad.
        delay, omega, zeta: s, rad/s and 1.
        memory: s after which a step is taken to be over.
    """
    shifted = times + delay
    changes = np.diff(commands, prepend=commands[0])
    newest = np.searchsorted(shifted, at, side="right") - 1  # the last command that is felt
    count = min(int(np.ceil(memory / np.median(np.diff(times)))) + 1, len(times))
    felt = newest[:, None] - np.arange(count)
    there = felt >= 0
    felt = np.maximum(felt, 0)
    before = commands[np.maximum(newest - count, 0)]
    return before + np.sum(np.where(there, changes[felt] * step(at[:, None] - shifted[felt], omega, zeta), 0.0), axis=1)


def step(times: Array, omega: float, zeta: float) -> Array:
    """Unit step answer of ω² / (s² + 2ζω s + ω²) at ``times``, s, of any shape; 0 before 0."""
    t = np.maximum(times, 0.0)
    root = np.sqrt(complex(zeta * zeta - 1.0))
    if abs(root) < 1e-6:
        return 1.0 - (1.0 + omega * t) * np.exp(-omega * t)
    one, two = -omega * (zeta - root), -omega * (zeta + root)
    return (1.0 + (two * np.exp(one * t) - one * np.exp(two * t)) / (one - two)).real


def servo_lag(
    command_times: Array, commands: Array, encoder_times: Array, angles: Array, settings: ServoLagSettings | None = None
) -> ServoLag:
    """The lag of a joint.

    Delay, frequency, damping, gain and offset by robust least squares from several beginnings. The error of the lag
    is that of the fit, for residuals that hang together as they do.

    Args:
        command_times, commands: (T,) s, rising, when the joint was told, and rad.
        encoder_times, angles: (N,) s, when the encoder was read, on the same clock, and rad.
        settings: of the fit.

    Raises:
        HighFiveError: too little motion, too few samples, or an answer that does not follow the commands.
    """
    s = settings or ServoLagSettings()
    times, told, at, angle = (np.asarray(v, float) for v in (command_times, commands, encoder_times, angles))
    if len(times) < 30 or len(at) < 30:
        raise HighFiveError(f"{len(times)} commands and {len(at)} angles; expected 30 or more of each")
    if not all(np.isfinite(v).all() for v in (times, told, at, angle)) or (np.diff(times) <= 0.0).any():
        raise HighFiveError("commands and angles have to be finite, and the commands' times have to rise")
    if told.std() < s.motion:
        raise HighFiveError(
            f"the commands move the joint by {told.std():.4f} rad (standard deviation), expected {s.motion:g} or more"
        )

    def modelled(x: Array) -> Array:
        return x[3] * answer(at, times, told - told.mean(), x[0], np.exp(x[1]), np.exp(x[2]), s.memory) + x[4]

    fits = [
        least_squares(
            lambda x: (modelled(x) - angle) / s.noise,
            np.array([begin, np.log(omega), np.log(0.7), 1.0, angle.mean()]),
            bounds=(BOUNDS[0], BOUNDS[1]),
            x_scale=np.array([0.01, 0.3, 0.3, 0.1, 0.01]),
            loss="soft_l1",
        )
        for begin, omega in ((0.01, 40.0), (0.001, 120.0))
    ]
    best = min(fits, key=lambda fit: float(np.sum(np.abs(fit.fun))))
    residual = angle - modelled(best.x)
    rms = float(np.sqrt(np.mean(residual**2)))
    if rms > s.worst * told.std():
        raise HighFiveError(
            f"the joint does not follow: {rms:.4f} rad off (root mean square) of {told.std():.4f} commanded; "
            "is it the right one, its direction right, its torque on?"
        )
    delay, omega, zeta = float(best.x[0]), float(np.exp(best.x[1])), float(np.exp(best.x[2]))
    # By delay, 2 ζ / ω and ω: the first two are the lag, and of the third a damped servo tells next to nothing.
    by = best.jac[:, [0, 2, 1, 3, 4]] * s.noise
    by[:, 2] += by[:, 1]
    by[:, 1] /= 2.0 * zeta / omega
    size = np.linalg.norm(by, axis=0)
    told = size > s.told * np.sqrt(len(by))
    of = np.array([[1.0, 1.0, 0.0, 0.0, 0.0]])[:, told] / size[told]
    error = 1.96 * standard_errors(by[:, told] / size[told], residual, of)[0]
    x, (low, high) = best.x[:3], BOUNDS[:, :3]
    apart = bool(np.all((x > low + 1e-3 * (high - low)) & (x < high - 1e-3 * (high - low))))
    return ServoLag(delay, omega, zeta, error, float(best.x[3]), rms, apart)

"""What a movement and its predicted uncertainty are judged by: calibration, smoothness, lag."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr

from highfive.model.geometry.rotations import Array

CUTOFF_HZ = 10.0  # of the spectral arc length: a hand does nothing above
AMPLITUDE = 0.05  # of the spectral arc length: what is below this share of the spectrum's largest is noise
PADDING = 4  # the spectrum is padded by zeros to 2⁴ times its length, as the source does
SMOOTHING_S = 0.05  # s; jerk is the third difference of positions averaged over this time, else it is noise alone
MAXIMUM_LAG = 0.5  # s


@dataclass(frozen=True)
class Calibration:
    """How held-out values lie in their predicted distributions.

    Attributes:
        within_50, within_90: share of the values inside the central 50 % and 90 % interval or region; 0.5 and 0.9 if
            calibrated.
        mean_square: mean squared error in units of the predicted variance, a dimension; 1 if calibrated.
    """

    within_50: float
    within_90: float
    mean_square: float


def surprise(error: Array, deviation: Array) -> Array:
    """Squared normalised errors z² of errors and predicted standard deviations of one shape."""
    return np.square(error / deviation)


def region_surprise(error: Array, covariance: Array) -> Array:
    """Squared Mahalanobis distances (...,) of errors (..., D) under covariances (..., D, D)."""
    return np.sum(error * np.linalg.solve(covariance, error[..., None])[..., 0], axis=-1)


def levels(squares: Array, dims: int) -> Array:
    """The smallest central region, as its probability, that holds each value: uniform on 0–1 if calibrated."""
    return np.asarray(chdtr(dims, squares))


def calibration(squares: Array, dims: int) -> Calibration:
    """Calibration of Gaussian predictions of ``dims`` dimensions from their squared normalised errors."""
    at = levels(squares, dims)
    return Calibration(float(np.mean(at <= 0.5)), float(np.mean(at <= 0.9)), float(np.mean(squares)) / dims)


def speeds(track: Array, rate_hz: float) -> Array:
    """Speeds (T,), m/s, of a track (T, 3), m."""
    return np.linalg.norm(np.gradient(track, 1.0 / rate_hz, axis=0), axis=-1)


def spectral_arc_length(speed: Array, rate_hz: float) -> float:
    """Smoothness of a speed profile (T,): minus the arc length of its normalised spectrum, 0 is smoothest.

    Source: Balasubramanian, Melendez-Calderon, Roby-Brami & Burdet 2015, "On the analysis of movement smoothness",
    equations 3–4 (SPARC), with their cut-offs. It does not depend on amplitude or duration. A profile of
    zeros has none: NaN.
    """
    size: int = 2 ** (int(np.ceil(np.log2(len(speed)))) + PADDING)
    frequency = np.arange(size // 2 + 1) * rate_hz / size
    spectrum = np.abs(np.fft.rfft(speed, size))
    if spectrum.max() <= 0.0:
        return float("nan")
    within = frequency <= CUTOFF_HZ
    frequency, spectrum = frequency[within], spectrum[within] / spectrum.max()
    heard = np.flatnonzero(spectrum >= AMPLITUDE)
    part = slice(heard[0], heard[-1] + 1)
    frequency, spectrum = frequency[part], spectrum[part]
    if len(frequency) < 2:
        return 0.0
    run = np.diff(frequency) / (frequency[-1] - frequency[0])
    return -float(np.sum(np.hypot(run, np.diff(spectrum))))


def rms_jerk(track: Array, rate_hz: float) -> float:
    """Root mean square of the third derivative, m/s³, of a track (T, 3), m, averaged over 50 ms."""
    width = max(1, round(SMOOTHING_S * rate_hz))
    if len(track) < width + 3:
        return 0.0
    kernel = np.ones(width) / width
    smooth = np.stack([np.convolve(column, kernel, mode="valid") for column in track.T], axis=1)
    squares: Array = np.sum(np.square(np.diff(smooth, 3, axis=0) * rate_hz**3), axis=1)
    return float(np.sqrt(np.mean(squares)))


def lag(signal: Array, reference: Array, rate_hz: float) -> float:
    """How much later, s, a signal (T,) is than a reference (T,): where they correlate best.

    Within half a second either way; a parabola through the largest correlation and its neighbours gives parts of a
    frame. Each shift's correlation is of what overlaps: a plain cross-correlation is pulled towards no shift, where the
    overlap is largest. Signals that do not vary have no lag: 0.
    """
    reach = min(round(MAXIMUM_LAG * rate_hz), len(reference) // 2)
    near = np.array([_correlation(signal, reference, shift) for shift in range(-reach, reach + 1)])
    if np.ptp(near) == 0.0:
        return 0.0
    top = int(np.argmax(near))
    shift = float(top - reach)
    if 0 < top < len(near) - 1:
        before, at, after = near[top - 1 : top + 2]
        if (bend := before - 2.0 * at + after) < 0.0:
            shift += 0.5 * float(before - after) / float(bend)
    return shift / rate_hz


def _correlation(signal: Array, reference: Array, shift: int) -> float:
    """Pearson's correlation of a signal, ``shift`` frames later, with a reference, where both are known."""
    size = len(reference) - abs(shift)
    one = signal[max(shift, 0) :][:size]
    other = reference[max(-shift, 0) :][:size]
    one, other = one - one.mean(), other - other.mean()
    norm = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / norm if norm > 0.0 else 0.0

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import erf

from highfive.model.evaluation import metrics

RATE = 120.0


def minimum_jerk(seconds: float, rate_hz: float = RATE) -> tuple[np.ndarray, np.ndarray]:
    """Speed, and position, of a movement of 1 m (Flash & Hogan 1985)."""
    u = np.arange(0.0, 1.0 + 1e-9, 1.0 / (seconds * rate_hz))
    return (30 * u**2 - 60 * u**3 + 30 * u**4) / seconds, 10 * u**3 - 15 * u**4 + 6 * u**5


@pytest.mark.parametrize("dims", [1, 3])
def test_a_gaussian_that_is_what_was_predicted_is_calibrated(dims: int):
    rng = np.random.default_rng(0)
    root = rng.normal(size=(dims, dims)) + np.eye(dims)
    covariance = root @ root.T
    errors = rng.normal(size=(40000, dims)) @ root.T
    squares = metrics.region_surprise(errors, np.broadcast_to(covariance, (len(errors), dims, dims)))
    found = metrics.calibration(squares, dims)
    assert found.within_50 == pytest.approx(0.5, abs=0.01)
    assert found.within_90 == pytest.approx(0.9, abs=0.01)
    assert found.mean_square == pytest.approx(1.0, abs=0.02)
    shares = [np.mean(metrics.levels(squares, dims) <= p) for p in np.linspace(0.1, 0.9, 9)]
    assert np.allclose(shares, np.linspace(0.1, 0.9, 9), atol=0.015)


@given(st.floats(0.1, 10.0))
def test_too_sure_or_too_modest_shows(factor: float):
    errors = np.random.default_rng(1).normal(size=4000)
    found = metrics.calibration(metrics.surprise(errors, np.full(4000, factor)), 1)
    assert found.mean_square == pytest.approx(np.mean(errors**2) / factor**2)
    assert found.within_90 == pytest.approx(erf(1.6449 * factor / np.sqrt(2.0)), abs=0.02)


def test_one_dimension_is_the_same_as_a_region_of_one():
    rng = np.random.default_rng(2)
    errors, deviations = rng.normal(size=50), rng.uniform(0.5, 2.0, size=50)
    region = metrics.region_surprise(errors[:, None], deviations[:, None, None] ** 2)
    assert np.allclose(region, metrics.surprise(errors, deviations))


@given(st.floats(0.4, 2.0), st.floats(0.01, 100.0))
def test_smoothness_is_blind_to_amplitude_and_duration(seconds: float, amplitude: float):
    speed, _ = minimum_jerk(seconds)
    assert metrics.spectral_arc_length(amplitude * speed, RATE) == pytest.approx(-1.41, abs=0.03)


def test_submovements_are_less_smooth_the_further_they_are_apart():
    speed, _ = minimum_jerk(0.6)
    gap = [np.concatenate([speed, np.zeros(n), speed]) for n in (0, 24, 72)]
    arcs = [metrics.spectral_arc_length(part, RATE) for part in [speed, *gap]]
    assert arcs == sorted(arcs, reverse=True)
    assert np.isnan(metrics.spectral_arc_length(np.zeros(100), RATE))


def test_jerk_of_a_known_movement():
    _, position = minimum_jerk(1.0, 1000.0)
    track = np.stack([position, np.zeros_like(position), 2.0 * position], axis=1)
    exact = np.sqrt(5.0 * 720.0)  # of 10 u³ − 15 u⁴ + 6 u⁵: ∫ (60 − 360 u + 360 u²)² du = 720; two axes, 1 and 2 m
    assert metrics.rms_jerk(track, 1000.0) == pytest.approx(exact, rel=0.15)  # 50 ms are averaged over
    noisy = track + np.random.default_rng(0).normal(size=track.shape) * 1e-3
    assert metrics.rms_jerk(noisy, 1000.0) > metrics.rms_jerk(track, 1000.0)
    assert metrics.rms_jerk(track[:20], 1000.0) == 0.0


@given(st.floats(-0.3, 0.3), st.sampled_from([30.0, 60.0, 120.0]))
def test_lag_of_a_shifted_signal(shift: float, rate_hz: float):
    times = np.arange(0.0, 4.0, 1.0 / rate_hz)
    bump = lambda at: np.exp(-0.5 * ((times - 2.0 - at) / 0.2) ** 2)  # noqa: E731
    found = metrics.lag(3.0 * bump(shift), bump(0.0), rate_hz)
    assert found == pytest.approx(shift, abs=0.2 / rate_hz)
    assert metrics.lag(bump(0.0), bump(shift), rate_hz) == pytest.approx(-found, abs=1e-6)


def test_what_does_not_move_has_no_lag():
    assert metrics.lag(np.ones(50), np.ones(50), 120.0) == 0.0

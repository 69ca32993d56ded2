"""A servo's lag comes back from what it was told and where it went; the oracle is an integration of its equation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from highfive.calibration.chirp import chirp
from highfive.calibration.servo_lag import answer, servo_lag, step
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

COUNT = 2.0 * np.pi / 4096


def _commands(rate: float = 120.0) -> tuple[Array, Array]:
    times = np.arange(-0.5, 10.7, 1.0 / rate)
    return times, chirp(times, 2.0, 30.0)


def _measured(delay: float, omega: float, zeta: float, seed: int) -> tuple[Array, Array, Array, Array]:
    """Commands with jitter, and an encoder that counts, with noise and losses."""
    rng = np.random.default_rng(seed)
    times, told = _commands()
    times = times + rng.uniform(0.0, 1e-3, len(times))
    at = np.arange(-0.3, 10.6, 1.0 / 120.0) + rng.uniform(0.0, 0.008)
    at = at[rng.random(len(at)) > 0.02]
    angle = answer(at, times, told, delay, omega, zeta, 3.0) + rng.normal(0.0, 3e-4, len(at))
    return times, told, at, COUNT * np.round(angle / COUNT)


@pytest.mark.parametrize(("delay", "omega", "zeta"), [(0.0, 40.0, 0.45), (0.013, 60.0, 1.0), (0.004, 90.0, 2.5)])
def test_the_answer_is_that_of_the_differential_equation(delay: float, omega: float, zeta: float) -> None:
    """Held commands, integrated from one to the next (Runge-Kutta)."""
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.005, 0.012, 60))
    told = np.cumsum(rng.normal(0.0, 0.1, 60))
    told[0] = 0.0
    at = np.linspace(times[1], times[-1] + delay, 50)
    state, expected, now = np.array([0.0, 0.0]), {}, times[0] + delay
    for k, begin in enumerate(times + delay):
        end = times[k + 1] + delay if k + 1 < len(times) else at[-1] + 1e-9
        inside = at[(at >= begin) & (at < end)]
        solved = solve_ivp(
            lambda _, y, goal=told[k]: [y[1], omega**2 * (goal - y[0]) - 2.0 * zeta * omega * y[1]],
            (begin, end), state, t_eval=np.append(inside, end), rtol=1e-9, atol=1e-11,
        )  # fmt: skip
        expected.update(zip(inside.tolist(), solved.y[0][:-1].tolist(), strict=True))
        state, now = solved.y[:, -1], end
    assert now >= at[-1]
    found = answer(at, times, told, delay, omega, zeta, 10.0)
    seen = np.array([expected.get(float(t), 0.0) for t in at])
    assert np.abs(found - seen).max() < 1e-6


@given(st.floats(5.0, 200.0), st.floats(0.1, 10.0))
def test_a_step_begins_at_rest_and_ends_at_one(omega: float, zeta: float) -> None:
    """For any damping, near the critical one, too."""
    assert step(np.array([-1.0, 0.0]), omega, zeta) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert step(np.array([60.0 * (1.0 + zeta) / omega * (1.0 + zeta)]), omega, zeta)[0] == pytest.approx(1.0, abs=1e-3)
    near = step(np.linspace(0.0, 1.0, 50), omega, 1.0 + 1e-9) - step(np.linspace(0.0, 1.0, 50), omega, 1.0 + 1e-5)
    assert np.abs(near).max() < 1e-4


@pytest.mark.slow
@settings(max_examples=6)
@given(st.floats(0.0, 0.02), st.floats(30.0, 80.0), st.floats(0.4, 1.3), st.integers(0, 99))
def test_the_lag_comes_back_within_half_a_millisecond(delay: float, omega: float, zeta: float, seed: int) -> None:
    """From ten seconds, with counts, noise, losses and jitter."""
    found = servo_lag(*_measured(delay, omega, zeta, seed))
    assert found.lag == pytest.approx(delay + 2.0 * zeta / omega, abs=5e-4)
    assert found.lag_error < 1e-3
    assert found.lag_at(0.01) == pytest.approx(found.lag, abs=1e-4)


@pytest.mark.slow
def test_the_hold_of_a_command_is_no_lag_of_the_servo() -> None:
    """Told 60 or 240 times a second it is the same servo."""
    lags = []
    for rate in (60.0, 240.0):
        times, told = _commands(rate)
        at = np.arange(-0.3, 10.6, 1.0 / 120.0)
        lags.append(servo_lag(times, told, at, answer(at, times, told, 0.005, 45.0, 0.6, 3.0)).lag)
    assert lags == pytest.approx([0.005 + 1.2 / 45.0] * 2, abs=1e-4)


def test_what_cannot_be_fitted_is_refused_in_one_line() -> None:
    """No motion, another joint's angles, too little, NaN."""
    times, told, at, angle = _measured(0.005, 45.0, 0.6, 0)
    with pytest.raises(HighFiveError, match="standard deviation"):
        servo_lag(times, 0.01 * told, at, angle)
    with pytest.raises(HighFiveError, match="does not follow"):
        servo_lag(times, told, at, np.random.default_rng(0).normal(0.0, 0.05, len(at)))
    with pytest.raises(HighFiveError, match="30 or more"):
        servo_lag(times[:10], told[:10], at, angle)
    with pytest.raises(HighFiveError, match="finite"):
        servo_lag(times, told, at, np.where(at < 1.0, np.nan, angle))

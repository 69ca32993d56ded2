"""The delay between two streams of one motion, by injection."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.calibration.chirp import chirp
from highfive.calibration.stream_delay import stream_delay
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array


def _two(delay: float, seed: int, noise: float = 0.0005) -> tuple[Array, Array, Array, Array]:
    """A plate's way, m, by encoders at 120 Hz and by markers at 100 Hz with gaps and stray points."""
    rng = np.random.default_rng(seed)
    at = np.sort(np.arange(0.0, 10.5, 1.0 / 120.0) + rng.normal(0.0, 2e-4, 1260))
    when = np.arange(0.003, 10.5, 0.01)
    one = 0.4 * chirp(at, 2.0, 30.0) + rng.normal(0.0, noise, len(at))
    two = 1.3 + 0.35 * chirp(when - delay, 2.0, 30.0) + rng.normal(0.0, noise, len(when))
    two[rng.random(len(two)) < 0.03] = np.nan
    two[rng.random(len(two)) < 0.01] += 0.03
    return at, one, when, two


@given(st.floats(-0.05, 0.1), st.integers(0, 999))
@pytest.mark.slow
def test_the_delay_comes_back_within_half_a_millisecond_or_three_stated_errors(delay: float, seed: int) -> None:
    """With noise, gaps, stray points, two rates and another size."""
    found = stream_delay(*_two(delay, seed))
    assert found.delay == pytest.approx(delay, abs=max(5e-4, 3.0 * found.error))
    assert found.error < 1e-3
    assert found.gain == pytest.approx(0.35 / 0.4, rel=0.01)


@pytest.mark.slow
def test_the_stated_error_holds() -> None:
    """Of sixty injected delays, most lie within it."""
    inside = 0
    for seed in range(60):
        delay = 0.001 * seed
        found = stream_delay(*_two(delay, seed))
        inside += abs(found.delay - delay) <= found.error
    assert inside >= 48


def test_what_is_not_one_motion_is_refused() -> None:
    """Noise, no motion, too few in common."""
    at, one, when, two = _two(0.01, 0)
    with pytest.raises(HighFiveError, match="not one motion"):
        stream_delay(at, one, when, np.random.default_rng(0).normal(size=len(when)))
    with pytest.raises(HighFiveError, match="nothing moves"):
        stream_delay(at, one, when, np.zeros(len(when)))
    with pytest.raises(HighFiveError, match="samples in common"):
        stream_delay(at, one, when + 100.0, two)

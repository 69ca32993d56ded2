"""The excitation stays below its limits and begins and ends at rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.calibration.chirp import ChirpSettings, chirp
from highfive.model.errors import HighFiveError

TIMES = np.arange(-1.0, 12.0, 1e-3)


@given(st.floats(0.1, 5.0), st.floats(0.5, 100.0))
def test_speed_and_acceleration_stay_below_the_limits(speed: float, acceleration: float) -> None:
    """Also while it comes in and goes out, and while its frequency rises."""
    motion = chirp(TIMES, speed, acceleration)
    velocity = np.gradient(motion, TIMES)
    assert np.abs(velocity).max() <= speed
    assert np.abs(np.gradient(velocity, TIMES)).max() <= acceleration


def test_it_rests_before_and_after() -> None:
    """Whatever the fade."""
    motion = chirp(TIMES, 3.0, 40.0, ChirpSettings(seconds=9.0))
    assert not motion[(TIMES <= 0.0) | (TIMES >= 9.0)].any()


def test_the_frequency_rises_from_the_lowest_to_the_highest() -> None:
    """Counted by zero crossings in the first and the last second."""
    motion = chirp(TIMES, 3.0, 40.0)

    def crossings(begin: float, end: float) -> int:
        part = motion[round(1e3 * (begin + 1.0)) : round(1e3 * (end + 1.0))]
        return int(np.count_nonzero(part[1:] * part[:-1] < 0.0))

    assert crossings(0.0, 1.7) <= 2
    assert 6 <= crossings(8.8, 9.9) <= 9


@pytest.mark.parametrize(("speed", "acceleration"), [(0.0, 10.0), (1.0, -1.0), (float("nan"), 1.0)])
def test_limits_that_leave_no_motion_are_refused(speed: float, acceleration: float) -> None:
    """In one line."""
    with pytest.raises(HighFiveError, match="limits above 0"):
        chirp(TIMES, speed, acceleration)


def test_a_falling_chirp_is_refused() -> None:
    """Its fit would see slow motion last."""
    with pytest.raises(HighFiveError, match="rising frequency"):
        chirp(TIMES, 1.0, 10.0, ChirpSettings(lowest=4.0, highest=0.3))

"""Even times: nothing changes where the ticks are even, and a moving point is where it was between them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.recording.exports.even_times import even_times
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations


@pytest.mark.parametrize("rate", [30.0, 59.94, 120.0, 500.0])
def test_even_ticks_stay_as_they_are(rate):
    times = 3.0 + np.round(np.arange(200) / rate, 9)
    even = even_times(times, "t")
    assert even.as_recorded and even.rate_hz == pytest.approx(rate, abs=1e-3)
    values = np.random.default_rng(0).normal(size=(200, 2, 3))
    np.testing.assert_array_equal(even.between(values), values)


@given(st.integers(0, 10_000))
def test_what_moves_evenly_is_where_it_was_then(seed):
    """Straight lines and turns about one axis go through any uneven ticks exactly."""
    rng = np.random.default_rng(seed)
    times = np.sort(np.arange(100) / 120.0 + rng.uniform(-0.3, 0.3, 100) / 120.0)
    times = np.delete(times, rng.integers(1, 99, 5))
    even = even_times(times, "t")
    at = times[0] + np.arange(len(even.left)) / even.rate_hz
    assert at[-1] <= times[-1] + 0.02 / 120.0
    tolerance = 0.03 / 120.0  # s: within that of a tick it is the tick
    np.testing.assert_allclose(even.between(times[:, None])[:, 0], at, atol=tolerance)
    turned = even.turns_between(rotations.from_axis_angle("y", times)[:, None])[:, 0]
    np.testing.assert_allclose(2.0 * np.arctan2(turned[:, 2], turned[:, 0]), at, atol=tolerance)


def test_a_marker_is_not_made_up_where_frames_were_lost():
    times = np.delete(np.arange(50) / 100.0, [20, 21])
    even = even_times(times, "t")
    assert len(even.left) == 50 and even.rate_hz == 100.0
    seen = even.seen_between(np.ones((48, 1), dtype=bool))[:, 0]
    np.testing.assert_array_equal(np.flatnonzero(~seen), [20, 21])


@pytest.mark.parametrize("times", [[], [1.0], [1.0, 1.0], [1.0, 2.0, 1.5]])
def test_times_that_do_not_go_on_are_refused(times):
    with pytest.raises(HighFiveError, match="do not go on"):
        even_times(np.array(times), "t")

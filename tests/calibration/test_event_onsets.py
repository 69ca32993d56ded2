"""Events in simulated streams of any rate, against when they were."""

import numpy as np
import pytest

from highfive.calibration.event_onsets import impacts, steps
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array


def taps(times: Array, when: Array) -> Array:
    """(T, 3) m: a hand that comes down ever faster, is stopped at 1 m/s from one moment to the next, and is raised."""
    height = np.full(len(times), 0.1)
    for at in when:
        since = times - at
        down = np.where(since < 0.0, 0.1 * (1.0 - ((since + 0.2) / 0.2) ** 2), 0.0)
        up = 0.1 / (1.0 + np.exp(-(since - 0.5) / 0.05))
        height = np.where((since > -0.2) & (since < 1.0), np.where(since < 0.1, down, up), height)
    return np.stack([0.3 + 0.05 * np.sin(times), np.zeros_like(times), height], axis=1)


@pytest.mark.parametrize("rate", [60.0, 120.0, 500.0])
def test_taps_are_found_to_a_part_of_a_frame(rate: float) -> None:
    rng = np.random.default_rng(4)
    when = np.arange(2.0, 22.0, 2.0) + rng.uniform(-0.2, 0.2, 10)
    times = np.arange(0.0, 24.0, 1.0 / rate)
    points = taps(times, when) + rng.normal(0.0, 2e-5, (len(times), 3))
    points[100:110] = np.nan
    found = impacts(times, points)
    assert len(found) == len(when)
    off = found - when
    assert np.abs(off).max() < 0.5 / rate and abs(np.median(off)) < 0.25 / rate


@pytest.mark.parametrize("height", [-3.0, 250.0])
def test_steps_are_found_where_half_of_their_height_is_reached(height: float) -> None:
    rng, when = np.random.default_rng(2), np.array([1.0, 2.13, 3.4, 5.007, 6.2])
    times = np.sort(rng.uniform(0.0, 8.0, 1600))
    since = times[:, None] - when
    pulses = np.where((since > -0.005) & (since < 0.1), np.minimum(1.0, (since + 0.005) / 0.01), 0.0).sum(axis=1)
    values = 7.0 + height * pulses + 0.01 * abs(height) * rng.normal(size=len(times))
    values[::50] = np.nan
    found = steps(times, values)
    assert len(found) == len(when) and np.abs(found - when).max() < 4e-3


def test_what_shows_nothing_has_no_events() -> None:
    times = np.arange(0.0, 2.0, 0.01)
    assert len(steps(times, np.ones(200))) == 0 and len(impacts(times, np.ones((200, 3)))) == 0
    with pytest.raises(HighFiveError, match="expected 5 or more"):
        impacts(times[:4], np.zeros((4, 3)))

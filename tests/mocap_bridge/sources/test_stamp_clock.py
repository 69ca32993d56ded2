"""Stamps of another clock on this one: laws, against a truth that is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.mocap_bridge.sources.stamp_clock import UNKNOWN_NS, StampClock, hull_edge
from highfive.mocap_bridge.sources.steady_time import SteadyTime

MS, S = 1_000_000, 1_000_000_000
OFFSET = 123 * S


def heard(
    seconds: float, rate: float, ppm: float, seed: int, step_ns: int = 0, step_at: float = np.inf
) -> list[tuple[int, int, int]]:
    """Stamp, arrival, and when a frame would have arrived at the least, ns; heavy-tailed delays and stalls."""
    rng = np.random.default_rng(seed)
    frames, last = [], 0
    for true in np.arange(0.0, seconds, 1.0 / rate):
        stamp = round(S * true * (1.0 + 1e-6 * ppm)) + (step_ns if true >= step_at else 0)
        delay = rng.gamma(2.0, 0.7) + (rng.pareto(1.5) * 5.0 if rng.random() < 0.03 else 0.0)
        if true % 20.0 > 19.9:
            delay += 1e3 * (20.0 - true % 20.0)
        least = OFFSET + round(S * true) + round(1.5 * MS)
        last = max(last, least + round(MS * delay))
        frames.append((stamp, last, least))
    return frames


@pytest.mark.parametrize("ppm", [0.0, 50.0, -100.0, 1000.0])
def test_late_frames_do_not_matter_and_drift_is_followed(ppm: float) -> None:
    clock, errors = StampClock(), []
    for number, (stamp, arrival, least) in enumerate(heard(90.0, 120.0, ppm, 5)):
        clock.update(stamp, arrival)
        if number > 60 * 120:
            errors.append(abs(clock.local(stamp) - least) / MS)
    assert clock.resets == 0
    assert np.percentile(errors, 95) <= 0.1


@pytest.mark.parametrize("step_ms", [10, -10])
def test_a_clock_that_is_set_is_found_within_two_seconds(step_ms: int) -> None:
    clock, wrong = StampClock(), []
    for stamp, arrival, least in heard(70.0, 120.0, 50.0, 7, step_ms * MS, 40.3):
        clock.update(stamp, arrival)
        true = (least - OFFSET) / S
        if true > 40.3 and abs(clock.local(stamp) - least) > MS:
            wrong.append(true - 40.3)
    assert clock.resets == 1
    assert 0.0 < max(wrong) <= 2.0


@pytest.mark.parametrize("step_ms", [-150, -700])
def test_a_clock_that_is_set_back_is_followed_from_the_first_frame_whose_stamp_lies_before_the_last(
    step_ms: int,
) -> None:
    clock, wrong = StampClock(), []
    for stamp, arrival, least in heard(60.0, 120.0, 50.0, 7, step_ms * MS, 40.3):
        clock.update(stamp, arrival)
        if least > OFFSET + 40.3 * S:
            wrong.append(clock.local(stamp) - least)
    assert clock.resets == 1
    assert max(wrong) < 25 * MS  # by what the first of them was late
    assert np.mean(np.abs(wrong[120:])) < 0.2 * MS


def test_an_outage_that_ends_in_a_burst_is_no_clock_that_was_set() -> None:
    clock, until = StampClock(), OFFSET + 45 * S
    for stamp, arrival, least in heard(60.0, 120.0, 50.0, 3):
        held_up = OFFSET + 40 * S < least < until
        clock.update(stamp, max(arrival, until) if held_up else arrival)
    assert clock.resets == 0


@pytest.mark.parametrize("rate", [30.0, 120.0, 500.0])
@pytest.mark.parametrize("ppm", [50.0, 1000.0])
def test_the_bound_holds_and_is_no_empty_promise(rate: float, ppm: float) -> None:
    clock, within, bounds = StampClock(), [], []
    assert clock.bound_ns(0) == UNKNOWN_NS
    for stamp, arrival, least in heard(60.0, rate, ppm, 5):
        clock.update(stamp, arrival)
        if least > OFFSET + 10 * S:
            within.append(abs(clock.local(stamp) - least) <= clock.bound_ns(stamp))
            bounds.append(clock.bound_ns(stamp) / MS)
    assert np.mean(within) >= 0.98
    assert np.median(bounds) <= 0.5


def test_the_bound_grows_while_nothing_comes() -> None:
    clock, stamp = StampClock(), 0
    for stamp, arrival, _ in heard(40.0, 120.0, 50.0, 5):
        clock.update(stamp, arrival)
    assert clock.bound_ns(stamp) < clock.bound_ns(stamp + 60 * S) < clock.bound_ns(stamp + 600 * S)


def test_no_line_lies_above_what_arrived() -> None:
    clock = StampClock()
    for stamp, arrival, _ in heard(40.0, 100.0, 30.0, 11):
        clock.update(stamp, arrival)
        assert clock.local(stamp) <= arrival + 1


@given(st.lists(st.integers(-1000, 1000), min_size=1, max_size=20))
def test_the_edge_lies_below_every_point_and_touches(heights: list[int]) -> None:
    points = [(10 * i, y) for i, y in enumerate(heights)]
    at, value, slope = hull_edge(points)
    gaps = [y - (value + slope * (x - at)) for x, y in points]
    if len(points) > 1:
        assert min(gaps) >= -1e-9
    assert min(map(abs, gaps)) <= 1e-9


@pytest.mark.parametrize("jump", [-3300 * MS, -200 * MS, 3300 * MS])
def test_a_clock_that_is_set_in_the_first_seconds_is_followed_at_once_or_found_soon(jump: int) -> None:
    """A line that is not settled moves by what frames are late, by ms: not by that much."""
    clock = StampClock()
    steady = SteadyTime(clock)
    for stamp, arrival, _ in heard(3.0, 120.0, 0.0, 1, step_ns=jump, step_at=1.2):
        clock.update(stamp, arrival)
        last = steady.local(stamp), arrival
    assert clock.resets == 1
    assert 0 <= last[1] - last[0] < 30 * MS

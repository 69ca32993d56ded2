"""Synchrony of speeds: against correlations one by one, lags that were put in, and pseudo-pairs."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from highfive.hil.experiments.analysis.synchrony import (
    SynchronySettings,
    against_pseudo_pairs,
    lag_profile,
    synchrony,
)
from highfive.model.errors import HighFiveError

RATE = 120.0


def wandering(rng: np.random.Generator, frames: int = 240) -> np.ndarray:
    """A smooth speed that comes and goes."""
    return 1.0 + 5.0 * gaussian_filter1d(rng.standard_normal(frames), 8.0)


def test_profile_is_the_mean_of_correlations_one_by_one() -> None:
    rng = np.random.default_rng(0)
    one, other = wandering(rng, 120), wandering(rng, 120)
    settings = SynchronySettings(window=0.25, lag=0.05)
    lags, heights = lag_profile(one, other, RATE, settings)
    assert lags == pytest.approx(np.arange(-6, 7) / RATE)
    for lag, height in zip(range(-6, 7), heights, strict=True):
        starts = range(6, 120 - 30 + 1 - 6)
        r = [np.corrcoef(one[s : s + 30], other[s + lag : s + lag + 30])[0, 1] for s in starts]
        assert height == pytest.approx(np.tanh(np.mean(np.arctanh(r))))


@pytest.mark.parametrize("lag", [-20, 0, 7, 30])
def test_a_lag_that_is_put_in_is_found(lag: int) -> None:
    speed = wandering(np.random.default_rng(1), 400)
    found = synchrony(speed[50:300], speed[50 - lag : 300 - lag], RATE)
    assert found.lag == pytest.approx(lag / RATE)
    assert found.height > 0.99


def test_scale_and_offset_are_nothing_and_changed_roles_turn_the_lag() -> None:
    rng = np.random.default_rng(2)
    one, other = wandering(rng), wandering(rng)
    here, there = synchrony(one, other, RATE), synchrony(3.0 * one + 1.0, 0.2 * other, RATE)
    assert there.height == pytest.approx(here.height) and there.lag == here.lag
    base = wandering(rng, 300)
    forth, back = synchrony(base[20:260], base[10:250], RATE), synchrony(base[10:250], base[20:260], RATE)
    assert forth.lag == pytest.approx(-back.lag) == pytest.approx(10 / RATE)


def test_pairs_stand_out_from_pseudo_pairs_and_strangers_do_not() -> None:
    rng = np.random.default_rng(3)
    shared = [wandering(rng) for _ in range(12)]
    others = [speed + 0.3 * wandering(rng) for speed in shared]
    alike = [("happy", "B2")] * 6 + [("sad", "B2")] * 5 + [("sad", "A1")]
    found = against_pseudo_pairs(shared, others, alike, RATE)
    assert found[-1] is None  # nobody like it
    pairs = [one for one in found if one is not None]
    assert [one.count for one in pairs] == [5] * 6 + [4] * 5
    assert np.mean([one.share_below for one in pairs]) > 0.95
    strangers = against_pseudo_pairs(shared, [wandering(rng) for _ in shared], ["same"] * 12, RATE)
    assert np.mean([one.share_below for one in strangers if one]) == pytest.approx(0.5, abs=0.2)


def test_who_stands_still_now_and_then_is_left_out_for_so_long() -> None:
    speed = wandering(np.random.default_rng(4), 300)
    speed[:100] = 0.0
    assert synchrony(speed, speed, RATE).height == pytest.approx(1.0, abs=1e-5)
    with pytest.raises(HighFiveError, match="does not move"):
        synchrony(np.ones(240), speed[:240], RATE)


def test_what_is_too_short_or_has_gaps_is_refused() -> None:
    speed = wandering(np.random.default_rng(5))
    with pytest.raises(HighFiveError, match="100 frames at 120 Hz; expected 133 or more"):
        synchrony(speed[:100], speed, RATE)
    gone = speed.copy()
    gone[7] = np.nan
    with pytest.raises(HighFiveError, match="has gaps"):
        synchrony(speed, gone, RATE)

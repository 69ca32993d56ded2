"""The tempo of a reach: held against hands whose motion is known."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_trial, with_arm

from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.tempo import LONGEST_PAUSE, TEMPO, tempo_history
from highfive.model.hgpdm.trials import Trial

RATE = 120.0


def least_jerk(x: Array) -> Array:
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def moving(way: Array, rate: float = RATE) -> Trial:
    """A trial whose hand goes ``way`` (T,) m upwards."""
    trial = with_arm(made_up_trial(0.5, "neutral", rate, np.random.default_rng(0)))
    points = np.zeros((len(way), 2, 3))
    points[:, :, 2] = way[:, None]
    return replace(trial, rate_hz=rate, hand_points=points, arm_points=np.zeros((len(way), 3, 3)), contact_frame=-1)


@pytest.mark.parametrize("rate", [30.0, 120.0])
@pytest.mark.parametrize(("distance", "lasts"), [(0.6, 0.5), (0.6, 1.2)])
def test_it_says_since_when_how_far_and_how_fast(rate: float, distance: float, lasts: float) -> None:
    times = np.arange(0.0, 3.0, 1.0 / rate)
    trial = moving(distance * least_jerk((times - 0.5) / lasts), rate)
    at = np.array([0.4, 0.5 + 0.75 * lasts])
    before, later = tempo_history(trial, at)
    assert before.shape == (TEMPO,) and np.exp(before[0]) == pytest.approx(0.1, abs=0.01)  # it has not risen
    assert before[1] == pytest.approx(0.0, abs=0.01) and before[3] < 0.2
    since, length, mean, peak, share, ago, log_peak = later
    assert np.exp(since) - 0.1 == pytest.approx(0.75 * lasts, abs=0.2 * lasts + 0.05)
    assert length == pytest.approx(0.896 * distance, rel=0.15)
    assert peak == pytest.approx(1.875 * distance / lasts, rel=0.07)
    assert ago == pytest.approx(0.25 * lasts, abs=0.07) and log_peak == pytest.approx(np.log(peak + 0.1))
    now = (least_jerk(np.array(0.75)) - least_jerk(np.array(0.75 - 0.05 / lasts))) * lasts / 0.05
    assert share == pytest.approx(now / 1.875, abs=0.07) and mean == pytest.approx(length / np.exp(since), rel=0.01)


def test_a_hand_that_came_back_rises_anew() -> None:
    times = np.arange(0.0, 6.0, 1.0 / RATE)
    up, down, again = (least_jerk((times - begins) / 0.6) for begins in (0.5, 2.0, 4.0))
    there, elsewhere = moving(0.6 * (up - down + again)), moving(0.6 * (up - 0.7 * down + again))
    for trial in (there, elsewhere):
        first, second = tempo_history(trial, np.array([1.0, 4.5]))
        np.testing.assert_allclose(first, second, atol=0.06)
    assert times[np.argmax(tempo_history(elsewhere, times)[:, 0])] == pytest.approx(2.5 + LONGEST_PAUSE, abs=0.2)


def test_a_palm_that_is_met_goes_on_where_it_was() -> None:
    """Whoever holds a hand up for less than a second has not begun anew."""
    times = np.arange(0.0, 3.0, 1.0 / RATE)
    trial = moving(0.6 * least_jerk((times - 0.5) / 0.5))
    held = tempo_history(trial, np.array([1.3, 1.7]))
    assert np.all(np.exp(held[:, 0]) > 0.7) and np.allclose(held[:, 3], held[0, 3])


def test_who_walks_up_has_not_begun_to_reach() -> None:
    times = np.arange(0.0, 5.0, 1.0 / RATE)
    trial = moving(0.6 * least_jerk((times - 3.0) / 0.5))
    step = 1.5 * least_jerk(times / 2.5)[:, None, None] * np.array([1.0, 0.0, 0.0])
    assert trial.arm_points is not None
    walked = replace(trial, hand_points=trial.hand_points + step, arm_points=trial.arm_points + step)
    at = np.array([1.0, 2.0, 3.3])
    np.testing.assert_allclose(tempo_history(walked, at), tempo_history(trial, at), atol=1e-9)


def test_an_arm_that_swings_in_walking_rests_where_it_hangs() -> None:
    times = np.arange(0.0, 5.0, 1.0 / RATE)
    way = 0.8 * least_jerk((times - 3.0) / 0.5) - 0.6
    swings = 0.2 * np.sin(2.0 * np.pi * 0.9 * times + 1.0) * (times < 2.7)
    still, swung = moving(way), moving(way)
    swung.hand_points[:, :, 0] = swings[:, None]
    at = np.array([3.2, 3.4])
    np.testing.assert_allclose(tempo_history(swung, at), tempo_history(still, at), atol=0.05)

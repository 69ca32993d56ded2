"""Looking ahead: right where the future is certain, and as unsure as it errs where it is not."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.stats import chi2

from highfive.model.gp import sparse
from highfive.model.hgpdm.contact_layer import KNOTS, REGION, SPEEDS, ContactLayer
from highfive.model.hgpdm.contact_training import (
    approaches,
    calibration,
    fit_contact_layers,
    knuckle_speed,
    precision,
)
from highfive.model.hgpdm.dataset import KNUCKLES, hand_history
from highfive.model.hgpdm.features import fit_feature_map
from highfive.model.hgpdm.trials import Trial

RATE = 60.0
HISTORY = (0.1, 0.2)


def approach(rng: np.random.Generator, shake: float) -> Trial:
    """A hand that comes at a steady pace from one of many places, and meets a palm near the plane x = 0.

    The palm is ``shake`` m off the hand's line.
    """
    contact, frames = 90, 100
    end, speed = np.array([0.0, *rng.uniform(-0.2, 0.2, 2)]), rng.uniform(0.6, 1.4)
    way = speed * (np.arange(frames) - contact) / RATE
    line = end + way[:, None] * np.array([-1.0, 0.0, 0.3])
    hand = np.stack([line - [0.0, 0.0, 0.08], line], axis=1)
    palm = np.tile(line[contact] + shake * rng.normal(size=3), (frames, 1))
    still = np.zeros((frames, 3))
    return Trial(RATE, hand, np.zeros((frames, 6)), still, palm, line, contact, "neutral", "", 0, False)


@pytest.fixture(scope="module")
def fitted():
    def fit(shake: float, trials: int, inducing: int = 60) -> tuple[ContactLayer, list[Trial], object]:
        rng = np.random.default_rng(0)
        known = [approach(rng, shake) for _ in range(trials)]
        feature_map = fit_feature_map(approaches(known, of_hand)[0])
        layer, arm = fit_contact_layers(known, feature_map, HISTORY, inducing)
        assert arm is None  # nothing is known of it
        return layer, [approach(rng, shake) for _ in range(40)], feature_map

    return fit


def of_hand(trial: Trial, times: np.ndarray) -> np.ndarray:
    return hand_history(trial, times, HISTORY)


def test_what_is_left_leads_from_the_hand_to_the_contact() -> None:
    trial = approach(np.random.default_rng(1), 0.05)
    hands, left, number = approaches([trial, trial], of_hand)
    np.testing.assert_allclose(hands[:, 0, KNUCKLES] + left[:, :3], np.tile(trial.palm[0], (len(left), 1)), atol=1e-12)
    np.testing.assert_allclose(hands, hand_history(trial, 1.5 - left[:, 3], HISTORY))
    assert np.array_equal(np.unique(number, return_counts=True)[1], [len(left) // 2] * 2)


@pytest.mark.slow
def test_a_steady_hand_is_foreseen(fitted) -> None:
    layer, fresh, feature_map = fitted(0.0, 30)
    hands, left, _ = approaches(fresh, of_hand)
    error = np.asarray(sparse.means(layer.posterior, feature_map(hands))) - left
    assert np.median(np.linalg.norm(error[:, :3], axis=1)) < 0.02
    assert np.median(np.abs(error[:, 3])) < 0.02


@pytest.mark.slow
def test_regions_hold_what_they_promise_of_people_never_seen(fitted) -> None:
    layer, fresh, feature_map = fitted(0.03, 60)
    hands, left, _ = approaches(fresh, of_hand)
    mean = np.asarray(sparse.means(layer.posterior, feature_map(hands)))
    variance = np.asarray(sparse.variances(layer.posterior, feature_map(hands)))
    inside = []
    speeds = approaches(fresh, knuckle_speed)[0]
    for forecast, spread, truth, speed in zip(mean, variance, left, speeds, strict=True):
        _, covariance = layer.calibrated(forecast[3], speed, np.diag(spread))
        error = (forecast - truth)[:3]
        inside.append(error @ np.linalg.solve(covariance[:3, :3], error) < chi2.ppf(REGION, 3))
    assert 0.8 < np.mean(inside) <= 0.98


def test_a_frame_counts_for_less_the_further_off_its_contact_is() -> None:
    counts = precision(np.array([-0.3, 0.0, 0.05, 0.3, 0.9]))
    assert counts[0] == counts[3] == 1.0
    assert np.all(np.diff(counts[1:]) < 0.0)
    assert counts[1] == pytest.approx(49.0)  # its noise is a seventh


@pytest.mark.parametrize("true", [0.2, 1.0, 5.0])
def test_the_calibration_finds_how_wrong_a_variance_is(true: float) -> None:
    rng = np.random.default_rng(0)
    time = rng.uniform(0.0, 0.8, 20000)
    error, left = np.sqrt(true) * rng.normal(size=(20000, 4)), np.zeros((20000, 4))
    left[:, 3] = time - error[:, 3]
    found = calibration(error, np.ones((20000, 4)), left, rng.uniform(0.0, 2.0, 20000), np.arange(20000))
    np.testing.assert_allclose(found[..., 1:], true, rtol=0.3)


def test_the_calibration_finds_whose_contacts_come_later_than_forecast() -> None:
    """Slow hands 60 ms too early, quick ones 20 ms too late: the clock is set right, factors are of what is left."""
    rng, count = np.random.default_rng(0), 60000
    speed = np.exp(rng.uniform(np.log(0.05), np.log(2.4), count))
    late = np.interp(np.log(speed), np.log(SPEEDS), [0.06, 0.02, -0.02])
    error, left = 0.03 * rng.normal(size=(count, 4)), np.zeros((count, 4))
    error[:, 3] -= late
    left[:, 3] = rng.uniform(0.0, 0.8, count) - error[:, 3]
    found = calibration(error, np.full((count, 4), 9e-4), left, speed, np.arange(count))
    layer = ContactLayer(None, found)
    for knuckles, expected in zip(SPEEDS, (0.06, 0.02, -0.02), strict=True):
        time, _ = layer.calibrated(0.3, knuckles, np.eye(4))
        assert time - 0.3 == pytest.approx(expected, abs=0.012)
    assert np.all(found[:, 1, 1:] < 1.4)


def test_the_calibration_tells_quick_hands_from_slow_ones() -> None:
    """Of quick hands the place is known less well than was said, of slow ones the time."""
    rng, count = np.random.default_rng(0), 60000
    speed = np.exp(rng.uniform(np.log(0.05), np.log(2.4), count))
    wide = np.array([1.0, 4.0])
    place, clock = (np.interp(np.log(speed), np.log(SPEEDS[[0, 2]]), each) for each in (wide, wide[::-1]))
    error, left = rng.normal(size=(count, 4)) * np.column_stack([place] * 3 + [clock]), np.zeros((count, 4))
    left[:, 3] = rng.uniform(0.0, 0.8, count) - error[:, 3]
    found = np.sqrt(calibration(error, np.ones((count, 4)), left, speed, np.arange(count))[..., 1:])
    assert np.all(found[:, 0, 0] < 1.6) and np.all(found[:, 2, 0] > 3.0)
    assert np.all(found[:, 0, 1] > 3.0) and np.all(found[:, 2, 1] < 1.6)


def test_few_trials_are_not_told_apart_by_their_speed() -> None:
    """Of twenty or fewer every group has frames of all of them."""
    rng = np.random.default_rng(0)
    number = np.repeat(np.arange(12), 30)
    speed = np.repeat(np.exp(rng.uniform(np.log(0.05), np.log(2.4), 12)), 30)
    error = rng.normal(size=(360, 4)) * np.where(number == 0, 9.0, 1.0)[:, None]  # one is far off, whatever its speed
    left = np.zeros((360, 4))
    left[:, 3] = np.tile(np.linspace(0.0, 0.8, 30), 12) - error[:, 3]
    found = calibration(error, np.ones((360, 4)), left, speed, number)
    assert found.shape == (len(KNOTS), len(SPEEDS), 3) and np.all(np.isfinite(found))


def test_the_calibration_is_interpolated_in_time_and_in_the_logarithm_of_the_speed() -> None:
    rng = np.random.default_rng(0)
    layer = ContactLayer(None, rng.uniform(0.5, 4.0, (len(KNOTS), len(SPEEDS), 3)))
    known = RegularGridInterpolator((KNOTS, np.log(SPEEDS)), layer.calibration)
    for time, log_speed in rng.uniform([-0.3, np.log(0.02)], [1.2, np.log(5.0)], (200, 2)):
        speed = np.exp(log_speed)
        inside = np.clip(time, KNOTS[0], KNOTS[-1]), np.log(np.clip(speed, SPEEDS[0], SPEEDS[-1]))
        late, place, clock = known(np.array([inside]))[0]
        later, found = layer.calibrated(time, speed, np.eye(4))
        assert later == pytest.approx(time + late)
        np.testing.assert_allclose(found, np.diag([place, place, place, clock]), rtol=1e-9)
    for still, slowest in zip(*(layer.calibrated(0.2, speed, np.eye(4)) for speed in (0.0, SPEEDS[0])), strict=True):
        np.testing.assert_array_equal(still, slowest)


@pytest.mark.slow
def test_a_calibrated_covariance_is_one(fitted) -> None:
    layer = fitted(0.03, 60)[0]
    factor = np.random.default_rng(0).normal(size=(4, 4))
    for time in (-1.0, *KNOTS, 9.0):
        for speed in (0.0, *SPEEDS, 9.0):
            assert np.linalg.eigvalsh(layer.calibrated(time, speed, factor @ factor.T)[1]).min() > 0.0

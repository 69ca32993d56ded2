"""The model of a headset does what is published of headsets; a high five comes through the whole chain."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.bench.headset import DEVICES, HeadsetJob, figures, limit_of, play_headset
from highfive.hil.bench.headset_limit import ACCELERATION, JERK, SIGMA_M, SPEED, palm_limit, predicted
from highfive.hil.bench.headset_model import Device, Wearer
from highfive.hil.bench.live_people import LiveFelt
from highfive.hil.sim.people.actors import simulate_pair

FINGERTIP = 0.18 / 0.098
"""How far a fingertip is from the wrist, over the knuckle."""


@pytest.fixture(scope="module")
def motion():
    pair = simulate_pair("neutral", "B2", 0, np.random.default_rng(3))
    return pair.person, pair.contact_frame / 120.0


def test_fingertips_are_as_far_off_as_published(motion) -> None:
    """11 mm on average over people (Abdlkarim et al. 2023), if a finger goes on as the hand's bones do."""
    errors, at = [], np.arange(0.0, 2.0, 1.0 / 30.0)
    for seed in range(40):
        wearer = Wearer(motion[0], np.random.default_rng(seed))
        true, found = wearer.hands(at), wearer.measured(at)
        tips = [each[:, :, 0] + FINGERTIP * (each[:, :, 2] - each[:, :, 0]) for each in (true, found)]
        errors.append(np.linalg.norm(tips[1] - tips[0], axis=-1).mean())
    assert np.mean(errors) == pytest.approx(0.011, abs=0.002)


@pytest.mark.parametrize("device", [Device(60.0, 35.0), Device(30.0, 45.0), Device(30.0, 128.0)])
def test_hands_come_as_late_and_as_often_as_they_are_said_to(motion, device: Device) -> None:
    """By what a frame's hand lags behind the truth at the time that the frame says, by least squares."""
    person, contact = motion
    wearer = Wearer(person, np.random.default_rng(5))
    poses = wearer.poses(device, 0.5)
    new = [(holds, pose) for k, (_, holds, pose) in enumerate(poses)
           if k and not np.array_equal(pose.hands, poses[k - 1][2].hands)]  # fmt: skip
    times, wrists = np.array([holds for holds, _ in new]), np.array([pose.hands[1, 0] for _, pose in new])
    assert len(new) == pytest.approx(device.rate_hz * (poses[-1][1] - poses[0][1]), rel=0.05)
    moving = (times > contact - 0.8) & (times < contact + 0.4)
    lags = np.arange(0.0, 0.2, 0.001)

    def misfit(lag: float) -> float:
        off = wrists[moving] - wearer.hands(times[moving] - lag)[:, 1, 0]
        return float(np.square(off - off.mean(axis=0)).sum())

    late = float(lags[np.argmin([misfit(lag) for lag in lags])])
    assert late == pytest.approx(1e-3 * device.late_ms, abs=0.006)


def test_a_raised_hand_is_seen_and_a_hanging_one_is_not(motion) -> None:
    person, contact = motion
    wearer = Wearer(person, np.random.default_rng(0))
    assert wearer.seen(np.array([contact]))[0, 1]
    assert not wearer.seen(np.array([0.0]))[0].any()
    poses = wearer.poses(DEVICES["60 Hz, 35 ms"], 0.5)
    assert not poses[0][2].hands_seen.any() and all(pose.viewer_seen for _, _, pose in poses)


def test_figures_are_of_those_that_were_touched() -> None:
    felt = [LiveFelt("sad", "A1", True, 0.001 * k, 0.0, 1.0, 0.0) for k in range(1, 21)]
    found = figures([*felt, LiveFelt("sad", "A1", False, np.nan, np.nan, 1.0, 0.0)])
    assert found == {"trials": 21, "touched": 20, "true_error_mm": {"median": 10.5, "p95": 19.05}}
    assert figures([])["touched"] == 0


@pytest.mark.slow
def test_a_high_five_through_the_whole_chain_and_the_same_one_twice() -> None:
    job = HeadsetJob("neutral", "B2", 11, DEVICES["60 Hz, 35 ms"])
    felt = play_headset(job)
    assert felt.touched and felt.error < 0.03
    assert play_headset(job) == felt
    assert play_headset(replace(job, seed=12)) != felt


def test_the_limit_of_a_still_or_steady_hand_is_none_but_noise() -> None:
    """What goes on with constant acceleration is predicted; with noise it is the joint Gaussian's conditional mean."""
    times, at = np.arange(0.0, 0.5, 1.0 / 60.0), 0.55
    course = np.stack([1.0 + times, 0.5 * 3.0 * times**2, np.zeros_like(times)], axis=-1)
    np.testing.assert_allclose(predicted(times, course, at), [1.0 + at, 1.5 * at**2, 0.0], atol=2e-3)
    places = course + np.random.default_rng(0).normal(0.0, 0.01, course.shape)
    everything = np.append(times, at)
    # The white jerk's third integral, by quadrature, with the uncertain beginning: covariance of all places.
    s = (np.arange(4000) + 0.5) * at / 4000
    paths = 0.5 * np.square(np.maximum(everything[:, None] - s, 0.0))
    covariance = JERK * paths @ paths.T * at / 4000 + SIGMA_M**2
    covariance += SPEED**2 * np.outer(everything, everything)
    covariance += ACCELERATION**2 * 0.25 * np.outer(everything**2, everything**2)
    # The first place counts once, as the beginning; later ones with their own noise.
    rows = covariance[1:-1, 1:-1] + SIGMA_M**2 * np.eye(len(times) - 1)
    expected = places[0] + covariance[-1, 1:-1] @ np.linalg.solve(rows, places[1:] - places[0])
    np.testing.assert_allclose(predicted(times, places, at), expected, atol=1e-3)


@pytest.mark.slow
def test_the_limit_follows_noise_and_delay(motion) -> None:
    """Later is worse; a hand that is out of view at contact has none."""
    job = HeadsetJob("happy", "B2", 3, Device(60.0, 20.0))
    late = replace(job, device=Device(60.0, 160.0))
    seeds = range(3, 9)
    near, far = (np.mean([limit_of(replace(one, seed=seed)) for seed in seeds]) for one in (job, late))
    assert 0.002 < near < 0.02 and far > 1.5 * near
    assert np.isnan(palm_limit(Wearer(motion[0], np.random.default_rng(0)), job.device, np.zeros((200, 3)), 0.05))

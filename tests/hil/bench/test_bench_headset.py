"""The model of a headset does what is published of headsets; a high five comes through the whole chain."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.bench.headset import DEVICES, HeadsetJob, figures, play_headset
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
    felt = [LiveFelt("sad", "A1", True, 0.001 * k, 0.0, 1.0) for k in range(1, 21)]
    found = figures([*felt, LiveFelt("sad", "A1", False, np.nan, np.nan, 1.0)])
    assert found == {"trials": 21, "touched": 20, "true_error_mm": {"median": 10.5, "p95": 19.05}}
    assert figures([])["touched"] == 0


@pytest.mark.slow
def test_a_high_five_through_the_whole_chain_and_the_same_one_twice() -> None:
    job = HeadsetJob("neutral", "B2", 11, DEVICES["60 Hz, 35 ms"])
    felt = play_headset(job)
    assert felt.touched and felt.error < 0.03
    assert play_headset(job) == felt
    assert play_headset(replace(job, seed=12)) != felt

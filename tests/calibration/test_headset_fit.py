"""A headset beside a motion capture system: registered by nodding and turning, against the truth."""

import numpy as np
import pytest

from highfive.calibration.headset_fit import HAND, Track, drift, has_drifted, register_headset
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

X = rotations.from_rotation_vector([0.1, -0.2, 2.4]), np.array([0.8, -1.3, 0.02])
Y = rotations.from_rotation_vector([1.3, -0.4, 0.7]), np.array([0.06, 0.02, -0.09])


def head(seconds: float, nods: bool = True, turns: bool = True):
    """Times, quaternions and positions of eyes in a headset's space (x right, y up, z backward), 120 a second."""
    t = np.arange(0.0, seconds, 1.0 / 120.0)
    nod = 0.35 * np.sin(2.1 * t) * nods
    turn = 0.6 * np.sin(1.3 * t + 0.4) * turns
    tilt = 0.1 * np.sin(0.7 * t) * (nods and turns)
    q = rotations.multiply(
        rotations.from_axis_angle("y", turn),
        rotations.multiply(rotations.from_axis_angle("x", nod), rotations.from_axis_angle("z", tilt)),
    )
    neck = np.array([0.0, 1.55, 0.0]) + 0.02 * np.stack(
        [np.sin(0.9 * t), 0.3 * np.sin(1.7 * t), np.sin(1.1 * t)], axis=-1
    )
    return t, q, neck + rotations.rotate(q, [0.0, 0.09, -0.09])


def tracks(seconds: float = 20.0, delay: float = 0.035, seed: int = 0, noise: float = 1.0, x=X, **motion: bool):
    """Both systems' tracks of one head; the headset's poses hold for a time that is ``delay`` later."""
    rng = np.random.default_rng(seed)
    t, q, p = head(seconds, **motion)
    inverse = rotations.conjugate(Y[0])
    turned = rotations.multiply(x[0], q)
    body_q = rotations.multiply(turned, inverse)
    body_p = rotations.rotate(x[0], p) + x[1] - rotations.rotate(body_q, Y[1])

    def shaken(q, p, metres, angle):
        turn = rotations.from_rotation_vector(noise * rng.normal(0.0, angle, p.shape))
        return rotations.multiply(turn, q), p + noise * rng.normal(0.0, metres, p.shape)

    eyes = Track(t[::2] + delay, *shaken(q[::2], p[::2], 0.003, 0.005))
    return eyes, Track(t, *shaken(body_q, body_p, 0.0005, 0.002))


def hand_error(found, x=X) -> float:
    """How far a hand before the eyes comes from where it is."""
    hand = np.array([0.0, 1.6, -0.05]) + HAND
    return float(np.linalg.norm(found.apply(hand) - rotations.rotate(x[0], hand) - x[1]))


def test_without_noise_it_is_the_truth() -> None:
    found = register_headset(*tracks(noise=0.0, delay=0.0))
    assert hand_error(found) < 2e-4  # the tracks are straight from pose to pose, heads are not
    np.testing.assert_allclose(found.eyes_translation, Y[1], atol=2e-4)
    assert abs(found.delay_s) < 1e-4 and found.residual_m < 5e-4


@pytest.mark.parametrize(("seed", "delay"), [(0, -0.06), (1, 0.035), (2, 0.128)])
def test_twenty_seconds_of_nodding_and_turning_find_place_and_delay(seed: int, delay: float) -> None:
    found = register_headset(*tracks(delay=delay, seed=seed))
    assert hand_error(found) < 0.003
    assert found.delay_s == pytest.approx(delay, abs=0.004)
    assert 0.002 < found.residual_m < 0.008  # a pose's noise has three coordinates
    assert found.hand_sigma_m < 0.003


def test_it_says_how_sure_it_is() -> None:
    """Errors over their own standard deviation, over 6 draws: neither far below nor far above one."""
    ratios = []
    for seed in range(6):
        found = register_headset(*tracks(seconds=8.0, seed=100 + seed))
        ratios.append(hand_error(found) / found.hand_sigma_m)
    assert 0.4 < np.sqrt(np.mean(np.square(ratios))) < 2.5


@pytest.mark.parametrize("motion", [{"turns": False}, {"nods": False}, {"nods": False, "turns": False}])
def test_a_head_that_does_not_nod_and_turn_is_told_to(motion: dict[str, bool]) -> None:
    with pytest.raises(HighFiveError, match="nod and turn"):
        register_headset(*tracks(**motion))


def test_too_few_poses_are_refused() -> None:
    with pytest.raises(HighFiveError, match="expected 100"):
        register_headset(*tracks(seconds=1.5))


def test_drift_is_seen_and_its_absence_is_not() -> None:
    found = register_headset(*tracks())
    assert has_drifted(found, *tracks(seconds=3.0, seed=9)) == ""
    away = (rotations.multiply(rotations.from_axis_angle("z", np.radians(2.0)), X[0]), X[1] + [0.02, 0.01, 0.0])
    distance, angle = drift(found, *tracks(seconds=3.0, seed=9, x=away))
    assert distance > 0.015 and angle == pytest.approx(np.radians(2.0), abs=0.004)
    assert "register it anew" in has_drifted(found, *tracks(seconds=3.0, seed=9, x=away))

"""A hand that comes back: no jump in place or speed, soon where it is, untouched where never hidden."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.mocap_bridge.frames import HumanArm, PalmPose
from highfive.mocap_bridge.tracking.reacquisition import ReacquisitionSettings, ReacquisitionSmoother

DT = 1.0 / 120.0
HIDDEN = range(40, 76)  # frames
SLIP = np.array([0.03, -0.02, 0.01])  # m, by which the hand is guessed wrong in the end


def hand(frame: int) -> HumanArm:
    """A hand on a circle, hidden for a while, in which the guess drifts away from it."""
    angle = 2.0 * frame * DT
    palm = np.array([0.5, 0.2 * np.cos(angle), 1.4 + 0.2 * np.sin(angle)])
    velocity = 0.4 * np.array([0.0, -np.sin(angle), np.cos(angle)])
    age = 0
    if frame in HIDDEN:
        share = (frame - HIDDEN.start) / len(HIDDEN)
        palm, velocity = palm + share * SLIP, velocity + SLIP / (len(HIDDEN) * DT)
        age = round((frame - HIDDEN.start + 1) * DT * 1e9)
    wrist, knuckles = palm - np.array([0, 0, 0.07]), palm + np.array([0, 0, 0.03])
    pose = PalmPose(palm, np.array([-1.0, 0, 0]), np.array([0, 0, 1.0]), velocity)
    points = np.array([wrist, knuckles])
    still = np.zeros(3)
    return HumanArm(still, np.array([1.0, 0, 0, 0]), still, still, wrist, knuckles, pose, points, True, age, 0)


@pytest.fixture(scope="module")
def tracks() -> tuple[np.ndarray, np.ndarray]:
    """Wrist, knuckles and palm (T, 3, 3) as they come in and as they go out."""
    carry = ReacquisitionSmoother()
    arms = [hand(frame) for frame in range(140)]
    return tuple(np.array([[*a.hand_points, a.palm.position] for a in out]) for out in (arms, map(_by(carry), arms)))


def _by(carry: ReacquisitionSmoother):
    return lambda arm: carry(arm, DT)


def test_neither_place_nor_speed_jumps(tracks: tuple[np.ndarray, np.ndarray]) -> None:
    jump_in, jump_out = (np.linalg.norm(np.diff(track, n=2, axis=0), axis=-1).max() for track in tracks)
    assert jump_in > 0.5 * np.linalg.norm(SLIP)
    # A critically damped curve from rest bends by at most its first pull, w² x, with the guess's own drift on top.
    assert jump_out < ReacquisitionSettings().bandwidth ** 2 * np.linalg.norm(SLIP) * DT**2 + 2e-3


def test_it_is_soon_where_it_really_is_and_rigid(tracks: tuple[np.ndarray, np.ndarray]) -> None:
    came, went = tracks
    np.testing.assert_array_equal(went[: HIDDEN.stop], came[: HIDDEN.stop])
    off = np.linalg.norm(went - came, axis=-1)
    assert off[HIDDEN.stop + 15].max() < 1.5e-3 and off[HIDDEN.stop + 30 :].max() == 0.0
    np.testing.assert_allclose(np.diff(went, axis=1), np.diff(came, axis=1), atol=1e-12)


def test_its_velocity_is_the_derivative_of_its_place() -> None:
    carry = ReacquisitionSmoother()
    arms = [carry(hand(frame), DT) for frame in range(140)]
    places, velocities = (np.array([getattr(a.palm, name) for a in arms]) for name in ("position", "velocity"))
    middle = slice(HIDDEN.stop + 3, None)
    numeric = np.gradient(places, DT, axis=0)
    np.testing.assert_allclose(velocities[middle][:-1], numeric[middle][:-1], atol=0.05)


def test_a_hand_never_hidden_and_a_new_hand_pass_as_they_are() -> None:
    carry = ReacquisitionSmoother()
    for frame in range(30):
        arm = hand(frame)
        assert carry(arm, DT) is arm
    guessed = replace(hand(50), age_ns=10**8)
    carry(guessed, DT)
    carry.reset()
    arm = hand(90)
    assert carry(arm, DT) is arm


def test_settings_reach_it(tracks: tuple[np.ndarray, np.ndarray]) -> None:
    def after(settings: ReacquisitionSettings) -> np.ndarray:
        carry = ReacquisitionSmoother(settings)
        return np.array([carry(hand(frame), DT).palm.position for frame in range(HIDDEN.stop + 10)])[-1]

    came = tracks[0][HIDDEN.stop + 9, 2]
    slow, fast = (after(ReacquisitionSettings(bandwidth=bandwidth)) for bandwidth in (10.0, 100.0))
    assert np.linalg.norm(slow - came) > 5.0 * np.linalg.norm(fast - came)

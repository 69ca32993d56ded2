"""Between frames: cubics are met exactly, and the ends are the frames."""

import numpy as np
import pytest

from highfive.hil.trials.partners import simulated_partners
from highfive.mocap_bridge.frames import TrackedMarkers
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.interpolation import between
from highfive.mocap_bridge.tracking.tracker import Tracker

RNG = np.random.default_rng(3)
CUBIC = RNG.normal(size=(4, 5, 3))


def tracked(seconds: float) -> TrackedMarkers:
    """Five markers on a cubic of time."""
    powers = seconds ** np.arange(4)
    slopes = np.array([0.0, 1.0, 2.0 * seconds, 3.0 * seconds**2])
    count, none = 5, np.zeros(5, dtype=bool)
    return TrackedMarkers(
        tuple("abcde"), np.tensordot(powers, CUBIC, 1), np.tensordot(slopes, CUBIC, 1),
        np.tile(seconds * np.eye(3), (count, 1, 1)), ~none, np.zeros(count, dtype=np.int64), ~none, none,
        round(1e9 * seconds),
    )  # fmt: skip


@pytest.mark.parametrize("seconds", [0.1, 0.11, 0.125, 0.133])
def test_a_cubic_is_met_with_its_speed(seconds: float) -> None:
    found, true = between(tracked(0.1), tracked(0.133), round(1e9 * seconds)), tracked(seconds)
    np.testing.assert_allclose(found.positions, true.positions, atol=1e-9)
    np.testing.assert_allclose(found.velocities, true.velocities, atol=1e-7)
    np.testing.assert_allclose(found.covariances, true.covariances, atol=1e-9)


def test_the_tracker_predicts_as_it_does_where_a_frame_shows_nothing() -> None:
    """A prediction changes nothing, and is the better the shorter it is."""
    recording = simulated_partners(1, ("neutral",), ("B2",), 3)[0].recording
    tracker = Tracker(load_marker_set("paper"), 120.0)
    frames = [recording.frame(i, i, 120.0) for i in range(200)]
    hand = load_marker_set("paper").indices(("RFIN", "RMC5"))
    off = {steps: [] for steps in (1, 2, 5)}
    for i, frame in enumerate(frames[:190]):
        now = tracker.update(frame)
        if i < 20:
            continue
        np.testing.assert_array_equal(tracker.at(frame.source_time_ns - 5).age_ns, now.age_ns)
        for steps, errors in off.items():
            later = frames[i + steps]
            ahead = tracker.at(later.source_time_ns)
            assert (ahead.age_ns - now.age_ns == later.source_time_ns - frame.source_time_ns).all()
            assert not ahead.seen.any() and ahead.time_ns == later.source_time_ns
            assert (np.trace(ahead.covariances, axis1=1, axis2=2) > np.trace(now.covariances, axis1=1, axis2=2)).all()
            seen = later.valid[hand]
            errors.append(np.linalg.norm((ahead.positions - later.positions)[hand], axis=1)[seen].max(initial=0.0))
    assert np.max(off[1]) < np.max(off[2]) < np.max(off[5]) < 0.05

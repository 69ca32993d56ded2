"""A spline across a gap: exact where motion is cubic, and as unsure as white accelerations make it."""

import numpy as np
import pytest

from highfive.mocap_bridge.tracking.filter_settings import FilterSettings
from highfive.mocap_bridge.tracking.gaps import BLIND, POWER, bridged

RATE = 120.0


def with_gap(count: int, first: int, last: int) -> np.ndarray:
    seen = np.ones((count, 1), dtype=bool)
    seen[first:last] = False
    return seen


def test_cubic_motion_is_bridged_exactly() -> None:
    time = np.arange(100) / RATE
    points = np.stack([0.3 - time + 2.0 * time**3, time**2, np.ones(100)], axis=1)[:, None]
    seen = with_gap(100, 40, 76)
    filled, _ = bridged(np.where(seen[..., None], points, 0.0), seen, RATE)
    np.testing.assert_allclose(filled, points, atol=1e-10)


@pytest.mark.parametrize("gap", [1, 12, 36])
def test_its_variance_is_that_of_a_process_conditioned_on_both_ends(gap: int) -> None:
    """Integrated Brownian motion, dense: place and velocity are known before the gap, and after it."""
    span = (gap + 1) / RATE
    end = POWER * np.array([[span**3 / 3.0, span**2 / 2.0], [span**2 / 2.0, span]])
    _, variances = bridged(np.zeros((60, 1, 3)), with_gap(60, 10, 10 + gap), RATE)
    for frame in range(1, gap + 1):
        t = frame / RATE
        cross = POWER * np.array([t**2 * span / 2.0 - t**3 / 6.0, t**2 / 2.0])
        left = POWER * t**3 / 3.0 - cross @ np.linalg.solve(end, cross)
        assert variances[9 + frame, 0] == pytest.approx(3.0 * (left + FilterSettings().marker_sigma ** 2), rel=1e-6)


def test_nothing_is_said_before_a_marker_is_first_seen_and_after_it_is_last_seen() -> None:
    seen = with_gap(40, 0, 8) & with_gap(40, 30, 40)
    _, variances = bridged(np.zeros((40, 1, 3)), seen, RATE)
    assert (variances[:8] == BLIND).all() and (variances[30:] == BLIND).all()
    assert (variances[8:30] < 1e-5).all()
    for few in (0, 3):
        seen = np.zeros((40, 1), dtype=bool)
        seen[:few] = True
        assert (bridged(np.zeros((40, 1, 3)), seen, RATE)[1] == BLIND).all()

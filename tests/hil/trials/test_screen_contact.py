"""What one camera can tell of a contact."""

import numpy as np
import pytest

from highfive.hil.trials.screen_contact import across_view


def test_across_the_view_depth_does_not_count_and_the_rest_does() -> None:
    rng = np.random.default_rng(0)
    eye, hand = rng.normal(size=3), rng.normal(size=(50, 3)) + np.array([5.0, 0.0, 0.0])
    rays = (hand - eye) / np.linalg.norm(hand - eye, axis=1, keepdims=True)
    aside = np.cross(rays, rng.normal(size=(50, 3)))
    aside *= 0.03 / np.linalg.norm(aside, axis=1, keepdims=True)
    depth = rng.normal(0.0, 0.5, (50, 1))
    np.testing.assert_allclose(across_view(hand + depth * rays, hand, eye), 0.0, atol=1e-12)
    np.testing.assert_allclose(across_view(hand + depth * rays + aside, hand, eye), 0.03, atol=1e-12)
    assert across_view(hand[0] + aside[0], hand[0], eye) == pytest.approx(0.03)

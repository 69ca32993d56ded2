"""How much of a forecast is believed, against the formula as it is written."""

import numpy as np
import pytest

from highfive.model.online.contact_forecast import believed


@pytest.mark.parametrize("variance", [1e-12, 1e-4, 1.0])
def test_it_is_the_gain_of_a_kalman_update(variance: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        root, beyond = 0.1 * rng.normal(size=(3, 3)), rng.normal(size=3)
        covariance = root @ root.T + 1e-6 * np.eye(3)
        plain = variance * np.linalg.solve(variance * np.eye(3) + covariance, beyond)
        np.testing.assert_allclose(believed(beyond, variance, covariance), plain, rtol=1e-7, atol=1e-15)


def test_at_contact_nothing_of_it_is_believed() -> None:
    np.testing.assert_array_equal(believed(np.ones(3), 0.0, np.zeros((3, 3))), 0.0)

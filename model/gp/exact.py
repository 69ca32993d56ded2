"""The exact, dense Gaussian process: slow, plain, and the oracle of the sparse one."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from highfive.model.geometry.rotations import Array


def negative_log_likelihood(covariance: Array, values: Array) -> float:
    """−log N(values; 0, covariance) summed over the channels of values (N, D)."""
    factor = cho_factor(covariance, lower=True)
    log_determinant = 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
    points, channels = values.shape
    quadratic = float(np.sum(values * cho_solve(factor, values)))
    return 0.5 * (channels * (log_determinant + points * np.log(2.0 * np.pi)) + quadratic)


def predict(k_ff: Array, k_sf: Array, k_ss: Array, noise: float, values: Array) -> tuple[Array, Array]:
    """Means (S, D) and variances (S,) of the function at S points from N noisy values (N, D).

    Rasmussen & Williams 2006, eq. 2.23 and 2.24; ``k_ss`` is the diagonal (S,).
    """
    factor = cho_factor(k_ff + noise * np.eye(len(k_ff)), lower=True)
    return k_sf @ cho_solve(factor, values), k_ss - np.sum(k_sf * cho_solve(factor, k_sf.T).T, axis=1)

"""How sure a least-squares fit to a time series is, whose residuals hang together from one sample to the next."""

from __future__ import annotations

import numpy as np

from highfive.model.geometry.rotations import Array


def standard_errors(jacobian: Array, residuals: Array, of: Array, lags: int = 60) -> Array:
    """(K,) standard errors of linear functions of fitted parameters, robust to autocorrelation (Newey & West 1987).

    A model's own errors last for many samples; as if each sample were new, a fit would look too sure.

    Args:
        jacobian: (N, P) of the model.
        residuals: (N,) in the model's unit.
        of: (K, P) the functions.
        lags: samples over which residuals may hang together.
    """
    scores = jacobian * residuals[:, None]
    meat = scores.T @ scores
    for lag in range(1, min(lags, len(residuals) - 1) + 1):
        part = (1.0 - lag / (lags + 1.0)) * scores[lag:].T @ scores[:-lag]
        meat += part + part.T
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    covariance = of @ bread @ meat @ bread @ of.T
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))

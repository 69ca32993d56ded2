"""A trained layer at one input at a time, in NumPy: for one tick, calling a compiler costs more than the arithmetic."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import get_blas_funcs

from model.rotations import Array
from model.sparse import Posterior

ALL = slice(None)
(_symmetric_product,) = get_blas_funcs(("symv",))  # reads half of the matrix, and reading is what takes the time


class Predictor:
    """A :class:`model.sparse.Posterior` with all that does not depend on the input worked out.

    Attributes:
        noise: variance of the noise, in the layer's own units.
        units: (D,) variance of a channel that has unit variance in the layer's own units.
    """

    def __init__(self, posterior: Posterior) -> None:
        """Copies the posterior; later predictions use nothing but NumPy."""
        kernel, inducing = posterior.kernel, np.asarray(posterior.inducing)
        self.noise, self.units = posterior.noise.item(), np.asarray(posterior.scale) ** 2
        log_rbf, bias = kernel.log_rbf.item(), math.exp(kernel.log_bias.item())
        self._own, self._size = math.exp(log_rbf) + bias, len(inducing)
        precision, variances = np.exp(-2.0 * np.asarray(kernel.log_lengthscale)), np.exp(np.asarray(kernel.log_linear))
        # The squared distance is expanded, so that both kernels are one product with the input. (Here and below,
        # ``dot`` takes half the time of ``@`` at these sizes.)
        self._directions = np.concatenate([inducing * precision, inducing * variances])
        self._constants = np.concatenate([log_rbf - 0.5 * inducing**2 @ precision, np.full(self._size, bias)])
        self._squares = np.stack([0.5 * precision, variances])
        self._towards = np.concatenate([inducing * precision, np.ones((self._size, 1))], axis=1)
        self._along, self._precision = inducing * variances, precision
        self._weights = np.ascontiguousarray(np.asarray(posterior.weights).T)
        self._lines = self._weights @ self._along
        reduction = np.asarray(posterior.reduction)
        self._offset, self._reduction = np.asarray(posterior.offset), np.asfortranarray(0.5 * (reduction + reduction.T))
        self._style = self._between = None
        if posterior.style is not None and posterior.style_covariance is not None:
            self._style, self._between = np.asarray(posterior.style), np.asarray(posterior.style_covariance)

    def __call__(self, point: Array, style: Array | None = None) -> Prediction:
        """The layer at one input (q,) and, where the layer has styles, style weights (K,)."""
        parts = self._directions.dot(point)
        parts += self._constants
        rbf, lines = parts[: self._size], parts[self._size :]
        half, along = self._squares.dot(point * point).tolist()
        rbf -= half
        np.exp(rbf, out=rbf)
        own, share = self._own + along, None
        if self._style is not None and self._between is not None:
            assert style is not None
            share = self._style.dot(style)
            rbf *= share
            lines *= share
            own *= float(style.dot(self._between.dot(style)))
        vector = rbf + lines
        mean = self._weights.dot(vector)
        mean += self._offset
        return Prediction(self, mean, point, vector, rbf, share, own)

    def slope(self, prediction: Prediction, channels: slice) -> Array:
        """Derivative (D', q) of some channels of the mean: the RBFs' pull to the inducing inputs, and the lines."""
        weights = self._weights[channels]
        pull = (weights * prediction.rbf).dot(self._towards)
        slope = pull[:, :-1] - pull[:, -1:] * (self._precision * prediction.point)
        if prediction.share is None:
            slope += self._lines[channels]
        else:
            slope += (weights * prediction.share).dot(self._along)
        return slope

    def variance(self, prediction: Prediction) -> float:
        """Variance of the function, in the layer's own units."""
        vector = prediction.vector
        return max(prediction.own - float(vector.dot(_symmetric_product(1.0, self._reduction, vector))), 0.0)


class Prediction(NamedTuple):
    """What a layer says at one input; all but the mean is worked out when asked for.

    Attributes:
        predictor: whose prediction it is.
        mean: (D,).
        point: (q,) the input.
        vector: (M,) covariance of the input with the inducing inputs.
        rbf: (M,) the RBF kernel's part of it.
        share: (M,) factor by the style, or None.
        own: variance before anything was learned.
    """

    predictor: Predictor
    mean: Array
    point: Array
    vector: Array
    rbf: Array
    share: Array | None
    own: float

    def slope(self, channels: slice = ALL) -> Array:
        """Derivative (D', q) of the mean, of all channels or of some."""
        return self.predictor.slope(self, channels)

    def variance(self) -> float:
        """Variance of the function, in the layer's own units."""
        return self.predictor.variance(self)

    def doubt(self, channels: slice = ALL) -> Array:
        """Variances (D',) of the channels at this very input, noise included."""
        return (self.variance() + self.predictor.noise) * self.predictor.units[channels]

    def variances(self, spread: Array, channels: slice = ALL) -> Array:
        """Variances (D',) of the channels, noise included, if the input has covariance ``spread`` (q, q)."""
        slope = self.slope(channels)
        return (slope.dot(spread) * slope).sum(axis=1) + self.doubt(channels)

    def covariance(self, spread: Array, repeats: float = 1.0) -> Array:
        """Covariance (D, D) of the channels, their doubt times ``repeats``, if the input has covariance ``spread``."""
        slope = self.slope()
        covariance = slope.dot(spread).dot(slope.T)
        diagonal = covariance.reshape(-1)[:: len(covariance) + 1]
        diagonal += repeats * self.doubt()
        return covariance

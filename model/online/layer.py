"""Posterior of one Gaussian process layer at one point, with its derivative, and how a belief goes through it."""

from __future__ import annotations

import math

import numpy as np

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array


@compiled
def times_transposed(a: Array, b: Array) -> Array:
    """a · bᵀ for (A, N) and (B, N)."""
    result = np.empty((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            total = 0.0
            for k in range(a.shape[1]):
                total += a[i, k] * b[j, k]
            result[i, j] = total
    return result


@compiled
def times(a: Array, b: Array) -> Array:
    """a · b for (A, N) and (N, N), which may be the upper left part of a larger matrix."""
    size = a.shape[1]
    result = np.zeros((a.shape[0], size))
    for i in range(a.shape[0]):
        for k in range(size):
            for j in range(size):
                result[i, j] += a[i, k] * b[k, j]
    return result


@compiled
def times_vector(a: Array, b: Array) -> Array:
    """a · b for (A, N) and (N,)."""
    result = np.empty(a.shape[0])
    for i in range(a.shape[0]):
        total = 0.0
        for k in range(a.shape[1]):
            total += a[i, k] * b[k]
        result[i] = total
    return result


@compiled_entry
def predict_layer(layer: Array, point: Array, style: Array, sloped: bool = True) -> tuple[Array, Array, Array]:
    """A layer at one input and style: mean (D,), its derivative (D, q), and variances (D,), noise included.

    Args:
        layer: as :func:`highfive.model.online.belief.packed`; other layers may follow.
        point: (q,); what follows after the first q numbers is not read.
        style: (K,) weights.
        sloped: work out the derivative, which takes most of the time; else it is (D, 0).
    """
    dims, size, styles, channels = int(layer[1]), int(layer[2]), int(layer[3]), int(layer[4])
    log_rbf, bias, begin = layer[5], layer[6], 7
    precision, begin = layer[begin:], begin + dims
    linear, begin = layer[begin:], begin + dims
    offset, begin = layer[begin:], begin + channels
    units, begin = layer[begin:], begin + channels
    noise, begin = layer[begin:], begin + channels
    between, begin = layer[begin:], begin + styles * styles
    inducing, begin = layer[begin:], begin + dims * size
    lines, begin = layer[begin:], begin + dims * size
    shares, begin = layer[begin:], begin + styles * size
    weights, reduction = layer[begin:], layer[begin + channels * size :]

    share, own = style_covariance(style, shares, between, size)
    slopes = dims if sloped else 0
    towards = _covariances(point, share, log_rbf, bias, precision, inducing, lines, dims, slopes)
    prior = math.exp(log_rbf) + bias
    for j in range(dims):
        prior += linear[j] * point[j] * point[j]
    variance = max(own * prior - _quadratic(reduction, towards[0]), 0.0)
    mean, slope, variances = np.empty(channels), np.empty((channels, slopes)), np.empty(channels)
    for d in range(channels):
        variances[d] = (variance + noise[d]) * units[d]
        own_weights = weights[d * size : (d + 1) * size]
        total = 0.0
        for m in range(size):
            total += own_weights[m] * towards[0, m]
        mean[d] = offset[d] + total
        for j in range(0, slopes - 3, 4):  # four at a time: a weight is read once for all of them
            _four(own_weights, towards, j, slope[d])
        for j in range(slopes - slopes % 4, slopes):
            total = 0.0
            for m in range(size):
                total += own_weights[m] * towards[1 + j, m]
            slope[d, j] = total
    return mean, slope, variances


@compiled
def layer_mean(layer: Array, point: Array, style: Array) -> Array:
    """The mean (D,) alone; see :func:`predict_layer`."""
    dims, size, styles, channels = int(layer[1]), int(layer[2]), int(layer[3]), int(layer[4])
    log_rbf, bias, begin = layer[5], layer[6], 7 + 2 * dims
    precision, offset, begin = layer[7:], layer[begin:], begin + 3 * channels
    between, begin = layer[begin:], begin + styles * styles
    inducing, begin = layer[begin:], begin + dims * size
    lines, begin = layer[begin:], begin + dims * size
    shares, weights = layer[begin:], layer[begin + styles * size :]

    share, _ = style_covariance(style, shares, between, size)
    rbf, towards = np.full(size, log_rbf), np.full(size, bias)
    for j in range(dims):
        half = 0.5 * precision[j]
        for m in range(size):
            away = point[j] - inducing[j * size + m]
            rbf[m] -= half * away * away
            towards[m] += point[j] * lines[j * size + m]
    for m in range(size):
        towards[m] = share[m] * (towards[m] + math.exp(rbf[m]))
    mean = np.empty(channels)
    for d in range(channels):
        own_weights = weights[d * size : (d + 1) * size]
        total = 0.0
        for m in range(size):
            total += own_weights[m] * towards[m]
        mean[d] = offset[d] + total
    return mean


@compiled
def _four(weights: Array, towards: Array, first: int, slope: Array) -> None:
    """Four entries of a row of the slope (q,), from ``first`` on: weights (M,) times rows of ``towards`` (1 + q, M)."""
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for m in range(len(weights)):
        weight = weights[m]
        a += weight * towards[1 + first, m]
        b += weight * towards[2 + first, m]
        c += weight * towards[3 + first, m]
        d += weight * towards[4 + first, m]
    slope[first], slope[first + 1], slope[first + 2], slope[first + 3] = a, b, c, d


@compiled
def style_covariance(style: Array, shares: Array, between: Array, size: int) -> tuple[Array, float]:
    """Factors by the style: of the covariance with each inducing input (M,), and of the variance."""
    share, own = np.zeros(size), 0.0
    for k in range(len(style)):
        for m in range(size):
            share[m] += style[k] * shares[k * size + m]
        for n in range(len(style)):
            own += style[k] * between[k * len(style) + n] * style[n]
    return share, own


@compiled
def _covariances(
    point: Array, share: Array, log_rbf: float, bias: float, precision: Array, inducing: Array, lines: Array, dims: int,
    slopes: int,
) -> Array:  # fmt: skip
    """Covariance (1 + S, M) with the inducing inputs in row 0; in row 1 + j its derivative by input j, of the first
    S."""
    size = len(share)
    towards, rbf = np.full((slopes + 1, size), bias), np.full(size, log_rbf)
    for j in range(dims):
        half = 0.5 * precision[j]
        for m in range(size):
            away = point[j] - inducing[j * size + m]
            rbf[m] -= half * away * away
            towards[0, m] += point[j] * lines[j * size + m]
    for m in range(size):
        rbf[m] = math.exp(rbf[m]) * share[m]
        towards[0, m] = towards[0, m] * share[m] + rbf[m]
    for j in range(slopes):
        for m in range(size):
            away = point[j] - inducing[j * size + m]
            towards[1 + j, m] = lines[j * size + m] * share[m] - precision[j] * away * rbf[m]
    return towards


@compiled
def _quadratic(triangle: Array, vector: Array) -> float:
    """Quadratic form of a packed lower triangle: half of a matrix is read, and reading is what takes the time."""
    result, begin = 0.0, 0
    for i in range(len(vector)):
        total = 0.0
        for j in range(i + 1):
            total += triangle[begin + j] * vector[j]
        result += total * vector[i]
        begin += i + 1
    return result


@compiled
def propagated_variance(slope: Array, covariance: Array, variances: Array, repeats: float) -> Array:
    """Covariance (D, D) of channels with variances ``variances`` (D,) of their own, counted ``repeats`` times.

    Their input (q,) has the upper left part of ``covariance``.
    """
    result = times_transposed(times(slope, covariance), slope)
    for d in range(len(variances)):
        result[d, d] += repeats * variances[d]
    return result


@compiled
def propagated_deviations(slope: Array, covariance: Array, first: int, variances: Array) -> Array:
    """Standard deviations (D,) of channels; their input's covariance begins at ``first`` on the diagonal."""
    result = np.empty(len(variances))
    for d in range(len(variances)):
        total = variances[d]
        for i in range(slope.shape[1]):
            for j in range(slope.shape[1]):
                total += slope[d, i] * covariance[first + i, first + j] * slope[d, j]
        result[d] = math.sqrt(total)
    return result

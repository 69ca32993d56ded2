"""Cholesky factor and solution of small systems, compiled."""

from __future__ import annotations

import math

import numpy as np

from highfive.model.compiled import compiled
from highfive.model.geometry.rotations import Array


@compiled
def cholesky(matrix: Array, lower: Array) -> bool:
    """Writes the Cholesky factor of a symmetric matrix (n, n) into ``lower``; False where it is not positive."""
    count = len(matrix)
    for j in range(count):
        for i in range(j, count):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                lower[i, i] = math.sqrt(total)
            else:
                lower[i, j] = total / lower[j, j]
    return True


@compiled
def cholesky_solve(lower: Array, vector: Array) -> None:
    """Replaces a vector by the solution of the factored system."""
    count = len(vector)
    for i in range(count):
        for k in range(i):
            vector[i] -= lower[i, k] * vector[k]
        vector[i] /= lower[i, i]
    for back in range(count):
        i = count - 1 - back
        for k in range(i + 1, count):
            vector[i] -= lower[k, i] * vector[k]
        vector[i] /= lower[i, i]


@compiled
def cholesky_inverse(lower: Array) -> Array:
    """Inverse of the matrix whose Cholesky factor is ``lower``."""
    n = len(lower)
    half = np.zeros((n, n))  # row j: column j of the inverse factor
    for j in range(n):
        half[j, j] = 1.0 / lower[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total += lower[i, k] * half[j, k]
            half[j, i] = -total / lower[i, i]
    result = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += half[i, k] * half[j, k]
            result[i, j] = result[j, i] = total
    return result


@compiled
def product(a: Array, b: Array) -> Array:
    """a · b for (n, n)."""
    n = len(a)
    result = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            f = a[i, k]
            if f != 0.0:
                for j in range(n):
                    result[i, j] += f * b[k, j]
    return result


@compiled
def product_transposed(a: Array, b: Array) -> Array:
    """a · bᵀ for (n, n)."""
    n = len(a)
    result = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += a[i, k] * b[j, k]
            result[i, j] = total
    return result


@compiled
def determinant(a: Array) -> float:
    """Determinant of a symmetric matrix (3, 3)."""
    x, y = a[1, 1] * a[2, 2] - a[1, 2] ** 2, a[0, 1] * a[2, 2] - a[0, 2] * a[1, 2]
    return a[0, 0] * x - a[0, 1] * y + a[0, 2] * (a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1])


@compiled
def precision_of(out: Array, extra: float) -> None:
    """Inverse, in place, of a covariance (3, 3) with ``extra`` on its diagonal."""
    a, b, c = out[0, 0] + extra, out[0, 1], out[0, 2]
    d, e, f = out[1, 1] + extra, out[1, 2], out[2, 2] + extra
    x, y, z = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1.0 / (a * x + b * y + c * z)
    out[0, 0], out[0, 1], out[0, 2] = scale * x, scale * y, scale * z
    out[1, 0], out[1, 1], out[1, 2] = scale * y, scale * (a * f - c * c), scale * (b * c - a * e)
    out[2, 0], out[2, 1], out[2, 2] = scale * z, scale * (b * c - a * e), scale * (a * d - b * b)


@compiled
def squared_distance(precision: Array, gap: Array) -> float:
    """Squared Mahalanobis distance of a gap (3,)."""
    total = 0.0
    for i in range(3):
        for k in range(3):
            total += gap[i] * precision[i, k] * gap[k]
    return total

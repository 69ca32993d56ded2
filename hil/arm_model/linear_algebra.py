"""Cholesky factor and solution of small systems, compiled."""

from __future__ import annotations

import math

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

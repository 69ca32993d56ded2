"""Kernels of the distance of two inputs, and that distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import jax
import jax.numpy as jnp

from highfive.model.gp.kernels.kernel import Kernel


@dataclass(frozen=True, eq=False)
class Stationary(Kernel):
    """A function of Σ (x − z)² / lengthscale² times a variance; a subclass says which.

    Attributes:
        log_lengthscale: (q,) in units of the inputs.
        log_variance: ().
    """

    log_lengthscale: jax.Array
    log_variance: jax.Array

    @classmethod
    def initial(cls, dims: int) -> Self:
        """Lengthscales √q, the distance of two points of unit variance per dimension; unit variance."""
        return cls(jnp.full(dims, 0.5 * jnp.log(dims)), jnp.zeros(()))


def half_square_distance(x: jax.Array, z: jax.Array, log_lengthscale: jax.Array) -> jax.Array:
    """½ Σ (x − z)² / lengthscale² of inputs (q,), at least 0.

    Expanded, so that the large part of a batch of pairs is a matrix product, forwards and in the gradient; rounding may
    make the expanded form slightly negative.
    """
    inverse = jnp.exp(-log_lengthscale)
    x_scaled, z_scaled = x * inverse, z * inverse
    half = 0.5 * (x_scaled @ x_scaled) + 0.5 * (z_scaled @ z_scaled) - x_scaled @ z_scaled
    return jnp.maximum(half, 0.0)

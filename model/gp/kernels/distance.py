"""The distance that stationary kernels are functions of."""

from __future__ import annotations

import jax
import jax.numpy as jnp


def half_square_distance(x: jax.Array, z: jax.Array, log_lengthscale: jax.Array) -> jax.Array:
    """½ Σ (x − z)² / lengthscale² of inputs (q,), at least 0.

    Expanded, so that the large part of a batch of pairs is a matrix product, forwards and in the gradient; rounding may
    make the expanded form slightly negative.
    """
    inverse = jnp.exp(-log_lengthscale)
    x_scaled, z_scaled = x * inverse, z * inverse
    half = 0.5 * (x_scaled @ x_scaled) + 0.5 * (z_scaled @ z_scaled) - x_scaled @ z_scaled
    return jnp.maximum(half, 0.0)

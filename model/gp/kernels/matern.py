"""The Matérn kernel of smoothness 5/2."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from highfive.model.gp.kernels.kernel import register_kernel
from highfive.model.gp.kernels.stationary import Stationary, half_square_distance

SMALLEST = 1e-30  # squared distance below which the root, whose slope is infinite at 0, is not taken


@register_kernel
class Matern52(Stationary):
    """k(x, z) = variance · (1 + √5 r + 5/3 r²) exp(−√5 r), r² = Σ (x−z)² / lengthscale².

    Functions that can be differentiated twice: rougher than those of an RBF (Rasmussen & Williams 2006, eq. 4.17).
    """

    def pair(self, x: jax.Array, z: jax.Array) -> jax.Array:
        """k(x, z)."""
        square = 2.0 * half_square_distance(x, z, self.log_lengthscale)
        root = jnp.sqrt(5.0 * jnp.maximum(square, SMALLEST))
        return jnp.exp(self.log_variance - root) * (1.0 + root + 5.0 / 3.0 * square)

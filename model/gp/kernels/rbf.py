"""The squared exponential kernel."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from highfive.model.gp.kernels.kernel import register_kernel
from highfive.model.gp.kernels.stationary import Stationary, half_square_distance


@register_kernel
class RBF(Stationary):
    """k(x, z) = variance · exp(−½ Σ (x−z)² / lengthscale²): smooth functions (Rasmussen & Williams 2006, eq. 4.9)."""

    def pair(self, x: jax.Array, z: jax.Array) -> jax.Array:
        """k(x, z)."""
        return jnp.exp(self.log_variance - half_square_distance(x, z, self.log_lengthscale))

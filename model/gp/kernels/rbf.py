"""The squared exponential kernel."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from highfive.model.gp.kernels.distance import half_square_distance
from highfive.model.gp.kernels.kernel import Kernel, register_kernel


@register_kernel
class RBF(Kernel):
    """k(x, z) = variance · exp(−½ Σ (x−z)² / lengthscale²): smooth functions (Rasmussen & Williams 2006, eq. 4.9).

    Attributes:
        log_lengthscale: (q,) in units of the inputs.
        log_variance: ().
    """

    log_lengthscale: jax.Array
    log_variance: jax.Array

    @classmethod
    def initial(cls, dims: int) -> RBF:
        """Lengthscales √q, the distance of two points of unit variance per dimension; unit variance."""
        return RBF(jnp.full(dims, 0.5 * jnp.log(dims)), jnp.zeros(()))

    def pair(self, x: jax.Array, z: jax.Array) -> jax.Array:
        """k(x, z)."""
        return jnp.exp(self.log_variance - half_square_distance(x, z, self.log_lengthscale))

"""The linear kernel."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from highfive.model.gp.kernels.kernel import Kernel, register_kernel


@register_kernel
class Linear(Kernel):
    """k(x, z) = Σ variance · x z: linear functions through the origin (Rasmussen & Williams 2006, eq. 2.25).

    Attributes:
        log_variance: (q,) logarithm of the variance of each input's slope.
    """

    log_variance: jax.Array

    @classmethod
    def initial(cls, dims: int) -> Linear:
        """Unit variances."""
        return Linear(jnp.zeros(dims))

    def pair(self, x: jax.Array, z: jax.Array) -> jax.Array:
        """k(x, z)."""
        return (x * jnp.exp(self.log_variance)) @ z

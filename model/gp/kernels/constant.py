"""The constant kernel."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from highfive.model.gp.kernels.kernel import Kernel, register_kernel


@register_kernel
class Constant(Kernel):
    """k(x, z) = variance: an unknown offset; as a factor, the scale of another kernel.

    Attributes:
        log_variance: ().
    """

    log_variance: jax.Array

    @classmethod
    def initial(cls, dims: int) -> Constant:
        """Unit variance, whatever the inputs."""
        return Constant(jnp.zeros(()))

    def pair(self, x: jax.Array, z: jax.Array) -> jax.Array:
        """k(x, z)."""
        return jnp.exp(self.log_variance)

"""The kernel of the model's layers: RBF + linear + constant in one, with a derivative of its own."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from highfive.model.gp.kernels.kernel import Kernel, register_kernel
from highfive.model.gp.kernels.stationary import half_square_distance


@register_kernel
class MotionKernel(Kernel):
    """k(x, z) = rbf · exp(−½ Σ (x−z)² / lengthscale²) + Σ linear · x z + bias (Taubert et al. 2013, RBF + linear).

    The same function as ``RBF + Linear + Constant``; the training and the compiled tick know this one.

    Attributes:
        log_lengthscale: (q,) in units of the inputs.
        log_rbf: () logarithm of the RBF variance.
        log_linear: (q,) logarithm of the linear variance of each input.
        log_bias: () logarithm of the constant variance.
    """

    log_lengthscale: jax.Array
    log_rbf: jax.Array
    log_linear: jax.Array
    log_bias: jax.Array

    @classmethod
    def initial(cls, dims: int) -> MotionKernel:
        """Lengthscales √q, the distance of two points of unit variance per dimension; linear and constant a tenth."""
        return motion_kernel(jnp.full(dims, np.sqrt(dims)))

    def pair(self, x: jax.Array, z: jax.Array) -> jax.Array:
        """k(x, z)."""
        rbf = jnp.exp(self.log_rbf - half_square_distance(x, z, self.log_lengthscale))
        return rbf + (x * jnp.exp(self.log_linear)) @ z + jnp.exp(self.log_bias)

    def cross(self, a: jax.Array, b: jax.Array) -> jax.Array:
        """Covariance (A, B) of inputs (A, q) and (B, q), with the derivative of :func:`_cross_backward`."""
        return _cross(self, a, b)

    def diagonal(self, a: jax.Array) -> jax.Array:
        """Variances (A,) of inputs (A, q)."""
        return jnp.exp(self.log_rbf) + a**2 @ jnp.exp(self.log_linear) + jnp.exp(self.log_bias)


def motion_kernel(lengthscale: jax.Array, rbf: float = 1.0, linear: float = 0.1, bias: float = 0.1) -> MotionKernel:
    """A kernel from positive parameters; ``lengthscale`` is (q,)."""
    lengthscale = jnp.asarray(lengthscale, dtype=float)
    return MotionKernel(
        jnp.log(lengthscale),
        jnp.log(jnp.asarray(rbf, dtype=float)),
        jnp.full(lengthscale.shape, jnp.log(linear)),
        jnp.log(jnp.asarray(bias, dtype=float)),
    )


_Kept = tuple[MotionKernel, jax.Array, jax.Array, jax.Array]
"""What the derivative needs of the covariance: its kernel, both inputs and the RBF part (A, B)."""


@jax.custom_vjp
def _cross(kernel: MotionKernel, a: jax.Array, b: jax.Array) -> jax.Array:
    return _cross_forward(kernel, a, b)[0]


def _cross_forward(kernel: MotionKernel, a: jax.Array, b: jax.Array) -> tuple[jax.Array, _Kept]:
    inverse = jnp.exp(-kernel.log_lengthscale)
    a_scaled, b_scaled = a * inverse, b * inverse
    # ½ squared distance, expanded so that the large part is a matrix product; rounding may make it slightly negative.
    half = 0.5 * jnp.sum(a_scaled**2, 1)[:, None] + 0.5 * jnp.sum(b_scaled**2, 1) - a_scaled @ b_scaled.T
    rbf = jnp.exp(kernel.log_rbf - jnp.maximum(half, 0.0))
    linear = (a * jnp.exp(kernel.log_linear)) @ b.T
    return rbf + linear + jnp.exp(kernel.log_bias), (kernel, a, b, rbf)


def _cross_backward(kept: _Kept, cotangent: jax.Array) -> tuple[MotionKernel, jax.Array, jax.Array]:
    """Two elementwise passes and thin products: the differences a − b are never formed."""
    kernel, a, b, rbf = kept
    weighted = cotangent * rbf
    inverse_square, linear = jnp.exp(-2.0 * kernel.log_lengthscale), jnp.exp(kernel.log_linear)
    to_b, to_a = jnp.sum(weighted, axis=0)[:, None], jnp.sum(weighted, axis=1)[:, None]
    near_a, near_b = weighted @ b, weighted.T @ a
    plain_a = cotangent @ b
    squares = jnp.sum(to_a * a**2, 0) - 2.0 * jnp.sum(a * near_a, 0) + jnp.sum(to_b * b**2, 0)
    to_kernel = MotionKernel(
        squares * inverse_square,
        jnp.sum(to_a),
        jnp.sum(a * plain_a, 0) * linear,
        jnp.sum(cotangent) * jnp.exp(kernel.log_bias),
    )
    return (
        to_kernel,
        (near_a - to_a * a) * inverse_square + plain_a * linear,
        (near_b - to_b * b) * inverse_square + (cotangent.T @ a) * linear,
    )


_cross.defvjp(_cross_forward, _cross_backward)

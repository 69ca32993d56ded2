"""Covariance functions: RBF + linear + bias over motion, and a coregionalisation over styles.

All parameters are kept unconstrained (logarithms), so that any real vector is a valid kernel.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)  # the Cholesky factors of these models need double precision

JITTER = 1e-6  # added to the diagonal of an inducing covariance, relative to its mean


class MotionKernel(NamedTuple):
    """k(x, z) = rbf · exp(−½ Σ (x−z)² / lengthscale²) + Σ linear · x z + bias (Taubert et al. 2013, RBF + linear).

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


class StyleFactor(NamedTuple):
    """k(e, e') = eᵀ B e' with B = L Lᵀ scaled to a mean diagonal of 1.

    Positive semi-definite for any e. It is the covariance of f(x, e) = Σ_k e_k f_k(x): a mixture of styles generates
    the same mixture of motions, so mixing is continuous and well defined.

    Attributes:
        factor: (K, K) L; only its product with its transpose matters.
        inducing: (M, K) style weights of the inducing inputs; they need not lie on the simplex.
    """

    factor: jax.Array
    inducing: jax.Array


def motion_kernel(lengthscale: jax.Array, rbf: float = 1.0, linear: float = 0.1, bias: float = 0.1) -> MotionKernel:
    """A kernel from positive parameters; ``lengthscale`` is (q,)."""
    lengthscale = jnp.asarray(lengthscale, dtype=float)
    return MotionKernel(
        jnp.log(lengthscale),
        jnp.log(jnp.asarray(rbf, dtype=float)),
        jnp.full(lengthscale.shape, jnp.log(linear)),
        jnp.log(jnp.asarray(bias, dtype=float)),
    )


@jax.custom_vjp
def cross(kernel: MotionKernel, a: jax.Array, b: jax.Array) -> jax.Array:
    """Covariance (A, B) of inputs (A, q) and (B, q)."""
    return _cross_forward(kernel, a, b)[0]


def _cross_forward(kernel: MotionKernel, a: jax.Array, b: jax.Array) -> tuple[jax.Array, tuple]:
    inverse = jnp.exp(-kernel.log_lengthscale)
    a_scaled, b_scaled = a * inverse, b * inverse
    # ½ squared distance, expanded so that the large part is a matrix product; rounding may make it slightly negative.
    half = 0.5 * jnp.sum(a_scaled**2, 1)[:, None] + 0.5 * jnp.sum(b_scaled**2, 1) - a_scaled @ b_scaled.T
    rbf = jnp.exp(kernel.log_rbf - jnp.maximum(half, 0.0))
    linear = (a * jnp.exp(kernel.log_linear)) @ b.T
    return rbf + linear + jnp.exp(kernel.log_bias), (kernel, a, b, rbf)


def _cross_backward(kept: tuple, cotangent: jax.Array) -> tuple[MotionKernel, jax.Array, jax.Array]:
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


cross.defvjp(_cross_forward, _cross_backward)


def diagonal(kernel: MotionKernel, a: jax.Array) -> jax.Array:
    """Variances (A,) of inputs (A, q)."""
    return jnp.exp(kernel.log_rbf) + a**2 @ jnp.exp(kernel.log_linear) + jnp.exp(kernel.log_bias)


def style_covariance(style: StyleFactor) -> jax.Array:
    """B (K, K): covariance of the K styles, mean diagonal 1."""
    product = style.factor @ style.factor.T
    return product * (product.shape[0] / jnp.trace(product))


def initial_style(styles: int, inducing_style: jax.Array) -> StyleFactor:
    """Styles that start half shared, half their own; ``inducing_style`` is (M, K)."""
    covariance = 0.5 * jnp.ones((styles, styles)) + 0.5 * jnp.eye(styles)
    return StyleFactor(jnp.linalg.cholesky(covariance), jnp.asarray(inducing_style, dtype=float))


def add_jitter(covariance: jax.Array) -> jax.Array:
    """The covariance (M, M) with a small multiple of its mean diagonal added to the diagonal."""
    size = covariance.shape[0]
    return covariance + (JITTER * jnp.trace(covariance) / size) * jnp.eye(size)

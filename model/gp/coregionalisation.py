"""The covariance of styles: a factor beside the kernel over motion."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp


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


def style_covariance(style: StyleFactor) -> jax.Array:
    """B (K, K): covariance of the K styles, mean diagonal 1."""
    product = style.factor @ style.factor.T
    return product * (product.shape[0] / jnp.trace(product))


def initial_style(styles: int, inducing_style: jax.Array) -> StyleFactor:
    """Styles that start half shared, half their own; ``inducing_style`` is (M, K)."""
    covariance = 0.5 * jnp.ones((styles, styles)) + 0.5 * jnp.eye(styles)
    return StyleFactor(jnp.linalg.cholesky(covariance), jnp.asarray(inducing_style, dtype=float))

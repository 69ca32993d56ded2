"""The DTC likelihood and its variational bound over blocks of points, with its own derivative.

With L Lᵀ = K_uu, B = L⁻¹ K_uf and A = I + β B Bᵀ all that grows with N are three products of M × M with M × N: B, B Bᵀ
and one in the gradient. Plain autodiff would go back through Cholesky factors and triangular solves instead.

- The points pass in blocks that stay in the cache, and nothing of size M × N is ever kept: working out K_uf and B again
  for the gradient costs less than fresh memory for them, and the memory needed does not grow with N.
- The value is a scalar, so the gradient is worked out with it and only scaled afterwards.
- B is formed rather than L⁻¹ (K_uf K_fu) L⁻ᵀ, which would save a product: there rounding is magnified by the condition
  of K_uu (1e6 and more), here only by its root, and sums over the points in another order give the same value.

Sources: Titsias 2009, eq. 9; Hensman et al. 2013, appendix, for the form through A.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular

BLOCK = 1024  # points; a block of K_uf with 200 inducing inputs takes 1.6 MB


class Covariance(NamedTuple):
    """Covariances as functions of a tree of parameters.

    Attributes:
        inducing: from parameters to K_uu (M, M), jitter included.
        cross: from parameters, inputs (n, q) and styles (n, K) or None to K_uf (M, n) and the diagonal of K_ff (n,).
    """

    inducing: Callable[[Any], jax.Array]
    cross: Callable[[Any, jax.Array, jax.Array | None], tuple[jax.Array, jax.Array]]


class Form(NamedTuple):
    """What the likelihood is of, apart from numbers that it has derivatives by.

    Attributes:
        covariance: the covariance functions.
        channels: number D of channels of Y.
        variational: whether to add (tr K_ff − tr Q) D / (2 noise).
        shards: equal parts of the points that are summed up separately, one per device.
    """

    covariance: Covariance
    channels: int
    variational: bool
    shards: int


class Points(NamedTuple):
    """What the likelihood sees of the points.

    Attributes:
        inputs: (N, q).
        thin: (N, R) a factor with thin · thinᵀ = Y Yᵀ.
        styles: (N, K) style weights, or None.
        weights: (N,) how much a point counts: its noise is that of the layer over this; 0 for points that do not.
    """

    inputs: jax.Array
    thin: jax.Array
    styles: jax.Array | None
    weights: jax.Array


class _Moments(NamedTuple):
    """Sums over points: B Bᵀ (M, M), B Y (M, R), Σ k_ff, Σ y² and the number of points."""

    second: jax.Array
    first: jax.Array
    k_ff: jax.Array
    squares: jax.Array
    points: jax.Array


class _Gradients(NamedTuple):
    """Derivatives of the value: by K_uu (M, M), B Bᵀ (M, M), B Y (M, R), Σ k_ff, Σ y² and the noise."""

    k_uu: jax.Array
    second: jax.Array
    first: jax.Array
    k_ff: jax.Array
    squares: jax.Array
    noise: jax.Array


def in_blocks(array: jax.Array, shards: int, size: int = BLOCK) -> jax.Array:
    """Points (N, …) as (shards, blocks, points a block, …), filled up with zeros; N is a multiple of ``shards``."""
    each = array.shape[0] // shards
    blocks = -(-each // size)
    length = -(-each // blocks)
    array = array.reshape(shards, each, *array.shape[1:])
    filled = [(0, 0), (0, blocks * length - each)] + [(0, 0)] * (array.ndim - 2)
    array = jnp.pad(array, filled)  # pyright: ignore[reportUnknownMemberType]  (its keywords are untyped)
    return array.reshape(shards, blocks, length, *array.shape[2:])


def from_blocks(blocks: jax.Array, points: int) -> jax.Array:
    """Inverse of :func:`in_blocks`: (N, …)."""
    shards = blocks.shape[0]
    array = blocks.reshape(shards, -1, *blocks.shape[3:])[:, : points // shards]
    return array.reshape(points, *blocks.shape[3:])


def over_shards(function: Callable[[Any], Any], blocks: Any, shards: int) -> Any:
    """The function's trees for each shard, (shards, …), from trees of what :func:`in_blocks` gives."""
    if shards == 1:  # the products of a batch of one would be transposed first
        return jax.tree.map(lambda array: array[None], function(jax.tree.map(lambda array: array[0], blocks)))
    return jax.vmap(function)(blocks)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def negative_log_likelihood(form: Form, parameters: Any, points: Points, noise: jax.Array) -> jax.Array:
    """−log N(Y; 0, Q + noise I) summed over channels, Q = K_fu K_uu⁻¹ K_uf, plus the trace term if ``variational``.

    Args:
        form: covariance functions, channels and parts.
        parameters: tree of what the covariances depend on.
        points: the points; there is no derivative by styles and weights.
        noise: () variance of the noise.
    """
    inverse = _inverse_factor(form.covariance.inducing(parameters))
    moments = _sum_up(form, parameters, points, inverse)
    return _solve(form, moments, inverse, noise)[0]


def _forward(
    form: Form, parameters: Any, points: Points, noise: jax.Array
) -> tuple[jax.Array, tuple[Any, Points, jax.Array]]:
    """The value, and its derivatives by parameters, points and noise."""
    k_uu, pull = jax.vjp(form.covariance.inducing, parameters)
    inverse = _inverse_factor(k_uu)
    moments = _sum_up(form, parameters, points, inverse)
    value, gradients = _solve(form, moments, inverse, noise)
    onto_whitened, onto_thin = 2.0 * inverse.T @ gradients.second, inverse.T @ gradients.first

    def block(total: Any, part: Points) -> tuple[Any, tuple[jax.Array, jax.Array]]:
        (k_uf, _), pull_cross = jax.vjp(lambda p, x: form.covariance.cross(p, x, part.styles), parameters, part.inputs)
        to_k_uf = (onto_whitened @ _lower_product(inverse, k_uf) + onto_thin @ part.thin.T) * part.weights
        to_parameters, to_inputs = pull_cross((to_k_uf, gradients.k_ff * part.weights))
        to_thin = 2.0 * gradients.squares * part.thin + k_uf.T @ onto_thin
        return jax.tree.map(jnp.add, total, to_parameters), (to_inputs, to_thin * part.weights[:, None])

    start = jax.tree.map(jnp.zeros_like, parameters)
    blocks = jax.tree.map(lambda array: in_blocks(array, form.shards), points)
    to_parameters, (to_inputs, to_thin) = over_shards(
        lambda part: jax.lax.scan(block, start, part), blocks, form.shards
    )
    to_parameters = jax.tree.map(lambda own, many: own + jnp.sum(many, axis=0), pull(gradients.k_uu)[0], to_parameters)
    size = points.inputs.shape[0]
    to_points = jax.tree.map(jnp.zeros_like, points)
    to_points = to_points._replace(inputs=from_blocks(to_inputs, size), thin=from_blocks(to_thin, size))
    return value, (to_parameters, to_points, gradients.noise)


def _backward(form: Form, found: Any, cotangent: jax.Array) -> tuple[Any, Points, jax.Array]:
    return jax.tree.map(lambda part: cotangent * part, found)


negative_log_likelihood.defvjp(_forward, _backward)


def _inverse_factor(matrix: jax.Array) -> jax.Array:
    """L⁻¹ of L Lᵀ = matrix."""
    return solve_triangular(cast(jax.Array, jnp.linalg.cholesky(matrix)), jnp.eye(matrix.shape[0]), lower=True)


def _lower_product(lower: jax.Array, other: jax.Array) -> jax.Array:
    """lower · other for a lower triangle (M, M), with three quarters of the work."""
    half = lower.shape[0] // 2
    return jnp.concatenate([lower[:half, :half] @ other[:half], lower[half:] @ other])


def _gram(factor: jax.Array) -> jax.Array:
    """factor · factorᵀ, with three quarters of the work."""
    half = factor.shape[0] // 2
    first, second = factor[:half], factor[half:]
    between = second @ first.T
    return jnp.block([[first @ first.T, between.T], [between, second @ second.T]])


def _sum_up(form: Form, parameters: Any, points: Points, inverse: jax.Array) -> _Moments:

    def block(total: _Moments, part: Points) -> tuple[_Moments, None]:
        k_uf, k_ff = form.covariance.cross(parameters, part.inputs, part.styles)
        root, count = jnp.sqrt(part.weights), jnp.sum(part.weights > 0.0)
        b, thin = _lower_product(inverse, k_uf * root), part.thin * root[:, None]
        here = _Moments(_gram(b), b @ thin, jnp.sum(k_ff * part.weights), jnp.sum(thin**2), count * 1.0)
        return jax.tree.map(jnp.add, total, here), None

    size, scalar = inverse.shape[0], jnp.zeros(())
    start = _Moments(jnp.zeros((size, size)), jnp.zeros((size, points.thin.shape[1])), scalar, scalar, scalar)
    blocks = jax.tree.map(lambda array: in_blocks(array, form.shards), points)
    moments, _ = over_shards(lambda part: jax.lax.scan(block, start, part), blocks, form.shards)
    return jax.tree.map(lambda many: jnp.sum(many, axis=0), moments)


def _solve(form: Form, moments: _Moments, inverse: jax.Array, noise: jax.Array) -> tuple[jax.Array, _Gradients]:
    """The value from the sums, and its derivatives."""
    second, first, k_ff, squares, points = moments
    identity, precision = jnp.eye(second.shape[0]), 1.0 / noise
    inner = cast(jax.Array, jnp.linalg.cholesky(identity + precision * second))
    inner_inverse = solve_triangular(inner, identity, lower=True)
    solved = inner_inverse.T @ inner_inverse
    weights = solved @ first
    log_determinant = points * jnp.log(2.0 * jnp.pi * noise) + 2.0 * jnp.sum(jnp.log(jnp.diag(inner)))
    explained = jnp.sum((inner_inverse @ first) ** 2)
    channels = form.channels
    value = 0.5 * (channels * log_determinant + precision * squares - precision**2 * explained)
    to_precision = channels * (jnp.sum(solved * second) - points * noise) + squares
    to_precision += precision**2 * jnp.sum(weights * (second @ weights)) - 2.0 * precision * explained
    to_second = channels * solved + precision**2 * weights @ weights.T
    if form.variational:
        value += 0.5 * channels * precision * (k_ff - jnp.trace(second))
        to_precision += channels * (k_ff - jnp.trace(second))
        to_second -= channels * identity
    to_second, to_first = 0.5 * precision * to_second, -(precision**2) * weights
    # The value depends on L only through K_uu, so a step of K_uu = L Lᵀ may be taken as L (I + E / 2).
    moved = second @ to_second + 0.5 * first @ to_first.T
    to_k_uu = -0.5 * inverse.T @ (moved + moved.T) @ inverse
    to_k_ff = jnp.asarray(0.5 * channels) * precision if form.variational else jnp.zeros(())
    return value, _Gradients(to_k_uu, to_second, to_first, to_k_ff, 0.5 * precision, -0.5 * precision**2 * to_precision)

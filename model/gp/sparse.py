"""Sparse Gaussian process layers: the DTC likelihood, its variational bound, and the posterior used online.

Sources: Seeger et al. 2003 and Lawrence 2007 (DTC for GP-LVMs); Titsias 2009 (the trace term).
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
from jax.nn import sigmoid
from jax.scipy.linalg import solve_triangular

from highfive.model.gp import likelihood
from highfive.model.gp.coregionalisation import StyleFactor, style_covariance
from highfive.model.gp.kernels import Kernel, MotionKernel, add_jitter
from highfive.model.gp.likelihood import BLOCK, Covariance, Form, Points, from_blocks, in_blocks
from highfive.model.gp.posterior import MotionParameters, Numbers, Posterior


class Layer(NamedTuple):
    """The learned parameters of one sparse GP with many output channels that share kernel and noise.

    Attributes:
        kernel: covariance over the inputs.
        inducing: (M, q) inducing inputs.
        raw_noise: () unconstrained; see :func:`noise_variance`.
        style: the style factor, or None for a layer without styles.
    """

    kernel: Kernel
    inducing: jax.Array
    raw_noise: jax.Array
    style: StyleFactor | None = None


class Targets(NamedTuple):
    """The channels of a layer, as the likelihood sees them: only through Y Yᵀ.

    Attributes:
        thin: (N, R) a factor with thin · thinᵀ = Y Yᵀ up to ``discarded``.
        channels: number D of channels of Y (R ≤ D).
        discarded: summed squares of what the factor leaves out; it counts as noise.
    """

    thin: jax.Array
    channels: int
    discarded: float


def noise_variance(raw: jax.Array, bounds: tuple[float, float]) -> jax.Array:
    """Variance of a noise whose standard deviation stays within ``bounds``, for any real ``raw``."""
    low, high = jnp.log(bounds[0]), jnp.log(bounds[1])
    return jnp.exp(2.0 * (low + (high - low) * sigmoid(raw)))


def raw_noise(deviation: float, bounds: tuple[float, float]) -> jax.Array:
    """Inverse of :func:`noise_variance`: the raw value of a standard deviation, kept off the very bounds."""
    fraction = (jnp.log(deviation) - jnp.log(bounds[0])) / (jnp.log(bounds[1]) - jnp.log(bounds[0]))
    fraction = jnp.clip(fraction, 0.02, 0.98)
    return jnp.log(fraction / (1.0 - fraction))


def inducing_covariance(layer: Layer) -> jax.Array:
    """K_uu (M, M), jitter included."""
    k_uu = layer.kernel.cross(layer.inducing, layer.inducing)
    if layer.style is not None:
        k_uu = k_uu * (layer.style.inducing @ style_covariance(layer.style) @ layer.style.inducing.T)
    return add_jitter(k_uu)


def cross_covariance(layer: Layer, inputs: jax.Array, styles: jax.Array | None) -> tuple[jax.Array, jax.Array]:
    """K_uf (M, N) and the diagonal of K_ff (N,) at inputs (N, q) and style weights (N, K)."""
    k_uf, k_ff = layer.kernel.cross(layer.inducing, inputs), layer.kernel.diagonal(inputs)
    if layer.style is not None:
        assert styles is not None
        between = style_covariance(layer.style)
        k_uf = k_uf * (layer.style.inducing @ between @ styles.T)
        k_ff = k_ff * jnp.sum((styles @ between) * styles, axis=1)
    return k_uf, k_ff


def negative_log_likelihood(
    layer: Layer,
    inputs: jax.Array,
    targets: Targets,
    noise: jax.Array,
    styles: jax.Array | None = None,
    variational: bool = False,
    weights: jax.Array | None = None,
    shards: int = 1,
) -> jax.Array:
    """−log N(Y; 0, Q + noise I) summed over channels, Q = K_fu K_uu⁻¹ K_uf; plus the trace term if ``variational``.

    The noise of a point is ``noise`` over its entry of ``weights`` (N,), and one of weight 0 does not count; the value
    lacks what does not depend on the parameters, −D/2 Σ log weight. The sums over points are taken in ``shards`` equal
    parts.
    """
    weights = jnp.ones(inputs.shape[0]) if weights is None else weights
    points = Points(inputs, targets.thin, None if layer.style is None else styles, weights)
    form = Form(COVARIANCE, targets.channels, variational, shards)
    value: Any = likelihood.negative_log_likelihood(form, layer, points, noise)
    return value + 0.5 * targets.discarded / noise


COVARIANCE = Covariance(inducing_covariance, cross_covariance)


@jax.jit
def fit(
    layer: Layer,
    inputs: jax.Array,
    values: jax.Array,
    noise: jax.Array,
    styles: jax.Array | None = None,
    offset: jax.Array | None = None,
    scale: jax.Array | None = None,
    weights: jax.Array | None = None,
) -> Posterior:
    """The posterior of a layer given inputs (N, q) and values (N, D); it predicts ``offset + scale · value``.

    The noise of a point is ``noise`` over its entry of ``weights`` (N,).
    """
    k_uu = inducing_covariance(layer)
    size, channels = k_uu.shape[0], values.shape[1]
    lower = cast(jax.Array, jnp.linalg.cholesky(k_uu))
    inverse = solve_triangular(lower, jnp.eye(size), lower=True)
    weights = jnp.ones(inputs.shape[0]) if weights is None else weights

    # In blocks, as the likelihood: of 200,000 points K_uf alone would take 320 MB, and there would be several.
    def block(total: Any, part: Points) -> tuple[Any, None]:
        k_uf, _ = cross_covariance(layer, part.inputs, part.styles)
        k_uf = k_uf * jnp.sqrt(part.weights)
        projected = inverse @ k_uf
        here = projected @ projected.T, k_uf @ (part.thin * jnp.sqrt(part.weights)[:, None])
        return jax.tree.map(jnp.add, total, here), None

    points = Points(inputs, values, None if layer.style is None else styles, weights)
    blocks = jax.tree.map(lambda array: in_blocks(array, 1)[0], points)
    start = jnp.zeros((size, size)), jnp.zeros((size, channels))
    (second, first), _ = jax.lax.scan(block, start, blocks)
    inner = cast(jax.Array, jnp.linalg.cholesky(jnp.eye(size) + second / noise))
    inner_inverse = solve_triangular(inner, inverse, lower=True)
    scale = jnp.ones(channels) if scale is None else scale
    offset = jnp.zeros(channels) if offset is None else offset
    mean = inner_inverse.T @ (inner_inverse @ first) / noise * scale
    reduction = inverse.T @ inverse - inner_inverse.T @ inner_inverse
    between = style = None
    if layer.style is not None:
        between = style_covariance(layer.style)
        style = layer.style.inducing @ between
    return Posterior(layer.kernel, layer.inducing, style, between, mean, offset, reduction, noise, scale)


def with_kernel(posterior: Posterior) -> Posterior:
    """The posterior with a kernel that can be called, where it holds the parameters alone."""
    kernel = posterior.kernel
    return (
        posterior._replace(kernel=MotionKernel(*map(jnp.asarray, kernel)))
        if isinstance(kernel, MotionParameters)
        else posterior
    )


def means(posterior: Posterior, points: Numbers, styles: Numbers | None = None) -> jax.Array:
    """Predictive means (N, D) at inputs (N, q) and styles (N, K)."""
    assert posterior.style is None or styles is not None
    return _means(with_kernel(posterior), points, styles)


@jax.jit
def _means(posterior: Posterior, points: Any, styles: Any) -> Any:
    def block(part: tuple[Any, Any]) -> Any:
        inputs, weights = part
        k_fu = posterior.kernel.cross(inputs, posterior.inducing)
        if posterior.style is not None:
            k_fu = k_fu * (weights @ posterior.style.T)
        return k_fu @ posterior.weights + posterior.offset

    if posterior.style is None:
        styles = None
    if points.shape[0] <= BLOCK:
        return block((points, styles))
    blocks = jax.tree.map(lambda array: in_blocks(array, 1), (points, styles))
    return from_blocks(jax.lax.map(block, jax.tree.map(lambda array: array[0], blocks))[None], points.shape[0])


def variances(posterior: Posterior, points: Numbers) -> jax.Array:
    """Predictive variances (N, D) of a layer without styles at inputs (N, q), noise included."""
    return _variances(with_kernel(posterior), points)


@jax.jit
def _variances(posterior: Posterior, points: Any) -> Any:
    k_fu = posterior.kernel.cross(points, posterior.inducing)
    function = posterior.kernel.diagonal(points) - jnp.sum((k_fu @ posterior.reduction) * k_fu, axis=1)
    return (jnp.maximum(function, 0.0)[:, None] + posterior.noise) * posterior.scale**2

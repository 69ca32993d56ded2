"""A trained sparse layer as the prior of the next data: the posterior of a few points is in closed form.

What a layer has learned is in its inducing outputs u alone, a Gaussian: the likelihood of all it has seen is
exp(−½ uᵀ K⁻¹ Φ K⁻¹ u + uᵀ K⁻¹ ψ) with Φ = K_uf K_fu / noise and ψ = K_uf Y / noise. Both can be had from the weights
and the reduction, so that the old points are not needed. That likelihood, to the power of a share that says how much
of it still holds, times that of the new points, is the new posterior. Further inducing inputs make room for places
where the old ones are not.

Source: Bui, Nguyen & Turner 2017 (streaming sparse GPs), with hyperparameters held; the share is the forgetting of
Smith & West's power discounting.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.kernels import Kernel, add_jitter
from highfive.model.gp.posterior import Posterior

ROWS = 256  # points that are compiled for at a time


class Evidence(NamedTuple):
    """What a layer has seen, as its inducing outputs know it.

    Attributes:
        inducing: (M, q) inputs.
        styles: (M, K) their style weights, or None.
        k_uu: (M, M), jitter included.
        information: (M, M) Φ, positive semi-definite.
        score: (M, D) ψ, of the channels in the layer's own units.
    """

    inducing: Array
    styles: Array | None
    k_uu: Array
    information: Array
    score: Array


def covariance(layer: Posterior, a: Array, b: Array, a_styles: Array | None, b_styles: Array | None) -> Array:
    """The layer's covariance (A, B) of inputs (A, q) and (B, q), with their style weights (A, K) and (B, K)."""
    found: Array = np.asarray(
        _cross(sparse.with_kernel(layer).kernel, jnp.asarray(_filled(a)), jnp.asarray(_filled(b)))
    )[: len(a), : len(b)]
    if a_styles is None or b_styles is None:
        return found
    return found * (a_styles @ np.asarray(layer.style_covariance) @ b_styles.T)


@jax.jit
def _cross(kernel: Kernel, a: jax.Array, b: jax.Array) -> jax.Array:
    return kernel.cross(a, b)


def _filled(points: Array) -> Array:
    """Zeros added up to a multiple of :data:`ROWS`: every other number of points would compile anew."""
    return np.pad(np.asarray(points), ((0, -len(points) % ROWS), (0, 0)))


def evidence(layer: Posterior) -> Evidence:
    """Recovers what a layer has seen, to some 1e-6 of its means where K_uu has a condition of 1e8."""
    inducing, styles = np.asarray(layer.inducing), None
    if layer.style is not None:
        styles = np.linalg.solve(np.asarray(layer.style_covariance), np.asarray(layer.style).T).T
    k_uu = np.asarray(add_jitter(jnp.asarray(covariance(layer, inducing, inducing, styles, styles))))
    inner = np.linalg.inv(np.linalg.inv(k_uu) - np.asarray(layer.reduction))
    values, basis = np.linalg.eigh(0.5 * (inner + inner.T) - k_uu)
    information = (basis * np.maximum(values, 0.0)) @ basis.T  # rounding made some of the smallest negative
    score = (k_uu + information) @ (np.asarray(layer.weights) / np.asarray(layer.scale))
    return Evidence(inducing, styles, k_uu, information, score)


def updated(
    layer: Posterior,
    seen: Evidence,
    inputs: Array,
    values: Array,
    counts: Array,
    styles: Array | None = None,
    share: float = 1.0,
    added: NDArray[np.int64] | None = None,
) -> Posterior:
    """The layer after further points; kernel, noise and units stay.

    Args:
        layer: the layer.
        seen: what it has seen, from :func:`evidence`.
        inputs: (N, q).
        values: (N, D) in the units of its predictions.
        counts: (N,) how much each point counts; points that err together count for less than one.
        styles: (N, K), of a layer with styles.
        share: of what was seen that still holds, from 0 (forgotten) to 1.
        added: indices (A,) of the points that become inducing inputs, too.
    """
    chosen = np.zeros(0, dtype=np.int64) if added is None else added
    inducing = np.concatenate([seen.inducing, inputs[chosen]])
    all_styles = None
    if seen.styles is not None and styles is not None:
        all_styles = np.concatenate([seen.styles, styles[chosen]])
    k_uu = np.asarray(add_jitter(jnp.asarray(covariance(layer, inducing, inducing, all_styles, all_styles))))
    inverse = np.linalg.inv(np.linalg.cholesky(k_uu))
    # Old inducing outputs given all: themselves; the others only carry what these say of them.
    size = len(seen.inducing)
    onto = np.linalg.solve(seen.k_uu, covariance(layer, seen.inducing, inducing, seen.styles, all_styles)).T
    onto[:size] = np.eye(size)
    k_uf = covariance(layer, inducing, inputs, all_styles, styles)
    noise, scale = float(np.mean(np.asarray(layer.noise))), np.asarray(layer.scale)
    counted = k_uf * counts / noise
    information = share * onto @ seen.information @ onto.T + counted @ k_uf.T
    score = share * onto @ seen.score + counted @ ((values - np.asarray(layer.offset)) / scale)
    inner = np.eye(len(k_uu)) + inverse @ information @ inverse.T
    both = np.linalg.solve(np.linalg.cholesky(0.5 * (inner + inner.T)), inverse)
    return layer._replace(
        inducing=inducing,
        weights=both.T @ (both @ score) * scale,
        reduction=inverse.T @ inverse - both.T @ both,
        style=None if all_styles is None else all_styles @ np.asarray(layer.style_covariance),
    )


def means(layer: Posterior, inputs: Array, styles: Array | None = None) -> Array:
    """Predictive means (N, D) at inputs (N, q) and styles (N, K), as :func:`sparse.means`, for any N at once."""
    return _from_inducing(layer, inputs, styles) @ np.asarray(layer.weights) + np.asarray(layer.offset)


def function_variance(layer: Posterior, inputs: Array, styles: Array | None = None) -> Array:
    """Variance (N,) of the function at inputs (N, q), in the layer's own units, noise excluded."""
    k_fu = _from_inducing(layer, inputs, styles)
    k_ff = np.asarray(sparse.with_kernel(layer).kernel.diagonal(jnp.asarray(_filled(inputs))))[: len(inputs)]
    if styles is not None and layer.style_covariance is not None:
        k_ff = k_ff * np.sum((styles @ np.asarray(layer.style_covariance)) * styles, axis=1)
    return np.maximum(k_ff - np.sum((k_fu @ np.asarray(layer.reduction)) * k_fu, axis=1), 0.0)


def _from_inducing(layer: Posterior, inputs: Array, styles: Array | None) -> Array:
    """K_fu (N, M)."""
    k_fu = covariance(layer, inputs, np.asarray(layer.inducing), None, None)
    return k_fu if layer.style is None or styles is None else k_fu * (styles @ np.asarray(layer.style).T)

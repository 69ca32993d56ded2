"""A sparse GP regression on its own: kernel, inducing inputs and noise by the variational bound (Titsias 2009)."""

from __future__ import annotations

import jax

from highfive.model.gp import sparse
from highfive.model.gp.optimise import ProgressCallback, minimise
from highfive.model.gp.sparse import Layer, Targets


def learned(
    start: Layer,
    points: jax.Array,
    targets: Targets,
    bounds: tuple[float, float],
    iterations: int,
    adam_steps: int,
    stage: str,
    progress: ProgressCallback | None = None,
    styles: jax.Array | None = None,
    weights: jax.Array | None = None,
) -> tuple[Layer, jax.Array]:
    """The layer with its parameters learned, and its noise variance.

    Args:
        start: where the optimisation begins.
        points: (N, q) inputs.
        targets: what the likelihood sees of the N values.
        bounds: of the noise's standard deviation.
        iterations: steps in all; ``adam_steps`` of them, at the beginning, are Adam's.
        adam_steps: as said.
        stage: what is being fitted, for the progress.
        progress: called after every step.
        styles: (N, K) style weights, of a layer with styles.
        weights: (N,) how much each point counts.
    """

    def value(layer: Layer) -> jax.Array:
        noise = sparse.noise_variance(layer.raw_noise, bounds)
        total = sparse.negative_log_likelihood(layer, points, targets, noise, styles, variational=True, weights=weights)
        return total / len(points)

    layer, _ = minimise(value, start, iterations, adam_steps, stage=stage, progress=progress)
    return layer, sparse.noise_variance(layer.raw_noise, bounds)

"""Where joint training starts: principal components, and inducing inputs drawn from the training points."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.coregionalisation import initial_style
from highfive.model.gp.kernels import Kernel, MotionKernel, add_jitter
from highfive.model.gp.sparse import Layer
from highfive.model.hgpdm.hierarchy import BackConstraint, Parameters, Problem, dynamics_input, latents

RIDGE = 1e-2  # noise variance of the regressions that the start is made with


def principal_components(values: Array, count: int) -> Array:
    """The ``count`` largest principal components (N, count) of values (N, D), each of unit variance.

    Where the values have fewer dimensions the rest are products of the first ones, so that no latent starts constant.
    """
    centred = values - values.mean(axis=0)
    variances, basis = np.linalg.eigh(centred.T @ centred)
    scores = centred @ basis[:, ::-1][:, :count]
    scores = scores[:, variances[::-1][:count] > 1e-9 * variances[-1]]
    while scores.shape[1] < count:
        scores = np.column_stack([scores, scores[:, 0] * scores[:, -1]])
    scores = scores - scores.mean(axis=0)
    return scores / scores.std(axis=0)


def _whitened_regression(kernel: Kernel, inducing: Array, features: Array, targets: Array) -> tuple[Array, Array]:
    """Whitened weights (M, D) of a regression of targets (N, D) on features (N, F), and its predictions (N, D)."""
    centres = jnp.asarray(inducing)
    lower = np.linalg.cholesky(np.asarray(add_jitter(_cross(kernel, centres, centres))))
    basis = np.linalg.solve(lower, np.asarray(_cross(kernel, centres, jnp.asarray(features)))).T
    weights = np.linalg.solve(basis.T @ basis + RIDGE * np.eye(len(inducing)), basis.T @ targets)
    return weights.astype(float), (basis @ weights).astype(float)


@jax.jit
def _cross(kernel: Kernel, a: jax.Array, b: jax.Array) -> jax.Array:
    return kernel.cross(a, b)


def _layer(dims: int, inducing: Array, deviation: float, bounds: tuple[float, float]) -> Layer:
    return Layer(MotionKernel.initial(dims), jnp.asarray(inducing), sparse.raw_noise(deviation, bounds))


def initial_parameters(task: Problem, inducing: int, rng: np.random.Generator) -> Parameters:
    """Parameters to start from; the inducing inputs of all layers are ``inducing`` drawn points (at most N)."""
    preset, points = task.preset, len(task.data.trial)
    chosen = np.sort(rng.choice(points, size=min(inducing, points), replace=False))
    outputs = np.asarray(task.avatar_targets.thin)
    hand = np.asarray(task.human_targets.thin)
    features = task.features
    human = principal_components(hand, preset.human_dims)
    if preset.back_constrained:
        kernel = MotionKernel.initial(features.shape[1])
        centres = features[chosen]
        # What of the avatar the hand can tell at all, whatever the style: that is what I and X¹ must carry first.
        _, predictable = _whitened_regression(kernel, centres, features, outputs)
        avatar = principal_components(predictable, preset.avatar_dims)
        interaction = principal_components(predictable, preset.interaction_dims)
        weights, _ = _whitened_regression(kernel, centres, features, np.column_stack([interaction, human, avatar]))
        split = (preset.interaction_dims, preset.interaction_dims + preset.human_dims)
        parts = [jnp.asarray(part) for part in np.split(weights, split, axis=1)]
        back = BackConstraint(kernel, jnp.asarray(centres), *parts)
        free_interaction = free_human = free_avatar = None
    else:
        avatar = principal_components(outputs, preset.avatar_dims)
        interaction = principal_components(np.column_stack([avatar, human]), preset.interaction_dims)
        back, free_interaction = None, jnp.asarray(interaction)
        free_human, free_avatar = jnp.asarray(human), jnp.asarray(avatar)

    styles = task.data.styles
    parameters = Parameters(
        avatar=_layer(preset.avatar_dims, avatar[chosen], 0.3, preset.avatar_noise)._replace(
            style=initial_style(styles.shape[1], jnp.asarray(styles[chosen]))
        ),
        human=_layer(preset.human_dims, human[chosen], 0.2, preset.human_noise),
        interaction=_layer(preset.interaction_dims, interaction[chosen], 0.1, preset.interaction_noise),
        dynamics=_layer(
            2 * preset.interaction_dims, np.zeros((1, 2 * preset.interaction_dims)), 0.1, preset.dynamics_noise
        ),
        back=back,
        avatar_latent=free_avatar,
        interaction_latent=free_interaction,
        human_latent=free_human,
    )
    _, previous, before = latents(parameters, task).steps[:, task.successors]
    inputs = dynamics_input(previous, before, task.data.lag)
    steps = inputs[np.sort(rng.choice(len(inputs), size=min(inducing, len(inputs)), replace=False))]
    return parameters._replace(dynamics=parameters.dynamics._replace(inducing=steps))

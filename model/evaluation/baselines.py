"""Plain regressions from the same hand features and emotion to the same channels: the rows beside the model."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree

from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.optimise import ProgressCallback
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.hierarchy import Problem
from highfive.model.hgpdm.pose_ensemble_training import regression_layer, regression_posterior

Predictor = Callable[[Array, Array], Array]
"""From hand features (T, F) and one-hot styles (T, K) to avatar channels (T, channels)."""

NEIGHBOURS = 10
RIDGE_PENALTY = 1.0  # relative to features of unit variance, summed over training points
GP_ITERATIONS = 200
GP_NOISE = (5e-3, 1.0)  # bounds, as for the avatar layer


def _by_style(task: Problem, fit: Callable[[Array, Array], Callable[[Array], Array]]) -> Predictor:
    """A regression fitted for each emotion on its own."""
    features, outputs, styles = task.features, task.data.outputs, task.data.styles
    fitted = [fit(features[mask > 0.5], outputs[mask > 0.5]) for mask in styles.T]

    def predict(inputs: Array, weights: Array) -> Array:
        answer = np.empty((len(inputs), outputs.shape[1]))
        for number, regression in enumerate(fitted):
            rows = np.argmax(weights, axis=1) == number
            if np.any(rows):
                answer[rows] = regression(inputs[rows])
        return answer

    return predict


def constant_mean(task: Problem) -> Predictor:
    """The mean pose of each emotion."""
    return _by_style(task, lambda _, outputs: lambda inputs: np.tile(outputs.mean(axis=0), (len(inputs), 1)))


def ridge(task: Problem) -> Predictor:
    """Ridge regression of each emotion on the features."""

    def fit(features: Array, outputs: Array) -> Callable[[Array], Array]:
        centre: Array = features.mean(axis=0)
        offset: Array = outputs.mean(axis=0)
        centred = features - centre
        gram = centred.T @ centred + RIDGE_PENALTY * np.eye(features.shape[1])
        weights = np.linalg.solve(gram, centred.T @ (outputs - offset))
        return lambda inputs: (inputs - centre) @ weights + offset

    return _by_style(task, fit)


def nearest_neighbours(task: Problem) -> Predictor:
    """The mean of the nearest training points of the same emotion."""

    def fit(features: Array, outputs: Array) -> Callable[[Array], Array]:
        tree, count = KDTree(features), min(NEIGHBOURS, len(features))

        def predict(inputs: Array) -> Array:
            _, nearest = tree.query(inputs, k=count)
            return outputs[np.reshape(nearest, (len(inputs), count))].mean(axis=1)

        return predict

    return _by_style(task, fit)


def sparse_gp(
    task: Problem, inducing: int, rng: np.random.Generator, progress: ProgressCallback | None = None
) -> Posterior:
    """Plain sparse GP regression, motion × style kernel, with as many inducing inputs as a layer of the model."""
    stage = "sparse GP baseline"
    layer, noise = regression_layer(task, inducing, rng, GP_ITERATIONS, GP_NOISE, stage, progress)
    return regression_posterior(layer, noise, task)


def regression(posterior: Posterior) -> Predictor:
    """The means of a sparse GP with styles."""
    return lambda inputs, weights: np.asarray(sparse.means(posterior, jnp.asarray(inputs), jnp.asarray(weights)))

"""Learns how the palm is led, from what pool and contact layer say of trials that were left out."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from highfive.model.geometry.arm_chain import ArmChain
from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.posterior import Posterior
from highfive.model.gp.sparse import Layer
from highfive.model.hgpdm.contact_layer import ContactLayer
from highfive.model.hgpdm.contact_training import approaches, precision
from highfive.model.hgpdm.dataset import AUXILIARY, CLOCK_SCALE, KNUCKLES, Channels, hand_history
from highfive.model.hgpdm.hierarchy import Problem
from highfive.model.hgpdm.pose_ensemble_training import LeftOut
from highfive.model.hgpdm.task_space import APART, BEGIN, END, KNOTS, TaskSpace, led_channels, time_weights
from highfive.model.hgpdm.trials import Trial

PENALTY = 0.03  # of the slopes, in m² of what they multiply
STIFF = 1e-6  # m² and rad², added to the covariance's diagonal: a joint that never erred still gives way a little


def fit_task_space(
    trials: Sequence[Trial], task: Problem, contact: ContactLayer, left_out: LeftOut, chain: ArmChain
) -> TaskSpace | None:
    """Learns how the palm is led.

    Args:
        trials: that were learned from.
        task: their training points.
        contact: the contact layer, from the hand.
        left_out: what the direct answers were of trials that were left out.
        chain: the joints that carry the palm.

    Returns:
        None where too little of an approach is among the points, or the joints are another skeleton's.
    """
    where, outputs = Channels(task.data.outputs.shape[1] - AUXILIARY), task.data.outputs
    if 3 * int(chain.joints.max()) >= where.joints:
        return None
    pool = outputs + left_out.with_arm
    point, time = _forecasts(trials, task, contact, left_out.fold)
    clock = CLOCK_SCALE * np.arctanh(np.clip(pool[:, where.clock], -0.98, 0.98))
    used = (clock > END) & (clock < BEGIN) & (np.abs(time - clock) < APART)
    if used.sum() < 3 * len(KNOTS):
        return None
    weights = time_weights(0.5 * (time + clock)[used])
    beyond = [point[used] - pool[used, part] for part in (where.contact, where.palm)]
    design: Array = np.concatenate(
        [(weights[:, None, :] * d[:, :, None]).reshape(-1, len(KNOTS)) for d in beyond], axis=1
    )
    missing = (outputs - pool)[used, where.palm].reshape(-1)
    gram = design.T @ design + PENALTY * np.eye(2 * len(KNOTS))
    slopes = np.asarray(np.linalg.solve(gram, design.T @ missing), dtype=float)
    errors = left_out.with_arm[used][:, led_channels(chain, where)]
    covariance = errors.T @ errors / len(errors) + STIFF * np.eye(errors.shape[1])
    return TaskSpace(chain, covariance, slopes.reshape(2, len(KNOTS)))


def _forecasts(
    trials: Sequence[Trial], task: Problem, contact: ContactLayer, fold: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Points (N, 3), m, and times (N,), s, that the contact layer says at the training points, by other folds."""
    preset, data = task.preset, task.data

    def look(trial: Trial, times: Array) -> Array:
        return task.feature_map(hand_history(trial, times, preset.history))

    features, left, number = approaches(trials, look)
    of_trial = np.array([fold[np.flatnonzero(data.trial == index)[0]] for index in range(int(data.trial[-1]) + 1)])
    said = np.empty((len(data.trial), 4))
    for one in range(int(fold.max()) + 1):
        rows, out = of_trial[number] != one, fold == one
        without = _learned_from(contact.posterior, features[rows], left[rows])
        said[out] = np.asarray(sparse.means(without, task.features[out]))
    return data.history[:, 0, KNUCKLES] + said[:, :3], said[:, 3]


def _learned_from(posterior: Posterior, features: Array, left: Array) -> Posterior:
    """The layer's weights by other frames, all else as it is."""
    layer, offset, scale = sparse.with_kernel(posterior), np.asarray(posterior.offset), np.asarray(posterior.scale)
    parts = Layer(layer.kernel, jnp.asarray(layer.inducing), jnp.zeros(()))
    values, noise = jnp.asarray((left - offset) / scale), jnp.asarray(layer.noise)
    units = {"offset": jnp.asarray(offset), "scale": jnp.asarray(scale)}
    return sparse.fit(parts, jnp.asarray(features), values, noise, **units, weights=jnp.asarray(precision(left[:, 3])))

"""The hierarchical Gaussian process dynamical model: its parameters, its latents and its joint objective.

    I ─▶ X² ─▶ Y²  (hand)          I_n = h(I_{n−1}, I_{n−2}) + noise
    └──▶ X¹ ─▶ Y¹  (avatar, with a style)

Source: Taubert et al. 2013. The preset decides what is free and what is a function of the hand
(model/hgpdm/presets.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from numpy.typing import NDArray

from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.kernels import Kernel, add_jitter
from highfive.model.gp.likelihood import from_blocks, in_blocks, over_shards
from highfive.model.gp.sparse import Layer, Targets
from highfive.model.hgpdm.dataset import TrainingSet
from highfive.model.hgpdm.dynamics import dynamics_input, dynamics_mean
from highfive.model.hgpdm.features import FeatureMap, fit_feature_map
from highfive.model.hgpdm.presets import Preset

POINTS = "points"  # the axis of a mesh over which points are spread


class BackConstraint(NamedTuple):
    """Latents as functions of the hand features (Lawrence & Quiñonero Candela 2006), sparse GPs in whitened weights.

    Attributes:
        kernel: covariance over the F features.
        inducing: (M, F).
        interaction: (M, q) whitened weights of I.
        human: (M, q) whitened weights of X².
        avatar: (M, q) whitened weights of X¹.
    """

    kernel: Kernel
    inducing: jax.Array
    interaction: jax.Array
    human: jax.Array
    avatar: jax.Array


class Parameters(NamedTuple):
    """Everything that joint training moves.

    Attributes:
        avatar, human, interaction, dynamics: the four layers.
        back: the back constraint, or None where all latents are free.
        avatar_latent: (N, q) X¹ where free, else None.
        interaction_latent: (N, q) I where free, else None.
        human_latent: (N, q) X² where free, else None.
    """

    avatar: Layer
    human: Layer
    interaction: Layer
    dynamics: Layer
    back: BackConstraint | None
    avatar_latent: jax.Array | None
    interaction_latent: jax.Array | None
    human_latent: jax.Array | None


class Latents(NamedTuple):
    """Latents at the training points, each dimension of zero mean and unit variance.

    Their scale is a gauge: without this, shrinking X¹ would raise the interaction layer's likelihood at no cost.

    Attributes:
        avatar, human, interaction: (N, q) X¹, X² and I.
        steps: (3, N, q) I at the points, one lag before, and two lags before; of use at ``Problem.successors``.
    """

    avatar: jax.Array
    human: jax.Array
    interaction: jax.Array
    steps: jax.Array


class PointArrays(NamedTuple):
    """What the objective reads of the N points. There may be more rows, of zeros, so that N divides by the shards.

    Attributes:
        features: (N, F).
        styles: (N, K).
        avatar: (N, R) thin factor of the scaled Y¹.
        human: (N, P) the scaled Y².
        counts: (N,) 1 for points, 0 for filling.
        follows: (N,) 1 for points with two predecessors in their trial, else 0.
    """

    features: jax.Array
    styles: jax.Array
    avatar: jax.Array
    human: jax.Array
    counts: jax.Array
    follows: jax.Array


@dataclass(frozen=True)
class Problem:
    """The data of the objective in the layers' own units.

    Attributes:
        preset: the preset.
        data: the training points.
        feature_map: from hand histories to features.
        features: (N, F).
        avatar_offset, avatar_scale: (channels,) Y¹ = offset + scale · (scaled channels).
        human_offset, human_scale: (P,) the same for Y².
        avatar_basis: (channels, R) orthonormal; the thin factor of the scaled Y¹ is scaled Y¹ · basis.
        avatar_targets, human_targets: what the likelihoods see.
        successors: indices (T,) of points with two predecessors in their trial.
        first, last: (trials,) indices of each trial's first and last point.
        points: what the objective reads of the points.
        mesh: the devices over which ``points`` are spread (model/hgpdm/sharding.py), or None.
    """

    preset: Preset
    data: TrainingSet
    feature_map: FeatureMap
    features: Array
    avatar_offset: Array
    avatar_scale: Array
    human_offset: Array
    human_scale: Array
    avatar_basis: Array
    avatar_targets: Targets
    human_targets: Targets
    successors: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    points: PointArrays
    mesh: Mesh | None = None

    @property
    def shards(self) -> int:
        """Equal parts of the points whose sums are taken separately, one per device."""
        return 1 if self.mesh is None else self.mesh.size


def problem(data: TrainingSet, preset: Preset) -> Problem:
    """Scales the channels, compresses Y¹ to a thin factor and builds the features."""
    scaled = (data.outputs - data.outputs.mean(axis=0)) * data.weights
    squares: Array = np.sum(scaled**2, axis=1)
    total = np.sqrt(np.mean(squares) / 10.0)  # about ten channels' worth of motion, of unit variance
    scaled = scaled / total
    variances, basis = np.linalg.eigh(scaled.T @ scaled)
    keep = np.cumsum(variances) > preset.channel_tolerance * np.sum(variances)
    thin = scaled @ basis[:, keep]
    discarded = float(np.sum(scaled**2) - np.sum(thin**2))

    hand = data.history[:, 0]
    hand_offset: Array = hand.mean(axis=0)
    hand_scale = np.full(hand.shape[1], np.sqrt(np.mean((hand - hand_offset) ** 2)))
    feature_map = fit_feature_map(data.history)
    starts = np.flatnonzero(np.diff(data.trial, prepend=-1))
    position = np.arange(len(data.trial)) - starts[data.trial]
    features, human = feature_map(data.history), (hand - hand_offset) / hand_scale
    follows = (position >= 2).astype(float)
    points = (features, data.styles, thin, human, np.ones(len(position)), follows)
    return Problem(
        preset,
        data,
        feature_map,
        features,
        data.outputs.mean(axis=0),
        total / data.weights,
        hand_offset,
        hand_scale,
        basis[:, keep],
        Targets(jnp.asarray(thin), scaled.shape[1], discarded),
        Targets(jnp.asarray(human), hand.shape[1], 0.0),
        np.flatnonzero(position >= 2),
        starts,
        np.append(starts[1:], len(data.trial)) - 1,
        PointArrays(*(jnp.asarray(array) for array in points)),
    )


def gauge(latent: jax.Array, counts: jax.Array | None = None) -> tuple[jax.Array, jax.Array]:
    """Mean and standard deviation (q,) of latents (N, q), of those that count (N,)."""
    counts = jnp.ones(latent.shape[0]) if counts is None else counts
    centre = counts @ latent / jnp.sum(counts)
    return centre, jnp.sqrt(counts @ (latent - centre) ** 2 / jnp.sum(counts) + 1e-12)


def standardised(latent: jax.Array, counts: jax.Array | None = None) -> jax.Array:
    """Latents (N, q) with zero mean and unit variance in each dimension."""
    centre, deviation = gauge(latent, counts)
    return (latent - centre) / deviation


def back_weights(back: BackConstraint) -> jax.Array:
    """Weights (M, q_I + q_2 + q_1) of the kernel functions, from the whitened ones: K_uu^{-T/2} V."""
    lower = cast(jax.Array, jnp.linalg.cholesky(add_jitter(back.kernel.cross(back.inducing, back.inducing))))
    whitened = jnp.concatenate([back.interaction, back.human, back.avatar], axis=1)
    return solve_triangular(lower.T, whitened, lower=False)


def _learned(back: BackConstraint, features: jax.Array, shards: int) -> jax.Array:
    """K_fu · weights (N, q_I + q_2 + q_1) in blocks; the gradient works K_fu out again."""
    weights = back_weights(back)

    @jax.checkpoint
    def block(part: jax.Array) -> jax.Array:
        return back.kernel.cross(part, back.inducing) @ weights

    found = over_shards(lambda part: jax.lax.map(block, part), in_blocks(features, shards), shards)
    return from_blocks(found, features.shape[0])


def latents(parameters: Parameters, task: Problem, points: PointArrays | None = None) -> Latents:
    """X¹, X² and I at the points (by default those of the task), and I along the dynamics' steps."""
    points = task.points if points is None else points

    def filled(latent: jax.Array) -> jax.Array:
        rows = points.counts.shape[0] - latent.shape[0]
        return jnp.pad(latent, ((0, rows), (0, 0)))  # pyright: ignore[reportUnknownMemberType]  (its keywords are untyped)

    if parameters.back is None:
        raw = (parameters.interaction_latent, parameters.human_latent, parameters.avatar_latent)
        raw = [filled(latent) for latent in raw if latent is not None]
    else:
        preset = task.preset
        split = (preset.interaction_dims, preset.interaction_dims + preset.human_dims)
        raw = jnp.split(_learned(parameters.back, points.features, task.shards), split, axis=1)
    interaction, human, avatar = (standardised(latent, points.counts) for latent in raw)
    # Rolled rather than gathered: the gradient of a gather goes back point by point.
    steps = jnp.stack([interaction, jnp.roll(interaction, 1, axis=0), jnp.roll(interaction, 2, axis=0)])
    return Latents(avatar, human, interaction, steps)


def noises(parameters: Parameters, preset: Preset) -> dict[str, jax.Array]:
    """Noise variance of each layer."""
    return {
        "avatar": sparse.noise_variance(parameters.avatar.raw_noise, preset.avatar_noise),
        "human": sparse.noise_variance(parameters.human.raw_noise, preset.human_noise),
        "interaction": sparse.noise_variance(parameters.interaction.raw_noise, preset.interaction_noise),
        "dynamics": sparse.noise_variance(parameters.dynamics.raw_noise, preset.dynamics_noise),
    }


def terms(parameters: Parameters, task: Problem, points: PointArrays | None = None) -> dict[str, jax.Array]:
    """The parts of the negative log joint density, in nats; training minimises their sum."""
    points = task.points if points is None else points
    preset, noise, lat = task.preset, noises(parameters, task.preset), latents(parameters, task, points)
    now, previous, before = lat.steps
    below = jnp.concatenate([lat.avatar, lat.human], axis=1)
    step = now - dynamics_mean(previous, before, task.data.lag, preset)

    def layer(name: str, inputs: jax.Array, targets: Targets, counts: jax.Array, styles: jax.Array | None) -> jax.Array:
        return sparse.negative_log_likelihood(
            getattr(parameters, name), inputs, targets, noise[name], styles, preset.variational, counts, task.shards
        )

    avatar = task.avatar_targets._replace(thin=points.avatar)
    human = task.human_targets._replace(thin=points.human)
    following = dynamics_input(previous, before, task.data.lag)
    parts = {
        "avatar": layer("avatar", lat.avatar, avatar, points.counts, points.styles),
        "human": layer("human", lat.human, human, points.counts, None),
        "interaction": layer("interaction", lat.interaction, Targets(below, below.shape[1], 0.0), points.counts, None),
        "dynamics": layer("dynamics", following, Targets(step, step.shape[1], 0.0), points.follows, None),
    }
    if parameters.back is not None:  # the GP prior of the back constraint, in whitened weights
        whitened = (parameters.back.interaction, parameters.back.human, parameters.back.avatar)
        parts["back"] = 0.5 * jnp.sum(jnp.concatenate(whitened, axis=1) ** 2)
    if preset.return_tolerance > 0.0:  # a trial begins and ends in about the same pose
        gap = lat.avatar[task.first] - lat.avatar[task.last]
        parts["return"] = 0.5 * jnp.sum(gap**2) / preset.return_tolerance**2
    return parts


def objective(parameters: Parameters, task: Problem, points: PointArrays | None = None) -> jax.Array:
    """Negative log joint density a training point, from the points given, or from those of the task."""
    if task.mesh is not None:  # the gradient, too, is needed whole on every device
        parameters = jax.lax.with_sharding_constraint(parameters, NamedSharding(task.mesh, PartitionSpec()))
    return sum(terms(parameters, task, points).values(), start=jnp.zeros(())) / len(task.data.trial)

"""The trained model as a value: everything that responding, evaluation and pictures need, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.model.geometry.rotations import Array
from highfive.model.gp.mixture import GaussianMixture
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.contact_layer import ArmContactLayer, ContactLayer
from highfive.model.hgpdm.dataset import Channels
from highfive.model.hgpdm.features import FeatureMap
from highfive.model.hgpdm.intent_layer import IntentLayer
from highfive.model.hgpdm.pose_ensemble import PoseEnsemble
from highfive.model.hgpdm.presets import Preset
from highfive.model.hgpdm.task_space import TaskSpace


@dataclass(frozen=True)
class HGPDM:
    """A trained hierarchical Gaussian process dynamical model.

    Attributes:
        preset: what it was trained with.
        emotions: K names, the order of the style weights.
        skeleton_hash: hash of the skeleton whose joints it generates, '' where none was given.
        data_hash: digest of the training points.
        settings: seed, inducing inputs, steps and final objective of the training, and what became of each seed.
        joints: number of joint channels D.
        lag: s between the dynamics' successive latents.
        feature_map: from hand history to the features of the back projection.
        back: back projections from features to I, in order: one, with X¹ beside I (default), or r then s (paper).
        dynamics: from :func:`highfive.model.hgpdm.hierarchy.dynamics_input` to the step beyond the dynamics' mean.
        interaction: from I to X¹ and X², side by side.
        human: from X² to the hand points (6), m.
        avatar: from X¹ and a style to the avatar's channels, see :class:`highfive.model.hgpdm.dataset.Channels`.
        contact: from the features to where and when the palms will meet; None where it was not trained on trials.
        start_mean, start_covariance: (q,) and (q, q), I at the beginning of the training trials.
        interaction_latents, avatar_latents, human_latents: (N, q) at the training points, for pictures.
        trial, emotion: (N,) trial and emotion index of the training points.
        learning_curve: (steps,) objective after each step of the training; empty in files of an earlier version.
        arm_contact: from the whole arm to where and when the palms will meet; None where it was not trained on arms,
            as in files of an earlier version.
        task_space: how the palm is led to where the palms will meet; None where that was not learned.
        ensemble: what answers beside the hierarchy; None where nothing does, as in files of an earlier version.
        intent: from the hand to whether a contact is coming; None where nothing else than high fives was learned from,
            as in files of an earlier version.
        places: where reaches go; None in files of an earlier version.
    """

    preset: Preset
    emotions: tuple[str, ...]
    skeleton_hash: str
    data_hash: str
    settings: dict[str, Any]
    joints: int
    lag: float
    feature_map: FeatureMap
    back: tuple[Posterior, ...]
    dynamics: Posterior
    interaction: Posterior
    human: Posterior
    avatar: Posterior
    contact: ContactLayer | None
    start_mean: Array
    start_covariance: Array
    interaction_latents: NDArray[np.float32]
    avatar_latents: NDArray[np.float32]
    human_latents: NDArray[np.float32]
    trial: NDArray[np.int32]
    emotion: NDArray[np.int32]
    learning_curve: NDArray[np.float32]
    arm_contact: ArmContactLayer | None = None
    ensemble: PoseEnsemble | None = None
    task_space: TaskSpace | None = None
    intent: IntentLayer | None = None
    places: GaussianMixture | None = None

    @property
    def channels(self) -> Channels:
        """Where the quantities lie in the avatar layer's output."""
        return Channels(self.joints)

    def back_project(self, history: Array) -> Array:
        """Expected I (T, q), and X¹ (T, q_1) behind it if it is projected back, of hand histories (T, H + 1, 6), m."""
        from highfive.model.gp import sparse  # noqa: PLC0415 (JAX takes a second, and a session does without)

        values: Any = self.feature_map(history)
        for stage in self.back:
            values = sparse.means(stage, values)
        return np.asarray(values)

    def generate(self, interaction: Array, style: Array) -> Array:
        """Expected avatar channels (T, channels) of latents I (T, q) in one style (K,), going down the hierarchy."""
        from highfive.model.gp import sparse  # noqa: PLC0415

        below = sparse.means(self.interaction, np.asarray(interaction))
        styles = np.broadcast_to(np.asarray(style), (len(interaction), len(self.emotions)))
        return np.asarray(sparse.means(self.avatar, below[:, : self.preset.avatar_dims], styles))

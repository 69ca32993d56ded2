"""Joint training of the hierarchy, and the trained layers put together for use."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from highfive.model.errors import HighFiveError
from highfive.model.geometry.arm_chain import ArmChain
from highfive.model.geometry.rotations import Array
from highfive.model.gp import sparse
from highfive.model.gp.kernels import MotionKernel, add_jitter
from highfive.model.gp.optimise import ProgressCallback, State, minimise
from highfive.model.gp.posterior import Posterior
from highfive.model.gp.regression import learned
from highfive.model.gp.sparse import Layer, Targets
from highfive.model.hgpdm.arm_features import check_arms, have_arms
from highfive.model.hgpdm.checkpoint import Checkpoint
from highfive.model.hgpdm.contact_places import contact_places
from highfive.model.hgpdm.contact_training import fit_contact_layers
from highfive.model.hgpdm.dataset import AUXILIARY, TrainingSet, training_set
from highfive.model.hgpdm.hierarchy import (
    Latents,
    Parameters,
    PointArrays,
    Problem,
    back_weights,
    dynamics_input,
    dynamics_mean,
    gauge,
    latents,
    noises,
    objective,
    problem,
)
from highfive.model.hgpdm.initial import initial_parameters
from highfive.model.hgpdm.intent_training import fit_intent
from highfive.model.hgpdm.pose_ensemble_training import LeftOut, fit_ensemble, seen_arms
from highfive.model.hgpdm.presets import Preset, preset_named
from highfive.model.hgpdm.restarts import Best, Say, best_of
from highfive.model.hgpdm.sharding import spread
from highfive.model.hgpdm.task_space_training import fit_task_space
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Gesture, Trial
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class BackProjectionSettings(Settings):
    """How the back projections are made of trained layers. Noise and unexplained share: chosen on held-out simulated
    trials; bounds and steps by hand."""

    noise: float = setting(0.05, above=0.0)
    """Standard deviation of I and X¹ given the hand where they are learned functions of it: smooths ticks."""
    unexplained: float = setting(0.2, above=0.0, most=1.0)
    """Share of the prior's standard deviation, where inducing inputs are far, that these functions add."""
    bounds: tuple[float, float] = setting((1e-2, 1.0), above=0.0)
    """Of that noise where r and s are regressions fitted after training."""
    iterations: int = setting(60, "steps", least=1)
    """Of each of those regressions."""


BACK_PROJECTION = BackProjectionSettings()


def train(
    trials: Sequence[Trial],
    preset: Preset | str = "default",
    emotions: Sequence[str] | None = None,
    inducing: int = 200,
    seed: int = 0,
    skeleton_hash: str = "",
    progress: ProgressCallback | None = None,
    checkpoint: Path | str | None = None,
    restarts: int = 1,
    say: Say = lambda line: None,
    *,
    whole_arm: bool | None = None,
    chain: ArmChain | None = None,
    gestures: Sequence[Gesture] = (),
) -> HGPDM:
    """Trains a model on the trials that are not held out.

    Args:
        trials: recorded trials; those with ``test`` set are left out.
        preset: a preset or the name of one.
        emotions: order of the styles; by default in order of appearance.
        inducing: inducing inputs per layer.
        seed: seed of the choice of inducing inputs.
        skeleton_hash: stored in the model, so that it is not used with another skeleton.
        progress: called after every step.
        checkpoint: file that training writes as it goes and resumes from after an interruption; it stays there.
        restarts: so many seeds, from ``seed`` on; the one with the lowest objective is kept.
        say: called with a line about what a user should know: that it resumes, that a seed failed.
        whole_arm: elbow, shoulder and head, too, tell where and when palms will meet; None: if most trials have them.
        chain: the joints that carry the avatar's palm, which is led to where the palms will meet; None leads none.
        gestures: raised hands to which no contact comes; those held out are left out. Of none, the model does not learn
            to tell whether a contact is coming, and every raised hand is met.

    Raises:
        HighFiveError: the data cannot be learned from, or the optimisation fails; the message says what to change.
    """
    chosen = preset_named(preset) if isinstance(preset, str) else preset
    data = training_set(trials, chosen, emotions)
    task = problem(data, chosen)
    learned = [trial for trial in trials if not trial.test]
    arms = have_arms(learned) if whole_arm is None else whole_arm
    if arms:
        check_arms(learned)  # before a minute is spent on the hierarchy
    armed = learned if arms else ()
    model, left_out = _train_on(task, inducing, seed, skeleton_hash, progress, checkpoint, restarts, say, armed)
    contact, arm = fit_contact_layers(
        learned, model.feature_map, chosen.history, inducing, seed, progress, whole_arm=arms
    )
    led = None
    if chain is not None and left_out is not None:
        led = fit_task_space(learned, task, contact, left_out, chain)
    others = [gesture for gesture in gestures if not gesture.test]
    intent = fit_intent(learned, others, seed, progress) if others else None
    places = contact_places(learned, seed)
    return replace(model, contact=contact, arm_contact=arm, task_space=led, intent=intent, places=places)


def train_on(
    data: TrainingSet,
    chosen: Preset,
    inducing: int = 200,
    seed: int = 0,
    skeleton_hash: str = "",
    progress: ProgressCallback | None = None,
    checkpoint: Path | str | None = None,
    restarts: int = 1,
    say: Say = lambda line: None,
) -> HGPDM:
    """Trains a model on training points, whatever their channels are; see :func:`train`."""
    task = problem(data, chosen)
    return _train_on(task, inducing, seed, skeleton_hash, progress, checkpoint, restarts, say)[0]


def _train_on(
    task: Problem,
    inducing: int,
    seed: int,
    skeleton_hash: str,
    progress: ProgressCallback | None,
    checkpoint: Path | str | None,
    restarts: int,
    say: Say,
    armed: Sequence[Trial] = (),
) -> tuple[HGPDM, LeftOut | None]:
    """The model, and what its direct answers are of trials that were left out, where it has such answers.

    ``armed`` are the trials of the points, where the whole arm is to be learned from.
    """
    data, chosen = task.data, task.preset
    if inducing < 2:
        raise HighFiveError(f"{inducing} inducing inputs; at least 2 are needed, 200 are usual")
    if restarts < 1 or chosen.iterations < 1:
        raise HighFiveError(f"{restarts} restarts of {chosen.iterations} steps; at least one of each is needed")
    spread_task = spread(task)
    owner = {"preset": chosen.name, "steps": chosen.iterations, "inducing": inducing, "seed": seed}
    owner |= {"restarts": restarts, "data": data.data_hash, "values": f"{zlib.crc32(repr(chosen).encode()):08x}"}

    def optimise(
        start: Parameters, stage: str, resume: State | None, keep: Callable[[State], None]
    ) -> tuple[Parameters, list[float]]:
        def value(parameters: Parameters, points: PointArrays) -> jax.Array:
            return objective(parameters, spread_task, points)

        return minimise(
            value,
            start,
            chosen.iterations,
            chosen.adam_steps,
            stage=stage,
            progress=progress,
            resume=resume,
            keep=keep,
            arguments=(spread_task.points,),
        )

    best = best_of(
        optimise,
        lambda number: initial_parameters(task, inducing, np.random.default_rng(number)),
        seed,
        restarts,
        None if checkpoint is None else Checkpoint(Path(checkpoint), owner),
        say,
    )
    model = assemble(best.parameters, task, skeleton_hash, _settings(best, data, inducing), best.trace, progress)
    if not chosen.pooled:
        return model, None
    seen = seen_arms(armed, data) if armed else None
    ensemble, left_out = fit_ensemble(model, task, inducing, seed, progress, seen=seen)
    return replace(model, ensemble=ensemble), left_out


def _settings(best: Best[Parameters], data: TrainingSet, inducing: int) -> dict[str, Any]:
    """What the model's file says about its training."""
    return {
        "inducing": min(inducing, len(data.trial)),
        "seed": best.seed,
        "iterations": len(best.trace),
        "points": len(data.trial),
        "objective": best.trace[-1],
        "starts": [asdict(start) for start in best.starts],
    }


def assemble(
    parameters: Parameters,
    task: Problem,
    skeleton_hash: str,
    settings: dict[str, Any],
    learning_curve: Sequence[float] = (),
    progress: ProgressCallback | None = None,
) -> HGPDM:
    """The trained layers as posteriors, ready for use.

    Raises:
        HighFiveError: a layer is not finite.
    """
    preset, data, noise = task.preset, task.data, noises(parameters, task.preset)
    lat = latents(parameters, task)
    below = jnp.concatenate([lat.avatar, lat.human], axis=1)
    interaction = sparse.fit(parameters.interaction, lat.interaction, below, noise["interaction"])
    now, previous, before = lat.steps[:, task.successors]
    dynamics = sparse.fit(
        parameters.dynamics,
        dynamics_input(previous, before, data.lag),
        now - dynamics_mean(previous, before, data.lag, preset),
        noise["dynamics"],
    )
    human_latents, avatar_latents = lat.human, [lat.avatar]
    if preset.back_constrained:
        # Online, X² comes from I: its layer is fitted at what I gives. X¹ is projected back from the hand, as here, or
        # comes from I, too, while no hand is seen: its layer is fitted at both.
        reached = sparse.means(interaction, lat.interaction)
        human_latents = reached[:, preset.avatar_dims :]
        avatar_latents.append(reached[:, : preset.avatar_dims])
    avatar = _avatar_layer(parameters, task, avatar_latents, noise["avatar"])
    human = sparse.fit(
        parameters.human,
        human_latents,
        task.human_targets.thin,
        noise["human"],
        offset=jnp.asarray(task.human_offset),
        scale=jnp.asarray(task.human_scale),
    )
    starts = np.asarray(lat.interaction)[task.first]
    model = HGPDM(
        preset=preset,
        emotions=data.emotions,
        skeleton_hash=skeleton_hash,
        data_hash=data.data_hash,
        settings=settings,
        joints=data.outputs.shape[1] - AUXILIARY,
        lag=data.lag,
        feature_map=task.feature_map,
        back=_back_projections(parameters, task, lat, progress),
        dynamics=dynamics,
        interaction=interaction,
        human=human,
        avatar=avatar,
        contact=None,
        start_mean=starts.mean(axis=0),
        start_covariance=np.atleast_2d(np.cov(starts.T)) + 1e-4 * np.eye(starts.shape[1])
        if len(starts) > 1
        else 0.1 * np.eye(starts.shape[1]),
        interaction_latents=np.asarray(lat.interaction, dtype=np.float32),
        avatar_latents=np.asarray(lat.avatar, dtype=np.float32),
        human_latents=np.asarray(human_latents, dtype=np.float32),
        trial=data.trial.astype(np.int32),
        emotion=np.argmax(data.styles, axis=1).astype(np.int32),
        learning_curve=np.asarray(learning_curve, dtype=np.float32),
    )
    layers = (dynamics, interaction, human, avatar, *model.back)
    if not all(np.all(np.isfinite(array)) for array in jax.tree.leaves(layers)):
        raise HighFiveError("the trained layers are not finite; use another seed or fewer inducing inputs")
    return model


def _avatar_layer(parameters: Parameters, task: Problem, inputs: Sequence[jax.Array], noise: jax.Array) -> Posterior:
    """From X¹ to the channels, given several X¹ (N, q) of the same points."""
    offset, scale = jnp.asarray(task.avatar_offset), jnp.asarray(task.avatar_scale)
    scaled, styles = (jnp.asarray(task.data.outputs) - offset) / scale, jnp.asarray(task.data.styles)
    latent, scaled, styles = jnp.concatenate(inputs), *(jnp.tile(part, (len(inputs), 1)) for part in (scaled, styles))
    layer = sparse.fit(parameters.avatar, latent, scaled, noise, styles, offset, scale)
    if task.preset.channel_noise:
        left = (sparse.means(layer, latent, styles) - offset) / scale - scaled
        layer = layer._replace(noise=jnp.maximum(jnp.mean(left**2, axis=0), task.preset.avatar_noise[0] ** 2))
    return layer


def _back_projections(
    parameters: Parameters, task: Problem, lat: Latents, progress: ProgressCallback | None
) -> tuple[Posterior, ...]:
    """From features to I and X¹: the learned back constraint; or to I: the regressions r and s of the paper."""
    if parameters.back is None:
        features = jnp.asarray(task.features)
        r = _regression(features, lat.human, parameters.human.inducing.shape[0], "back projection r", progress)
        s = _regression(lat.human, lat.interaction, parameters.human.inducing.shape[0], "back projection s", progress)
        return r, s
    back, dims = parameters.back, (parameters.back.interaction.shape[1], parameters.back.avatar.shape[1])
    weights = back_weights(back)
    weights = jnp.concatenate([weights[:, : dims[0]], weights[:, -dims[1] :]], axis=1)
    plain = Posterior(back.kernel, back.inducing, None, None, weights, jnp.zeros(()), weights, weights, weights)
    centre, deviation = gauge(sparse.means(plain, task.features))
    k_uu = add_jitter(back.kernel.cross(back.inducing, back.inducing))
    # The variance that inducing inputs leave unexplained is small near the training data and large far from it. A share
    # of it is enough to notice strangers; all of it would hold the filter back where the functions are right.
    reduction, scale = cast(jax.Array, jnp.linalg.inv(k_uu)), BACK_PROJECTION.unexplained / deviation
    noise = (BACK_PROJECTION.noise / scale) ** 2
    return (
        Posterior(
            back.kernel,
            back.inducing,
            None,
            None,
            weights / deviation,
            -centre / deviation,
            reduction,
            noise,
            scale,
        ),
    )


def _regression(
    inputs: Array | jax.Array, values: jax.Array, inducing: int, stage: str, progress: ProgressCallback | None
) -> Posterior:
    """A sparse GP regression (N, F) → (N, q) with its hyperparameters learned."""
    points = np.asarray(inputs)
    chosen = np.linspace(0, len(points) - 1, min(inducing, len(points))).astype(int)
    kernel = MotionKernel.initial(points.shape[1])
    layer = Layer(kernel, jnp.asarray(points[chosen]), sparse.raw_noise(0.3, BACK_PROJECTION.bounds))
    targets = Targets(values, values.shape[1], 0.0)
    bounds, steps = BACK_PROJECTION.bounds, BACK_PROJECTION.iterations
    layer, noise = learned(layer, jnp.asarray(points), targets, bounds, steps, 0, stage, progress)
    return sparse.fit(layer, jnp.asarray(points), values, noise)

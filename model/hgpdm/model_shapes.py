"""Whether the parts of a model fit together: what a file must hold, however it was damaged."""

from __future__ import annotations

import numpy as np

from highfive.model.gp.mixture import GaussianMixture
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.arm_features import SIZE, ArmFeatures
from highfive.model.hgpdm.contact_layer import CHANNELS, KNOTS, SPEEDS, ContactLayer
from highfive.model.hgpdm.dataset import AUXILIARY, HAND_DIMS
from highfive.model.hgpdm.intent_features import SIZE as INTENT_SIZE
from highfive.model.hgpdm.pose_ensemble import PoseEnsemble
from highfive.model.hgpdm.task_space import KNOTS as TASK_KNOTS
from highfive.model.hgpdm.task_space import TaskSpace
from highfive.model.hgpdm.tempo import TEMPO
from highfive.model.hgpdm.trained import HGPDM


def check_shapes(model: HGPDM) -> None:
    """Raises ValueError unless the layers fit together."""
    preset, history = model.preset, HAND_DIMS * (len(model.preset.history) + 1)
    dims, below = preset.interaction_dims, preset.avatar_dims + preset.human_dims
    expected = {
        "dynamics": (2 * dims, dims),
        "interaction": (dims, below),
        "human": (preset.human_dims, HAND_DIMS),
        "avatar": (preset.avatar_dims, model.joints + AUXILIARY),
    }
    for name, (inputs, outputs) in expected.items():
        _check_layer(name, getattr(model, name), inputs, outputs)
    inputs = len(model.feature_map.offset)
    if model.feature_map.matrix.shape != (inputs, history):
        raise ValueError(f"features of shape {model.feature_map.matrix.shape}, expected {(inputs, history)}")
    _check_beside(model, inputs)
    for number, stage in enumerate(model.back):
        _check_layer(f"back.{number}", stage, inputs, stage.weights.shape[1])
        inputs = stage.weights.shape[1]
    projected = dims + preset.avatar_dims if preset.back_constrained else dims
    if inputs != projected or model.start_mean.shape != (dims,) or model.start_covariance.shape != (dims, dims):
        raise ValueError(f"interaction latents projected to {inputs} dimensions, expected {projected}")
    style = model.avatar.style_covariance
    if style is None or style.shape != (len(model.emotions),) * 2:
        raise ValueError(f"the avatar layer does not have {len(model.emotions)} styles")


def _check_beside(model: HGPDM, inputs: int) -> None:
    """Raises ValueError unless what stands beside the hierarchy fits; ``inputs`` are the hand's features."""
    if model.contact is not None:
        _check_layer("contact", model.contact.posterior, inputs, CHANNELS)
        _check_calibration(model.contact)
    if model.arm_contact is not None:
        _check_arm_features(model.arm_contact.features)
        _check_layer("arm_contact", model.arm_contact.layer.posterior, SIZE, CHANNELS)
        _check_calibration(model.arm_contact.layer)
        _check_share(model.arm_contact.share)
    if model.ensemble is not None:
        _check_ensemble(model.ensemble, inputs, model.joints + AUXILIARY, len(model.emotions))
        if model.ensemble.arm is not None and model.arm_contact is None:
            raise ValueError("its pose is told by the whole arm, of which no layer says where palms meet")
    if model.task_space is not None:
        _check_task_space(model.task_space, model.joints)
    if model.intent is not None:
        intent = model.intent.features
        if intent.centre.shape != (INTENT_SIZE,) or intent.factor.shape != (INTENT_SIZE,):
            raise ValueError(f"features of the intent of shape {intent.factor.shape}, expected {(INTENT_SIZE,)}")
        _check_layer("intent", model.intent.posterior, INTENT_SIZE, 1)
        if model.intent.squash.shape != (2,):
            raise ValueError(f"a calibration of the intent of shape {model.intent.squash.shape}, expected (2,)")
    if model.places is not None:
        _check_places(model.places)


def _check_places(places: GaussianMixture) -> None:
    count = len(places.weights)
    shapes = places.weights.shape, places.points.shape, places.covariances.shape
    if count == 0 or shapes != ((count,), (count, 3), (count, 3, 3)):
        raise ValueError(f"places of shapes {shapes}")
    if places.weights.min() < 0.0 or not np.isclose(places.weights.sum(), 1.0):
        raise ValueError(f"places that weigh {places.weights.tolist()}, expected shares of 1")
    np.linalg.cholesky(places.covariances)  # LinAlgError is a ValueError


def _check_arm_features(features: ArmFeatures) -> None:
    shapes = features.centre.shape, features.factor.shape, features.furthest.shape
    if shapes != ((SIZE,), (SIZE,), (TEMPO,)):
        raise ValueError(f"features of the arm of shapes {shapes}, expected {((SIZE,), (SIZE,), (TEMPO,))}")


def _check_share(share: float) -> None:
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"a share of the whole arm of {share}, expected 0 to 1")


def _check_ensemble(ensemble: PoseEnsemble, inputs: int, channels: int, styles: int) -> None:
    _check_layer("direct", ensemble.regression, inputs, channels)
    styled = [ensemble.regression.style_covariance]
    if (arm := ensemble.arm) is not None:
        _check_layer("direct_arm", arm.regression, SIZE, channels)
        _check_arm_features(arm.features)
        styled.append(arm.regression.style_covariance)
        if arm.share.shape != ():
            raise ValueError(f"shares of the whole arm of shape {arm.share.shape}, expected ()")
        _check_share(float(arm.share))
    shapes = [None if style is None else style.shape for style in styled]
    if shapes != [(styles, styles)] * len(styled) or ensemble.spread.shape != (channels,):
        raise ValueError(f"direct answers do not have {styles} styles and {channels} channels")
    near = ensemble.neighbours
    count, size = len(near.features), len(near.basis)
    shapes = tuple(getattr(near, name).shape for name in ("features", "scores", "basis", "offset", "first", "usual"))
    if shapes != ((count, inputs), (count, size), (size, channels), (channels,), (styles + 1,), ()):
        raise ValueError(f"neighbours of shapes {shapes}")
    if near.first[0] != 0 or near.first[-1] != count or np.any(np.diff(near.first) < 0):
        raise ValueError(f"neighbours of styles that begin at {near.first.tolist()}, of {count} points")


def _check_task_space(space: TaskSpace, joints: int) -> None:
    chain = space.chain
    count = len(chain.joints)
    shapes = (*(part.shape for part in chain), space.covariance.shape, space.slopes.shape)
    size = 3 + 3 * count
    if shapes != ((count,), (count, 3), (count, 3, 3), (3,), (size, size), (2, len(TASK_KNOTS))):
        raise ValueError(f"a task space of shapes {shapes}")
    if count == 0 or chain.joints.min() < 0 or 3 * chain.joints.max() >= joints:
        raise ValueError(f"a palm carried by joints {chain.joints.tolist()}, of {joints // 3}")


def _check_calibration(layer: ContactLayer) -> None:
    if layer.calibration.shape != (expected := (len(KNOTS), len(SPEEDS), 3)):
        raise ValueError(f"a calibration of shape {layer.calibration.shape}, expected {expected}")


def _check_layer(name: str, layer: Posterior, inputs: int, outputs: int) -> None:
    count = layer.inducing.shape[0]
    if layer.noise.shape not in ((), (1,), (outputs,)):
        raise ValueError(f"layer {name} has noise of shape {layer.noise.shape}")
    shapes = (layer.inducing.shape, layer.weights.shape, layer.reduction.shape, layer.offset.shape, layer.scale.shape)
    if shapes != ((count, inputs), (count, outputs), (count, count), (outputs,), (outputs,)):
        raise ValueError(f"layer {name} has shapes {shapes}, expected {inputs} inputs and {outputs} outputs")
    if np.any(np.asarray(layer.noise) < 0.0):
        raise ValueError(f"layer {name} has a noise of {np.min(np.asarray(layer.noise)):g}, expected 0 or more")
    sizes = [np.shape(getattr(layer.kernel, part, np.zeros(inputs))) for part in ("log_lengthscale", "log_linear")]
    if sizes != [(inputs,), (inputs,)]:  # of a kernel that has both; a session needs no JAX to look
        raise ValueError(f"layer {name} has a kernel of {sizes}, expected {inputs} inputs")

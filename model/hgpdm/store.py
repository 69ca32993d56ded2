"""Models as .safetensors files: arrays and a JSON description, data only, checked on the way in."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from highfive.model.errors import HighFiveError
from highfive.model.files import DEFAULT_MODEL, check_size, write_whole
from highfive.model.geometry.arm_chain import ArmChain
from highfive.model.geometry.rotations import Array
from highfive.model.gp.posterior import MotionParameters, Posterior
from highfive.model.hgpdm.arm_features import SIZE, ArmFeatures
from highfive.model.hgpdm.contact_layer import CHANNELS, KNOTS, SPEEDS, ArmContactLayer, ContactLayer
from highfive.model.hgpdm.dataset import AUXILIARY, HAND_DIMS
from highfive.model.hgpdm.features import FeatureMap
from highfive.model.hgpdm.intent_features import SIZE as INTENT_SIZE
from highfive.model.hgpdm.intent_features import IntentFeatures
from highfive.model.hgpdm.intent_layer import IntentLayer
from highfive.model.hgpdm.pose_ensemble import ArmAnswer, Neighbours, PoseEnsemble
from highfive.model.hgpdm.presets import Preset
from highfive.model.hgpdm.task_space import KNOTS as TASK_KNOTS
from highfive.model.hgpdm.task_space import TaskSpace
from highfive.model.hgpdm.tempo import TEMPO
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.toml_file import is_table

VERSION = 4
MOST_BYTES = 2 << 30
"""Of a file; the model that comes along has 6 MB."""
KIND = "high-five hgpdm"
LAYERS = ("dynamics", "interaction", "human", "avatar")
ARRAYS = ("start_mean", "start_covariance")
PICTURED = ("interaction_latents", "avatar_latents", "human_latents", "learning_curve")  # float32: for pictures only
INDICES = ("trial", "emotion")
ARM_FEATURES = tuple(field.name for field in fields(ArmFeatures))
NEIGHBOURS = tuple(field.name for field in fields(Neighbours))

# What the library raises: the others where NumPy has no such type (bfloat16, …) or shape, or there is no room.
_UNREADABLE = (SafetensorError, TypeError, AttributeError, ValueError, MemoryError)
# What values make that have another type, shape or size than a model's.
_MALFORMED = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError)


def save_model(model: HGPDM, path: Path | str, *, replace: bool = True) -> None:
    """Writes a model in one piece: after a failure the old file, or none, is there.

    Raises:
        HighFiveError: it cannot be written, or there is such a file and it may not be replaced.
    """
    arrays = {name: np.asarray(getattr(model, name)) for name in (*ARRAYS, *PICTURED, *INDICES)}
    arrays |= {"features.matrix": model.feature_map.matrix, "features.offset": model.feature_map.offset}
    for name in LAYERS:
        arrays |= _layer_arrays(name, getattr(model, name))
    for number, stage in enumerate(model.back):
        arrays |= _layer_arrays(f"back.{number}", stage)
    if model.contact is not None:
        arrays |= _layer_arrays("contact", model.contact.posterior) | {"contact.scales": model.contact.scales}
    if model.arm_contact is not None:
        arrays |= _layer_arrays("arm_contact", model.arm_contact.layer.posterior)
        arrays |= {"arm_contact.scales": model.arm_contact.layer.scales}
        arrays |= _arm_arrays("arm_features", model.arm_contact.features)
    if model.ensemble is not None:
        arrays |= _layer_arrays("direct", model.ensemble.regression) | {"direct.spread": model.ensemble.spread}
        arrays |= {f"neighbours.{name}": getattr(model.ensemble.neighbours, name) for name in NEIGHBOURS}
        if (arm := model.ensemble.arm) is not None:
            arrays |= _layer_arrays("direct_arm", arm.regression) | {"direct_arm.share": arm.share}
            arrays |= _arm_arrays("direct_arm_features", arm.features)
    if model.task_space is not None:
        space = model.task_space
        arrays |= {f"palm_chain.{name}": value for name, value in space.chain._asdict().items()}
        arrays |= {"task_space.covariance": space.covariance, "task_space.slopes": space.slopes}
    if model.intent is not None:
        arrays |= _layer_arrays("intent", model.intent.posterior) | {"intent.squash": model.intent.squash}
        arrays |= {f"intent_features.{name}": getattr(model.intent.features, name) for name in ("centre", "factor")}
    description = {
        "kind": KIND,
        "version": VERSION,
        "preset": asdict(model.preset),
        "emotions": model.emotions,
        "skeleton_hash": model.skeleton_hash,
        "data_hash": model.data_hash,
        "settings": model.settings,
        "joints": model.joints,
        "lag": model.lag,
        "stages": len(model.back),
    }
    content = save({k: np.asarray(v, order="C") for k, v in arrays.items()}, {"model": json.dumps(description)})
    try:
        write_whole(Path(path), content, replace=replace)
    except OSError as error:
        raise HighFiveError(f"cannot write the model to {path}: {error.strerror or error}") from None


def load_model(path: Path | str = DEFAULT_MODEL, skeleton_hash: str | None = None) -> HGPDM:
    """Reads a model.

    Args:
        path: a file written by :func:`save_model`; the model that ships with the project by default.
        skeleton_hash: hash that the model's skeleton must have; None accepts any.

    Raises:
        HighFiveError: no such file, not a model, truncated, of another version or another skeleton.
    """
    if not Path(path).is_file():
        raise HighFiveError(f"no model file {path}; `highfive train` makes one")
    try:
        metadata, arrays = _read(Path(path))
    except (*_UNREADABLE, OSError) as error:
        raise HighFiveError(f"{path} is not a model file, or it is cut short ({error})") from None
    try:
        description: Any = json.loads(metadata.get("model", "{}"))
    except (ValueError, RecursionError):
        description = {}
    if not is_table(description) or description.get("kind") != KIND:
        raise HighFiveError(f"{path} is a safetensors file but not a High Five model")
    if description.get("version") != VERSION:
        raise HighFiveError(
            f"{path} has format version {description.get('version')}, this is {VERSION}; train it again"
        )
    found = description.get("skeleton_hash")
    if skeleton_hash is not None and found != skeleton_hash:
        raise HighFiveError(
            f"{path} was trained for skeleton {found or 'unknown'}, expected {skeleton_hash}; train it again"
        )
    try:
        model = _build(description, arrays)
        _check_shapes(model)
    except _MALFORMED as error:
        raise HighFiveError(f"{path} is a damaged model: {type(error).__name__} {error}") from None
    return model


def save_layer(layer: Posterior, path: Path | str) -> None:
    """Writes one trained layer in one piece."""
    arrays = {key: np.asarray(value, order="C") for key, value in _layer_arrays("layer", layer).items()}
    try:
        write_whole(Path(path), save(arrays))
    except OSError as error:
        raise HighFiveError(f"cannot write {path}: {error.strerror}") from None


def load_layer(path: Path | str) -> Posterior:
    """Reads what :func:`save_layer` wrote.

    Raises:
        HighFiveError: the file is missing or damaged.
    """
    try:
        return _layer("layer", _read(Path(path))[1])
    except (*_UNREADABLE, *_MALFORMED, OSError) as error:
        raise HighFiveError(f"{path} is not a trained layer ({error}); delete it to train it again") from None


def _read(path: Path) -> tuple[Mapping[str, str], dict[str, Array]]:
    """The texts and the arrays of a file."""
    check_size(path, MOST_BYTES)
    with safe_open(str(path), framework="numpy") as file:
        return file.metadata() or {}, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)


def _layer_arrays(name: str, layer: Posterior) -> dict[str, Array]:
    values = {f"{name}.{key}": value for key, value in layer._asdict().items() if key != "kernel"}
    if isinstance(layer.kernel, MotionParameters):
        values |= {f"{name}.kernel.{field}": value for field, value in layer.kernel._asdict().items()}
    else:
        from highfive.model.hgpdm.stored_kernel import kernel_arrays  # noqa: PLC0415 (JAX takes a second)

        values |= kernel_arrays(f"{name}.kernel", layer.kernel)
    return {key: np.asarray(value) for key, value in values.items() if value is not None}


def _layer(name: str, arrays: dict[str, Array]) -> Posterior:
    optional = ("style", "style_covariance")
    rest = {}
    for field in Posterior._fields:
        key = f"{name}.{field}"
        if field != "kernel":
            rest[field] = None if field in optional and key not in arrays else arrays[key]
    return Posterior(_kernel(f"{name}.kernel", arrays), **rest)


def _kernel(name: str, arrays: dict[str, Array]) -> Any:
    """The parameters of the kernel that the online tick computes; another kernel as itself."""
    if f"{name}.{MotionParameters._fields[0]}" in arrays:
        return MotionParameters(*(arrays[f"{name}.{field}"] for field in MotionParameters._fields))
    from highfive.model.hgpdm.stored_kernel import kernel_of  # noqa: PLC0415 (JAX takes a second)

    return kernel_of(name, arrays)


def _build(description: Mapping[str, Any], arrays: dict[str, Array]) -> HGPDM:
    for name, values in arrays.items():
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            raise ValueError(f"{name} holds NaN or infinity")
    preset: dict[str, Any] = dict(description["preset"])
    for field in fields(Preset):
        if isinstance(preset.get(field.name), list):
            preset[field.name] = tuple(preset[field.name])
    return HGPDM(
        preset=Preset(**preset),
        emotions=tuple(description["emotions"]),
        skeleton_hash=str(description["skeleton_hash"]),
        data_hash=str(description["data_hash"]),
        settings=dict(description["settings"]),
        joints=int(description["joints"]),
        lag=float(description["lag"]),
        feature_map=FeatureMap(arrays["features.matrix"], arrays["features.offset"]),
        back=tuple(_layer(f"back.{number}", arrays) for number in range(int(description["stages"]))),
        dynamics=_layer("dynamics", arrays),
        interaction=_layer("interaction", arrays),
        human=_layer("human", arrays),
        avatar=_layer("avatar", arrays),
        contact=ContactLayer(_layer("contact", arrays), _by_speed(arrays["contact.scales"]))
        if "contact.scales" in arrays
        else None,
        start_mean=arrays["start_mean"],
        start_covariance=arrays["start_covariance"],
        interaction_latents=arrays["interaction_latents"].astype(np.float32),
        avatar_latents=arrays["avatar_latents"].astype(np.float32),
        human_latents=arrays["human_latents"].astype(np.float32),
        trial=arrays["trial"].astype(np.int32),
        emotion=arrays["emotion"].astype(np.int32),
        learning_curve=arrays.get("learning_curve", np.zeros(0)).astype(np.float32),
        arm_contact=ArmContactLayer(
            _arm_features("arm_features", arrays),
            ContactLayer(_layer("arm_contact", arrays), _by_speed(arrays["arm_contact.scales"])),
        )
        if "arm_contact.scales" in arrays
        else None,
        task_space=_task_space(arrays) if "task_space.slopes" in arrays else None,
        ensemble=PoseEnsemble(
            _layer("direct", arrays),
            _neighbours(arrays),
            arrays["direct.spread"],
            _arm_answer(arrays) if "direct_arm.share" in arrays else None,
        )
        if "direct.spread" in arrays
        else None,
        intent=IntentLayer(
            IntentFeatures(arrays["intent_features.centre"], arrays["intent_features.factor"]),
            _layer("intent", arrays),
            arrays["intent.squash"],
        )
        if "intent.squash" in arrays
        else None,
    )


def _arm_arrays(name: str, features: ArmFeatures) -> dict[str, Array]:
    return {f"{name}.{field}": getattr(features, field) for field in ARM_FEATURES}


def _arm_features(name: str, arrays: Mapping[str, Any]) -> ArmFeatures:
    if f"{name}.furthest" not in arrays:
        raise ValueError("its layer of the whole arm knows no tempo; train it again")
    return ArmFeatures(*(arrays[f"{name}.{field}"] for field in ARM_FEATURES))


def _arm_answer(arrays: dict[str, Any]) -> ArmAnswer:
    return ArmAnswer(
        _arm_features("direct_arm_features", arrays), _layer("direct_arm", arrays), arrays["direct_arm.share"]
    )


def _task_space(arrays: Mapping[str, Any]) -> TaskSpace:
    chain = ArmChain(*(arrays[f"palm_chain.{name}"] for name in ArmChain._fields))
    return TaskSpace(chain, arrays["task_space.covariance"], arrays["task_space.slopes"])


def _neighbours(arrays: Mapping[str, Any]) -> Neighbours:
    return Neighbours(**{name: arrays[f"neighbours.{name}"] for name in NEIGHBOURS})


def _check_shapes(model: HGPDM) -> None:
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
        _check_scales(model.contact)
    if model.arm_contact is not None:
        _check_arm_features(model.arm_contact.features)
        _check_layer("arm_contact", model.arm_contact.layer.posterior, SIZE, CHANNELS)
        _check_scales(model.arm_contact.layer)
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


def _check_arm_features(features: ArmFeatures) -> None:
    shapes = features.centre.shape, features.factor.shape, features.furthest.shape
    if shapes != ((SIZE,), (SIZE,), (TEMPO,)):
        raise ValueError(f"features of the arm of shapes {shapes}, expected {((SIZE,), (SIZE,), (TEMPO,))}")


def _check_ensemble(ensemble: PoseEnsemble, inputs: int, channels: int, styles: int) -> None:
    _check_layer("direct", ensemble.regression, inputs, channels)
    styled = [ensemble.regression.style_covariance]
    if (arm := ensemble.arm) is not None:
        _check_layer("direct_arm", arm.regression, SIZE, channels)
        _check_arm_features(arm.features)
        styled.append(arm.regression.style_covariance)
        if arm.share.shape != () or not 0.0 <= arm.share <= 1.0:
            raise ValueError(f"a share of the whole arm of {arm.share}, expected 0 to 1")
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


def _by_speed(scales: Array) -> Array:
    """Factors of a contact layer; a model of before knows them by time alone."""
    return np.repeat(scales[:, None], len(SPEEDS), axis=1) if scales.ndim == 2 else np.array(scales)


def _check_scales(layer: ContactLayer) -> None:
    if layer.scales.shape != (expected := (len(KNOTS), len(SPEEDS), 2)):
        raise ValueError(f"a calibration of shape {layer.scales.shape}, expected {expected}")


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

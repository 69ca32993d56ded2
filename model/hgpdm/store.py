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
from highfive.model.gp.mixture import GaussianMixture
from highfive.model.gp.posterior import MotionParameters, Posterior
from highfive.model.hgpdm.arm_features import ArmFeatures
from highfive.model.hgpdm.contact_layer import ARM_SHARE, SPEEDS, ArmContactLayer, ContactLayer
from highfive.model.hgpdm.features import FeatureMap
from highfive.model.hgpdm.intent_features import IntentFeatures
from highfive.model.hgpdm.intent_layer import IntentLayer
from highfive.model.hgpdm.model_shapes import check_shapes
from highfive.model.hgpdm.pose_ensemble import ArmAnswer, Neighbours, PoseEnsemble
from highfive.model.hgpdm.presets import Preset
from highfive.model.hgpdm.task_space import TaskSpace
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
PLACES = tuple(field.name for field in fields(GaussianMixture))
NEIGHBOURS = tuple(field.name for field in fields(Neighbours))
_TEMPO = {
    "arm_contact.weights": "arm_features.furthest",
    "direct_arm.share": "direct_arm_features.furthest",
}
"""What a layer of the whole arm is told by, and what it lacks in a file of before it knew the tempo of a reach."""

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
        arrays |= _layer_arrays("contact", model.contact.posterior)
        arrays |= {"contact.calibration": model.contact.calibration}
    if model.arm_contact is not None:
        arrays |= _layer_arrays("arm_contact", model.arm_contact.layer.posterior)
        arrays |= {"arm_contact.calibration": model.arm_contact.layer.calibration}
        arrays |= {"arm_contact.share": np.array(model.arm_contact.share)}
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
    if model.places is not None:
        arrays |= {f"places.{name}": getattr(model.places, name) for name in PLACES}
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
        what = f"{path} is no file" if Path(path).exists() else f"no model file {path}"
        raise HighFiveError(f"{what}; `highfive train` makes one")
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
    if any(part in arrays and tempo not in arrays for part, tempo in _TEMPO.items()):
        raise HighFiveError(
            f"{path} was made by an earlier version of High Five, whose layer of the whole arm knows no tempo; "
            "train it again"
        )
    try:
        model = _build(description, arrays)
        check_shapes(model)
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
        contact=_contact_layer("contact", arrays) if "contact.weights" in arrays else None,
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
            _contact_layer("arm_contact", arrays),
            float(arrays.get("arm_contact.share", ARM_SHARE)),
        )
        if "arm_contact.weights" in arrays
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
        places=GaussianMixture(*(arrays[f"places.{name}"] for name in PLACES)) if "places.weights" in arrays else None,
    )


def _arm_arrays(name: str, features: ArmFeatures) -> dict[str, Array]:
    return {f"{name}.{field}": getattr(features, field) for field in ARM_FEATURES}


def _arm_features(name: str, arrays: Mapping[str, Any]) -> ArmFeatures:
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


def _contact_layer(name: str, arrays: dict[str, Array]) -> ContactLayer:
    """A model of before knows its factors alone, and the oldest those by time alone."""
    if (known := arrays.get(f"{name}.calibration")) is None:
        scales = arrays[f"{name}.scales"]
        scales = np.repeat(scales[:, None], len(SPEEDS), axis=1) if scales.ndim == 2 else scales
        known = np.concatenate([np.zeros((*scales.shape[:2], 1)), scales], axis=2)
    return ContactLayer(_layer(name, arrays), np.array(known))

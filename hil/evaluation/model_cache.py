"""What is trained for an evaluation, kept in a folder so that an interrupted evaluation goes on where it was."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from highfive.hil.evaluation.reaction_models import fitted
from highfive.hil.sim.avatar import avatar_arm, avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.evaluation import baselines
from highfive.model.evaluation.nuisi_windows import Windows, window_set
from highfive.model.files import UNFINISHED
from highfive.model.gp.optimise import ProgressCallback
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm import training
from highfive.model.hgpdm.adaptation import ADAPTATION, adapt
from highfive.model.hgpdm.dataset import training_set
from highfive.model.hgpdm.hierarchy import Problem, problem
from highfive.model.hgpdm.presets import DEFAULT, Preset
from highfive.model.hgpdm.store import VERSION, load_layer, load_model, save_layer, save_model
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.reaction import FitReactionModel, ReactionModel

_KEPT = re.compile(r"(hgpdm|adapted|sparse_gp|windows)_[0-9a-f]{16}(\.safetensors|\.checkpoint\.npz(\.old(-\d+)?)?)")


@dataclass(frozen=True)
class Fitted:
    """The model and the trained baseline of one training.

    Attributes:
        model: the model.
        task: the training points as the baselines see them, of the emotions that the trials have.
        sparse_gp: the plain sparse GP.
        others: models of somebody else's, by name.
        adapted: a model that was trained before, adapted to the same trials; None where none was given.
    """

    model: HGPDM
    task: Problem
    sparse_gp: Posterior
    others: Mapping[str, ReactionModel] = field(default_factory=dict)
    adapted: HGPDM | None = None

    @property
    def emotions(self) -> list[str]:
        """What both the model and the baselines have learned."""
        return [emotion for emotion in self.model.emotions if emotion in self.task.data.emotions]


def fit(
    trials: Sequence[Trial],
    preset: Preset,
    inducing: int,
    seed: int,
    kept: Path | None = None,
    progress: ProgressCallback | None = None,
    model: HGPDM | None = None,
    others: Mapping[str, FitReactionModel] = MappingProxyType({}),
    prior: HGPDM | None = None,
) -> Fitted:
    """Trains on the trials that are not held out.

    Args:
        trials: all trials.
        preset: of the model.
        inducing: inducing inputs of each layer and of the sparse GP.
        seed: seed of the choice of inducing inputs.
        kept: folder in which what was trained before is looked for, and to which it goes; None trains afresh.
        progress: called after every step.
        model: a model that is trained already.
        others: learn models of somebody else's, by name; these are not kept.
        prior: a model that was trained before, to be adapted to the same trials beside the training.

    Raises:
        HighFiveError: the data cannot be learned from.
        PluginError: a model of somebody else's fails.
    """
    if model is None:
        model = _model(trials, preset, inducing, seed, kept, progress)
    task = problem(training_set(trials, DEFAULT), DEFAULT)
    plain = _sparse_gp(task, model.avatar.inducing.shape[0], seed, kept, progress)
    taught = {name: fitted(name, learn, trials) for name, learn in others.items()}
    return Fitted(model, task, plain, taught, None if prior is None else _adapted(prior, trials, seed, kept))


def _adapted(prior: HGPDM, trials: Sequence[Trial], seed: int, kept: Path | None) -> HGPDM:
    data = training_set(trials, prior.preset)
    weights = hashlib.sha256(prior.avatar.weights.tobytes()).hexdigest()  # two may have learned from one data set
    key = f"{prior.data_hash} {prior.settings} {weights} {ADAPTATION!r} {seed} {data.data_hash} {_arms(trials)}"
    path = _path(kept, "adapted", key)
    if path is not None and path.is_file():
        return load_model(path, prior.skeleton_hash)
    model, _ = adapt(prior, trials, seed)
    if path is not None:
        save_model(model, path)
    return model


def _arms(trials: Sequence[Trial]) -> str:
    """Digest of elbow, shoulder and head, which the data's own hash leaves out."""
    points = (trial.arm_points.tobytes() for trial in trials if trial.arm_points is not None)
    return hashlib.sha256(b"".join(points)).hexdigest()


def fit_windows(
    learn: Windows,
    preset: Preset,
    inducing: int,
    seed: int,
    kept: Path | None = None,
    progress: ProgressCallback | None = None,
) -> Fitted:
    """Trains on the windows of a benchmark; see :func:`fit`."""
    data = window_set(learn)
    task = problem(data, preset)
    # The model is no avatar's and has no file: its finished checkpoint stays, and is put together anew.
    checkpoint = _path(kept, "windows", f"{preset!r} {inducing} {seed} {data.data_hash}", ".checkpoint.npz")
    model = training.train_on(data, preset, inducing, seed, "", progress, checkpoint)
    return Fitted(model, task, _sparse_gp(task, inducing, seed, kept, progress))


def _sparse_gp(
    task: Problem, inducing: int, seed: int, kept: Path | None, progress: ProgressCallback | None
) -> Posterior:
    path = _path(kept, "sparse_gp", f"{task.preset!r} {inducing} {seed} {task.data.data_hash}")
    if path is not None and path.is_file():
        return load_layer(path)
    layer = baselines.sparse_gp(task, inducing, np.random.default_rng(seed), progress)
    if path is not None:
        save_layer(layer, path)
    return layer


def _model(
    trials: Sequence[Trial],
    preset: Preset,
    inducing: int,
    seed: int,
    kept: Path | None,
    progress: ProgressCallback | None,
) -> HGPDM:
    skeleton, data = avatar_skeleton().hash, training_set(trials, preset)
    layers = partial(training.train, trials, preset, None, inducing, seed, skeleton, progress, chain=avatar_arm())
    key = f"{preset!r} {inducing} {seed} {data.data_hash} {data.emotions} {_arms(trials)}"
    path = _path(kept, "hgpdm", key)
    if path is None:
        return layers()
    if path.is_file():
        return load_model(path, skeleton)
    checkpoint = path.with_suffix(".checkpoint.npz")
    model = layers(checkpoint)
    save_model(model, path)
    checkpoint.unlink(missing_ok=True)
    return model


def _path(kept: Path | None, method: str, key: str, ending: str = ".safetensors") -> Path | None:
    if kept is None:
        return None
    try:
        kept.mkdir(exist_ok=True)
    except OSError as error:
        raise HighFiveError(f"cannot write to {kept}: {error.strerror}; give another --out") from None
    return kept / f"{method}_{hashlib.sha256(f'{VERSION} {key}'.encode()).hexdigest()[:16]}{ending}"


def is_kept(path: Path) -> bool:
    """Whether a file is, by its name, a training that was kept, finished or not."""
    return path.name.startswith(UNFINISHED) or _KEPT.fullmatch(path.name) is not None

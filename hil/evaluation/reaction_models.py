"""Models by what a user names: a file that ``train`` wrote, or a model of the user's own."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.reaction import FitReactionModel, ReactionModel
from highfive.model.plugins import PluginError, fault, load_object, load_plugin, plugin_names

GROUP = "highfive.models"
"""Entry-point group: the object is a :data:`highfive.model.online.reaction.FitReactionModel`, or a trained model."""


def open_model(name: str | Path, trials: Callable[[], Sequence[Trial]] | None = None) -> HGPDM | ReactionModel:
    """The model that a user means.

    Args:
        name: a model file; ``module:attribute`` or ``file.py:attribute`` of a model of one's own, or of a function that
            learns one from trials; or the name of a plug-in.
        trials: gives the trials to learn from, where the model has to learn.

    Raises:
        PluginError: a model of somebody else's cannot be loaded, is none, or is for another skeleton than the avatar's.
        HighFiveError: no such file, a damaged one, or of another skeleton; nothing to learn from.
    """
    if not is_plugin(name):
        return load_model(name, avatar_skeleton().hash)
    found = load_fit(str(name))
    if not callable(found):
        _check_skeleton(str(name), found)
        return found
    if trials is None:
        raise HighFiveError(f"{name} learns from trials; give a data folder (--data DIR)")
    return fitted(str(name), found, trials())


def is_plugin(name: str | Path) -> bool:
    """Whether a model's name means an object in Python, not a file."""
    return isinstance(name, str) and not Path(name).exists() and (":" in name or name in plugin_names(GROUP))


def load_fit(name: str) -> FitReactionModel | ReactionModel:
    """What a plug-in offers: a function that learns from trials, or a model that has learned.

    Raises:
        PluginError: it cannot be loaded, or is neither.
    """
    if ":" in name:
        if os.getcwd() not in sys.path:
            sys.path.append(os.getcwd())  # a module beside the user's data, as python itself would find it
        found: Any = load_object(name, "the model")
    else:
        found = load_plugin(GROUP, name)
    if not (callable(found) or _is_model(found)):
        raise PluginError(f"{name} is a {type(found).__name__}; expected a function that learns a model from trials")
    return cast(FitReactionModel | ReactionModel, found)


def learner(name: str) -> FitReactionModel:
    """The function of a user's own that learns a model from trials.

    Raises:
        PluginError: it cannot be loaded, or does not learn.
    """
    found = load_fit(name)
    if not callable(found):
        raise PluginError(f"{name} has learned already; evaluate wants a function that learns from a fold's trials")
    return found


def fitted(name: str, fit: FitReactionModel, trials: Sequence[Trial]) -> ReactionModel:
    """The model that ``fit`` learns from the trials that are not held out.

    Raises:
        PluginError: it raises, or what it gives is no model.
    """
    try:
        model = fit([trial for trial in trials if not trial.test])
    except Exception as error:
        raise PluginError(f"{name} raised {fault(error)}") from error
    if not _is_model(model):
        raise PluginError(f"{name} gave a {type(model).__name__}; expected a model with {', '.join(_PARTS)}")
    _check_skeleton(name, model)
    return model


def _check_skeleton(name: str, model: ReactionModel) -> None:
    if model.skeleton_hash != (expected := avatar_skeleton().hash):
        raise PluginError(f"{name} is for skeleton {model.skeleton_hash!r}, the avatar is {expected!r}")


_PARTS = ("emotions", "skeleton_hash", "rest", "start")


def _is_model(found: object) -> bool:
    return not isinstance(found, type) and all(hasattr(found, part) for part in _PARTS)

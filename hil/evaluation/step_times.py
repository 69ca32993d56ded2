"""How long each method takes for one answer on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from highfive.hil.evaluation.model_cache import Fitted
from highfive.hil.session.open_responder import open_responder
from highfive.model.evaluation.baselines import Predictor as Regression
from highfive.model.evaluation.predictions import one_hot
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.dataset import hand_history
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.arm_track import arm_at
from highfive.model.online.belief import packed
from highfive.model.online.layer import predict_layer
from highfive.model.online.reaction import ReactionModel
from highfive.model.online.responder import Responder

WARM_UP = 30  # steps that do not count


def step_times(fitted: Fitted, plain: dict[str, Regression], trial: Trial) -> dict[str, Array]:
    """Time of each step, ms, of each method over a trial: from the hand to the pose and any uncertainty.

    Args:
        fitted: the model and the sparse GP.
        plain: the baselines without uncertainty.
        trial: whose hand is answered.
    """
    responder = Responder(fitted.model, trial.emotion, trial.rate_hz)
    style, task = one_hot(trial, fitted.task.data.emotions), fitted.task
    times = np.arange(len(trial.joints)) / trial.rate_hz
    histories = hand_history(trial, times, task.preset.history)
    layer = packed(fitted.sparse_gp, len(style))

    def of(regression: Regression) -> Callable[[int], object]:
        return lambda frame: regression(task.feature_map(histories[frame : frame + 1]), style[None])

    steps: dict[str, Callable[[int], object]] = {
        "hgpdm": lambda frame: responder.step(trial.hand_points[frame], None, arm_at(trial, frame)).joints_std,
        "sparse_gp": lambda frame: predict_layer(layer, task.feature_map(histories[frame]), style)[2],
        **{name: of(regression) for name, regression in plain.items()},
        **{name: _reacting(model, trial) for name, model in fitted.others.items()},
    }
    return {name: _times(step, len(times)) for name, step in steps.items()}


def _reacting(model: ReactionModel, trial: Trial) -> Callable[[int], object]:
    responder = open_responder(model, trial.emotion, trial.rate_hz, patience=None)
    return lambda frame: responder.step(trial.hand_points[frame])


def _times(step: Callable[[int], object], frames: int) -> Array:
    measured = []
    for frame in range(frames):
        start = time.perf_counter_ns()
        step(frame)
        measured.append(1e-6 * (time.perf_counter_ns() - start))
    return np.array(measured[WARM_UP:] or measured)

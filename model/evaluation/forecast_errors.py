"""How errors grow with the time that is looked ahead: of where the palms will meet, and of the avatar's palm."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from highfive.model.evaluation import metrics
from highfive.model.evaluation.baselines import RIDGE_PENALTY
from highfive.model.evaluation.minimum_jerk import reach_end
from highfive.model.evaluation.predictions import Prediction
from highfive.model.evaluation.scores import time_left
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.contact_layer import REGION
from highfive.model.hgpdm.dataset import Channels, hand_history
from highfive.model.hgpdm.hierarchy import Problem
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.responder import Responder

BEFORE = np.arange(0.0, 0.61, 0.05)  # s before contact
AHEAD = np.arange(0.1, 0.51, 0.1)  # s of forecast
VELOCITY_TIME = 0.05  # s over which a velocity is measured
FROM_BEFORE, FROM_STEP = 0.6, 0.1  # s before contact from which on forecasts are made, and every so often

Errors = dict[str, Array]
"""Method → (H,) median error, m, at each horizon; NaN where no trial has it."""


def contact_point_errors(trials: Sequence[Trial], answers: dict[str, list[Prediction]]) -> Errors:
    """Errors of the contact point as each method says it :data:`BEFORE` contact.

    ``constant_velocity`` is where the person's palm would be at contact if it went on as it does, given that time;
    ``minimum_jerk`` where a reach of the least jerk would end, whose time is not given.
    """
    found: dict[str, list[list[float]]] = {}
    for number, trial in enumerate(trials):
        ends, joints = trial.palm[trial.contact_frame], trial.joints.shape[1]
        for name, given in answers.items():
            said = given[number].outputs[:, Channels(joints).contact]
            row = [_nearest(given[number], trial, before) for before in BEFORE]
            found.setdefault(name, []).append([_distance(said, at, ends) for at in row])
        ahead = {"constant_velocity": [_straight_on(trial, before) for before in BEFORE]}
        ahead["minimum_jerk"] = [_smoothly(trial, before)[0] for before in BEFORE]
        for name, said in ahead.items():
            found.setdefault(name, []).append([float(np.linalg.norm(point - ends)) for point in said])
    return {name: _over_trials(rows) for name, rows in found.items()}


def contact_time_errors(trials: Sequence[Trial], answers: dict[str, list[Prediction]]) -> Errors:
    """Errors, s, of the time left as each method says it :data:`BEFORE` contact, by its contact clock;
    ``minimum_jerk`` is that of a reach of the least jerk."""
    found: dict[str, list[list[float]]] = {}
    for number, trial in enumerate(trials):
        clock = Channels(trial.joints.shape[1]).clock
        for name, given in answers.items():
            left: list[float] = time_left(given[number].outputs[:, clock]).tolist()
            at = [(_nearest(given[number], trial, before), before) for before in BEFORE.tolist()]
            row = [np.nan if n is None else abs(left[n] - before) for n, before in at]
            found.setdefault(name, []).append(row)
        found.setdefault("minimum_jerk", []).append(
            [abs(_smoothly(trial, before)[1] - before) for before in BEFORE.tolist()]
        )
    return {name: _over_trials(rows) for name, rows in found.items()}


def known_since(trials: Sequence[Trial], given: Sequence[Prediction], within: float) -> Array:
    """Seconds (n,) before contact since when what is said of the contact point is, and stays, ``within`` so many m."""
    since: list[float] = []
    for trial, answer in zip(trials, given, strict=True):
        ends, part = trial.palm[trial.contact_frame], Channels(trial.joints.shape[1]).contact
        until = answer.frames <= trial.contact_frame
        away = np.flatnonzero(np.linalg.norm(answer.outputs[until, part] - ends, axis=1) > within)
        frames = answer.frames[until]
        first = 0 if len(away) == 0 else int(away[-1]) + 1
        since.append(0.0 if first == len(frames) else (trial.contact_frame - frames[first]) / trial.rate_hz)
    return np.array(since)


def contact_point_coverage(trials: Sequence[Trial], answers: dict[str, list[Prediction]]) -> Errors:
    """Share of contacts inside the 90 % region that each method with an uncertainty gives :data:`BEFORE` contact."""
    found: Errors = {}
    for name, given in answers.items():
        inside: list[Array] = []
        for trial, answer in zip(trials, given, strict=True):
            if answer.uncertainty is None:
                break
            part, ends = Channels(trial.joints.shape[1]).contact, trial.palm[trial.contact_frame]
            at = [_nearest(answer, trial, before) for before in BEFORE]
            errors = np.array([np.full(3, np.nan) if row is None else answer.outputs[row, part] - ends for row in at])
            spreads = np.array([np.eye(3) if row is None else answer.uncertainty.contact[row] for row in at])
            level = metrics.levels(metrics.region_surprise(errors, spreads), 3)
            inside.append(np.where(np.isnan(level), np.nan, level < REGION))
        else:
            found[name] = _over_trials(inside, np.nanmean)
    return found


def palm_errors(model: HGPDM, task: Problem, trials: Sequence[Trial]) -> Errors:
    """Errors of the avatar's palm :data:`AHEAD` of the last hand seen, of forecasts in the reach of held-out trials.

    Besides the model: its own palm going straight on (``constant_velocity``), and a ridge regression for each horizon
    from the hand and its history (``ridge``), both from what is known at the same time.

    Args:
        model: the trained model.
        task: the training points.
        trials: all trials of the fold.
    """
    ridges = [_ridge_ahead(task, [t for t in trials if not t.test], ahead) for ahead in AHEAD]
    responders: dict[float, Responder] = {}
    found: dict[str, list[list[float]]] = {"hgpdm": [], "ridge": [], "constant_velocity": []}
    for trial in trials:
        if not trial.test or trial.emotion not in model.emotions or trial.emotion not in task.data.emotions:
            continue
        responder = responders.setdefault(trial.rate_hz, Responder(model, trial.emotion, trial.rate_hz))
        responder.set_style(trial.emotion)
        responder.reset()
        first = trial.contact_frame - round(FROM_BEFORE * trial.rate_hz)
        every, back = max(1, round(FROM_STEP * trial.rate_hz)), max(1, round(VELOCITY_TIME * trial.rate_hz))
        palms: list[Array] = []
        for frame, hand in enumerate(trial.hand_points[: trial.contact_frame + 1]):
            palms.append(responder.step(hand).palm)
            if frame < max(first, back) or (frame - first) % every:
                continue
            speed = (palms[-1] - palms[-1 - back]) / (back / trial.rate_hz)
            said = {
                "hgpdm": _forecast(responder),
                "constant_velocity": [palms[-1] + speed * ahead for ahead in AHEAD],
                "ridge": [ridge(trial, frame) for ridge in ridges],
            }
            ends = [frame + round(ahead * trial.rate_hz) for ahead in AHEAD]
            for name, points in said.items():
                found[name].append(
                    [
                        float(np.linalg.norm(point - trial.palm[end])) if end < len(trial.palm) else np.nan
                        for point, end in zip(points, ends, strict=True)
                    ]
                )
    return {name: _over_trials(rows) for name, rows in found.items()}


def _forecast(responder: Responder) -> list[Array]:
    """The palm at each of :data:`AHEAD`, between the model's lags."""
    responses = responder.forecast(float(AHEAD[-1]))
    times, palms = [r.ahead for r in responses], np.array([r.palm for r in responses])
    columns: list[Array] = [np.interp(AHEAD, times, column) for column in palms.T]
    return list(np.stack(columns, axis=1))


def _ridge_ahead(task: Problem, trials: Sequence[Trial], ahead: float) -> Callable[[Trial, int], Array]:
    """Ridge regression, an emotion each, from the hand's features to the palm a time later."""
    fitted: dict[str, tuple[Array, Array, Array]] = {}
    for emotion in dict.fromkeys(trial.emotion for trial in trials):
        inputs: list[Array] = []
        outputs: list[Array] = []
        for trial in trials:
            last = len(trial.palm) / trial.rate_hz - ahead
            if trial.emotion == emotion and last > 0.0:
                times = np.arange(0.0, last, task.data.lag)
                inputs.append(task.feature_map(hand_history(trial, times, task.preset.history)))
                outputs.append(
                    trial.palm[np.round((times + ahead) * trial.rate_hz).astype(int).clip(0, len(trial.palm) - 1)]
                )
        x, y = np.concatenate(inputs), np.concatenate(outputs)
        centre, offset = x.mean(axis=0), y.mean(axis=0)
        gram = (x - centre).T @ (x - centre) + RIDGE_PENALTY * np.eye(x.shape[1])
        fitted[emotion] = (centre, offset, np.linalg.solve(gram, (x - centre).T @ (y - offset)))

    def predict(trial: Trial, frame: int) -> Array:
        centre, offset, weights = fitted[trial.emotion]
        history = hand_history(trial, np.array([frame / trial.rate_hz]), task.preset.history)
        return (task.feature_map(history)[0] - centre) @ weights + offset

    return predict


def _nearest(answer: Prediction, trial: Trial, before: float) -> int | None:
    """Which of the answer's frames is that long before contact; None if the trial begins later."""
    frame = trial.contact_frame - before * trial.rate_hz
    return None if frame < 0 else int(np.argmin(np.abs(answer.frames - frame)))


def _distance(said: Array, at: int | None, ends: Array) -> float:
    return float("nan") if at is None else float(np.linalg.norm(said[at] - ends))


def _straight_on(trial: Trial, before: float) -> Array:
    frame, back = trial.contact_frame - round(before * trial.rate_hz), max(1, round(VELOCITY_TIME * trial.rate_hz))
    if frame < back:
        return np.full(3, np.nan)
    velocity = (trial.person_palm[frame] - trial.person_palm[frame - back]) / (back / trial.rate_hz)
    return trial.person_palm[frame] + velocity * before


def _smoothly(trial: Trial, before: float) -> tuple[Array, float]:
    frame = trial.contact_frame - round(before * trial.rate_hz)
    if frame < 2:
        return np.full(3, np.nan), np.nan
    return reach_end(trial.person_palm[: frame + 1], trial.rate_hz)


def _over_trials(rows: Sequence[Sequence[float] | Array], summary: Callable[..., Array] = np.nanmedian) -> Array:
    """The ``summary`` of each column that has a value; NaN where none has."""
    table = np.array(rows, dtype=float)
    result = np.full(table.shape[1], np.nan)
    known = np.isfinite(table).any(axis=0)
    result[known] = summary(table[:, known], axis=0)
    return result

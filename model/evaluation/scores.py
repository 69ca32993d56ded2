"""Scores of what the model and the baselines answer to held-out trials: errors, calibration, smoothness, lag.

Names and units of the metrics are in docs/evaluation.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.evaluation import baselines, metrics
from highfive.model.evaluation.predictions import Body, Prediction
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.dataset import CLOCK_SCALE, STILL, Channels, output_channels
from highfive.model.hgpdm.hierarchy import Problem
from highfive.model.hgpdm.trials import Trial

SOON = 0.3  # s before contact in which contact point and time to contact are scored
CLOCK_LIMIT = 0.98  # the contact clock is cut here: beyond it tells nothing
CALIBRATED = {"pose": 1, "palm": 3, "contact_point": 3, "time_to_contact": 1}
"""What calibration is about, and its dimensions."""


@dataclass(frozen=True)
class HeldOut:
    """What was recorded at the frames that count.

    Attributes:
        outputs: (F, channels).
        joints: (F, J, 3) m.
        contact: (F,) bool, the frame is its trial's contact.
        soon: (F,) bool, the palms will meet within :data:`SOON`.
        moving: (D,) bool, the joint channels that move at all.
    """

    outputs: Array
    joints: Array
    contact: NDArray[np.bool_]
    soon: NDArray[np.bool_]
    moving: NDArray[np.bool_]


def held_out(trials: Sequence[Trial], answers: Sequence[Prediction], body: Body) -> HeldOut:
    """Gathers what was recorded where the answers count; any method's answers will do."""
    if not trials:
        raise HighFiveError("no held-out trials; give at least one trial whose split is 'test'")
    pairs = list(zip(trials, answers, strict=True))
    outputs = np.concatenate([output_channels(t, a.frames / t.rate_hz) for t, a in pairs])
    to_go = np.concatenate([(t.contact_frame - a.frames) / t.rate_hz for t, a in pairs])
    moving = outputs[:, : 3 * len(body.skeleton)].std(axis=0) > STILL
    joints = body.joints(outputs)
    return HeldOut(outputs, joints, to_go == 0.0, (to_go > 0.0) & (to_go <= SOON), moving)


def surprises(answers: Sequence[Prediction], held: HeldOut) -> dict[str, Array]:
    """Squared normalised errors of each kind of :data:`CALIBRATED`; nothing for a method without uncertainty."""
    uncertainties = [answer.uncertainty for answer in answers if answer.uncertainty is not None]
    if len(uncertainties) < len(answers):
        return {}
    error = np.concatenate([answer.outputs for answer in answers]) - held.outputs
    deviations = np.concatenate([uncertainty.deviations for uncertainty in uncertainties])
    joints, soon = len(held.moving), held.soon
    where, pose = Channels(joints), np.flatnonzero(held.moving)
    palm, contact = (
        np.concatenate(parts) for parts in ([d.palm for d in uncertainties], [d.contact for d in uncertainties])
    )
    return {
        "pose": metrics.surprise(error[:, pose], deviations[:, pose]).ravel(),
        "palm": metrics.region_surprise(error[:, where.palm], palm),
        "contact_point": metrics.region_surprise(error[soon, where.contact], contact[soon]),
        "time_to_contact": metrics.surprise(error[soon, where.clock], deviations[soon, where.clock]),
    }


def score(trials: Sequence[Trial], answers: Sequence[Prediction], held: HeldOut, body: Body) -> dict[str, float]:
    """Scores of one method's answers to held-out trials, by metric."""
    palms = [np.linalg.norm(answer.palm - trial.palm, axis=1) for trial, answer in zip(trials, answers, strict=True)]
    palm = np.concatenate([error[answer.frames] for error, answer in zip(palms, answers, strict=True)])
    at_contact = contact_errors(trials, answers)
    predicted = np.concatenate([answer.outputs for answer in answers])
    scores = {
        **_pose_errors(predicted, held, body),
        "palm": float(palm.mean()),
        "palm_at_contact": float(at_contact.mean()),
        "palm_at_contact_median": float(np.median(at_contact)),
        **_contact_errors(predicted, held),
    }
    for kind, squares in surprises(answers, held).items():
        if len(squares):
            found = metrics.calibration(squares, CALIBRATED[kind])
            scores[f"{kind}_within_50"], scores[f"{kind}_within_90"] = found.within_50, found.within_90
            scores[f"{kind}_z2"] = found.mean_square
    tracks = [answer.palm for answer in answers]
    return {**scores, **smoothness(trials, tracks), **_lag(trials, tracks)}


def contact_errors(trials: Sequence[Trial], answers: Sequence[Prediction]) -> Array:
    """Distance (n,), m, of generated and recorded palm at each trial's contact."""
    apart = [(a.palm - t.palm)[t.contact_frame] for t, a in zip(trials, answers, strict=True)]
    return np.linalg.norm(np.array(apart), axis=1)


def smoothness(trials: Sequence[Trial], tracks: Sequence[Array]) -> dict[str, float]:
    """Mean spectral arc length, and median RMS jerk, m/s³, of palms (T, 3), m."""
    arcs = [
        metrics.spectral_arc_length(metrics.speeds(track, trial.rate_hz), trial.rate_hz)
        for trial, track in zip(trials, tracks, strict=True)
    ]
    jerks = [metrics.rms_jerk(track, trial.rate_hz) for trial, track in zip(trials, tracks, strict=True)]
    known = [arc for arc in arcs if np.isfinite(arc)]
    scores = {"spectral_arc_length": float(np.mean(known))} if known else {}
    return {**scores, "rms_jerk": float(np.median(jerks))}


def recorded_smoothness(trials: Sequence[Trial]) -> dict[str, float]:
    """The smoothness of the recorded palms, to compare with."""
    return smoothness(trials, [trial.palm for trial in trials])


def _lag(trials: Sequence[Trial], tracks: Sequence[Array]) -> dict[str, float]:
    """Median time by which the generated palm's speed is behind the recorded one's; a still palm has none."""
    lags = [
        metrics.lag(metrics.speeds(track, t.rate_hz), metrics.speeds(t.palm, t.rate_hz), t.rate_hz)
        for t, track in zip(trials, tracks, strict=True)
        if np.any(np.ptp(track, axis=0) > STILL)
    ]
    return {"lag_ms": 1e3 * float(np.median(lags))} if lags else {}


def _pose_errors(predicted: Array, held: HeldOut, body: Body) -> dict[str, float]:
    joints = 3 * len(body.skeleton)
    expected, got = (
        rotations.from_rotation_vector(outputs[:, :joints].reshape(len(outputs), -1, 3))
        for outputs in (held.outputs, predicted)
    )
    turn = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(expected), got))
    positions = body.joints(predicted)
    return {
        "all_joints": float(np.linalg.norm(positions - held.joints, axis=-1).mean()),
        "joint_angle": float(np.linalg.norm(turn, axis=-1).mean()),
    }


def time_left(clock: Array) -> Array:
    """Seconds until contact by a contact clock, of the same shape; as far as it tells."""
    return CLOCK_SCALE * np.arctanh(np.clip(clock, -CLOCK_LIMIT, CLOCK_LIMIT))


def _contact_errors(predicted: Array, held: HeldOut) -> dict[str, float]:
    """Where and when the palms will meet; nothing if no trial has a frame soon before contact."""
    if not np.any(held.soon):
        return {}
    where = Channels(len(held.moving))
    point = np.linalg.norm((predicted - held.outputs)[held.soon, where.contact], axis=1)
    got, expected = (time_left(outputs[held.soon, where.clock]) for outputs in (predicted, held.outputs))
    return {"contact_point": float(point.mean()), "time_to_contact": float(np.abs(got - expected).mean())}


def plain_baselines(task: Problem) -> dict[str, baselines.Predictor]:
    """The baselines that need no training."""
    return {
        "knn": baselines.nearest_neighbours(task),
        "ridge": baselines.ridge(task),
        "mean": baselines.constant_mean(task),
    }

"""Errors of a model and of the baselines on held-out trials, all from the same hand and emotion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model import baselines, rotations
from model.dataset import CLOCK_SCALE, Channels, hand_history, output_channels, training_set
from model.errors import HighFiveError
from model.hgpdm import HGPDM
from model.hierarchy import Problem, problem
from model.optimise import ProgressCallback
from model.presets import DEFAULT
from model.responder import Responder, Response
from model.rotations import Array
from model.skeleton import Skeleton
from model.trials import Trial

SCORED_RATE = 30.0  # Hz, of the frames that count, beside each trial's contact frame


@dataclass(frozen=True)
class Scores:
    """Errors on held-out trials.

    Attributes:
        all_joints: m, distance of the joints, by forward kinematics of generated and recorded angles, mean over joints
            and frames.
        joint_angle: rad, angle between generated and recorded joint rotation, mean over joints and frames.
        palm: m, distance of the right palm, by forward kinematics too, mean over frames.
        palm_at_contact: m, the same at the frame of contact, mean over trials.
        palm_at_contact_median: m, median over trials.
        contact_point: m, error of the generated contact point in the last 0.3 s before contact, mean over frames.
        time_to_contact: s, absolute error of the time to contact in the last 0.3 s, mean over frames.
    """

    all_joints: float
    joint_angle: float
    palm: float
    palm_at_contact: float
    palm_at_contact_median: float
    contact_point: float
    time_to_contact: float


@dataclass(frozen=True)
class HeldOut:
    """The frames that count.

    Attributes:
        history: (T, H + 1, 6) m, hand histories for the baselines.
        styles: (T, K) one-hot.
        outputs: (T, channels) what was recorded.
        contact: (T,) bool, the frame is its trial's contact.
        frames: for each trial, the indices of its frames that count.
    """

    history: Array
    styles: Array
    outputs: Array
    contact: NDArray[np.bool_]
    frames: tuple[NDArray[np.int64], ...]


def held_out(trials: Sequence[Trial], emotions: Sequence[str], history: Sequence[float]) -> HeldOut:
    """Gathers the frames that count of the given trials."""
    if not trials:
        raise HighFiveError("no held-out trials; give at least one trial whose split is 'test'")
    frames, parts = [], []
    for trial in trials:
        if trial.emotion not in emotions:
            raise HighFiveError(f"a trial of emotion {trial.emotion!r}; the model knows {', '.join(emotions)}")
        stride = max(1, round(trial.rate_hz / SCORED_RATE))
        chosen = np.union1d(np.arange(0, len(trial.joints), stride), trial.contact_frame)
        times = chosen / trial.rate_hz
        style = np.tile(np.eye(len(emotions))[list(emotions).index(trial.emotion)], (len(chosen), 1))
        frames.append(chosen)
        at_contact = chosen == trial.contact_frame
        parts.append((hand_history(trial, times, history), style, output_channels(trial, times), at_contact))
    return HeldOut(*(np.concatenate(part) for part in zip(*parts, strict=True)), frames=tuple(frames))


def to_channels(response: Response) -> Array:
    """A response as the avatar channels (channels,) that it came from."""
    clock = np.tanh(response.time_to_contact / CLOCK_SCALE)
    parts = [response.joints, response.root, [clock], response.palm, response.contact_point]
    return np.concatenate(parts)


def respond(model: HGPDM, trials: Sequence[Trial], frames: Sequence[NDArray[np.int64]]) -> Array:
    """Avatar channels (T, channels) that the model answers online to recorded hands, at given frames of the trials."""
    responders: dict[float, Responder] = {}
    answers = []
    for trial, chosen in zip(trials, frames, strict=True):
        if trial.rate_hz not in responders:
            responders[trial.rate_hz] = Responder(model, trial.emotion, trial.rate_hz)
        responder = responders[trial.rate_hz]
        responder.set_style(trial.emotion)
        responder.reset()
        wanted = set(chosen.tolist())
        for frame, hand in enumerate(trial.hand_points):
            response = responder.step(hand)
            if frame in wanted:
                answers.append(to_channels(response))
    return np.array(answers)


def body_positions(outputs: Array, skeleton: Skeleton, palm_in_wrist: Array) -> tuple[Array, Array]:
    """Joints (T, J, 3) and right palm (T, 3), m, by forward kinematics of avatar channels (T, channels)."""
    where, wrist = Channels(3 * len(skeleton)), skeleton.index("right_wrist")
    pose = skeleton.from_rotation_vectors(outputs[:, : where.joints])
    positions, orientations = skeleton.forward_kinematics(outputs[:, where.root], pose)
    return positions, positions[:, wrist] + rotations.rotate(orientations[:, wrist], palm_in_wrist)


def score(predicted: Array, held: HeldOut, skeleton: Skeleton, palm_in_wrist: Array) -> Scores:
    """Scores of predicted avatar channels (T, channels)."""
    where = Channels(3 * len(skeleton))
    wanted, got = (
        rotations.from_rotation_vector(outputs[:, : where.joints].reshape(len(outputs), -1, 3))
        for outputs in (held.outputs, predicted)
    )
    turn = rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(wanted), got))
    (got_joints, got_palm), (wanted_joints, wanted_palm) = (
        body_positions(outputs, skeleton, palm_in_wrist) for outputs in (predicted, held.outputs)
    )
    palm = np.linalg.norm(got_palm - wanted_palm, axis=1)
    point = np.linalg.norm(predicted[:, where.contact] - held.outputs[:, where.contact], axis=1)
    clocks = [
        CLOCK_SCALE * np.arctanh(np.clip(outputs[:, where.clock], -0.98, 0.98)) for outputs in (predicted, held.outputs)
    ]
    soon = (clocks[1] > 0.0) & (clocks[1] <= 0.3)
    return Scores(
        all_joints=float(np.linalg.norm(got_joints - wanted_joints, axis=-1).mean()),
        joint_angle=float(np.mean(np.linalg.norm(turn, axis=-1))),
        palm=float(palm.mean()),
        palm_at_contact=float(palm[held.contact].mean()),
        palm_at_contact_median=float(np.median(palm[held.contact])),
        contact_point=float(point[soon].mean()),
        time_to_contact=float(np.abs(clocks[0] - clocks[1])[soon].mean()),
    )


def evaluate(
    model: HGPDM,
    trials: Sequence[Trial],
    skeleton: Skeleton,
    palm_in_wrist: Array,
    seed: int = 0,
    progress: ProgressCallback | None = None,
) -> dict[str, Scores]:
    """Scores of the model, online, and of the baselines trained on the same training trials.

    Args:
        model: the trained model.
        trials: all trials; the baselines learn from those that are not held out, and all are scored on those that are.
        skeleton: the avatar's skeleton.
        palm_in_wrist: (3,) m, palm centre in the frame of the right wrist.
        seed: seed of the sparse GP's inducing inputs.
        progress: called while the sparse GP trains.

    Returns:
        Scores by method: ``hgpdm``, ``sparse_gp``, ``knn``, ``ridge``, ``mean``.
    """
    task = problem(training_set(trials, DEFAULT, model.emotions), DEFAULT)
    test = [trial for trial in trials if trial.test]
    held = held_out(test, model.emotions, DEFAULT.history)
    scores = {"hgpdm": score(respond(model, test, held.frames), held, skeleton, palm_in_wrist)}
    features = task.feature_map(held.history)
    for name, predictor in baseline_predictors(task, model.avatar.inducing.shape[0], seed, progress).items():
        scores[name] = score(predictor(features, held.styles), held, skeleton, palm_in_wrist)
    return scores


def baseline_predictors(
    task: Problem, inducing: int, seed: int, progress: ProgressCallback | None = None
) -> dict[str, baselines.Predictor]:
    """All baselines, fitted."""
    return {
        "sparse_gp": baselines.regression(baselines.sparse_gp(task, inducing, np.random.default_rng(seed), progress)),
        "knn": baselines.nearest_neighbours(task),
        "ridge": baselines.ridge(task),
        "mean": baselines.constant_mean(task),
    }

"""What the model and the baselines answer to the hand of a recorded trial, and how sure they say they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.evaluation.baselines import Predictor as Regression
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.geometry.skeleton import Skeleton
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.dataset import AUXILIARY, CLOCK_SCALE, Channels, hand_history
from highfive.model.hgpdm.hierarchy import Problem
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.arm_track import arm_at
from highfive.model.online.belief import packed
from highfive.model.online.layer import predict_layer
from highfive.model.online.reaction import OnlineResponder, Reaction
from highfive.model.online.responder import Responder, Response

SCORED_RATE = 30.0  # Hz, of the frames that count, beside each trial's contact frame


@dataclass(frozen=True)
class Body:
    """The avatar's body: a skeleton, and where on its right wrist the palm is.

    Attributes:
        skeleton: the skeleton.
        palm_in_wrist: (3,) m, palm centre in the frame of the right wrist.
    """

    skeleton: Skeleton
    palm_in_wrist: Array

    def joints(self, outputs: Array) -> Array:
        """Joints (T, J, 3), m, by forward kinematics of avatar channels (T, channels)."""
        return _kinematics(self.skeleton, outputs[:, : 3 * len(self.skeleton)], outputs)[0]

    def palm(self, outputs: Array) -> Array:
        """Right palm (T, 3), m, likewise; only the joints that carry it are worked out."""
        carriers, arm = self._arm
        turns = outputs[:, : 3 * len(self.skeleton)].reshape(len(outputs), -1, 3)[:, carriers]
        positions, orientations = _kinematics(arm, turns.reshape(len(outputs), -1), outputs)
        return positions[:, -1] + rotations.rotate(orientations[:, -1], self.palm_in_wrist)

    @cached_property
    def _arm(self) -> tuple[list[int], Skeleton]:
        """Indices of the joints from the root to the right wrist, and the skeleton that they make."""
        return self.skeleton.chain_to("right_wrist")


def _kinematics(skeleton: Skeleton, turns: Array, outputs: Array) -> tuple[Array, Array]:
    """Positions and orientations of a skeleton's joints, whose root is where the pelvis of ``outputs`` is."""
    root = outputs[:, Channels(outputs.shape[1] - AUXILIARY).root]
    return skeleton.forward_kinematics(root, skeleton.from_rotation_vectors(turns))


@dataclass(frozen=True)
class Uncertainty:
    """How sure a method says it is at the frames that count.

    Attributes:
        deviations: (F, channels) standard deviations.
        palm: (F, 3, 3) m², covariance of the palm as generated directly.
        contact: (F, 3, 3) m², of the contact point.
    """

    deviations: Array
    palm: Array
    contact: Array


@dataclass(frozen=True)
class Prediction:
    """What a method says to one trial.

    Attributes:
        frames: (F,) the trial's frames that count.
        outputs: (F, channels) avatar channels at these frames.
        palm: (T, 3) m, the right palm at every frame, by forward kinematics.
        uncertainty: None for a method that does not say how sure it is.
    """

    frames: NDArray[np.int64]
    outputs: Array
    palm: Array
    uncertainty: Uncertainty | None


Method = Callable[[Trial], Prediction]


def scored_frames(trial: Trial) -> NDArray[np.int64]:
    """The frames that count: about thirty a second, and contact."""
    stride = max(1, round(trial.rate_hz / SCORED_RATE))
    return np.union1d(np.arange(0, len(trial.joints), stride), trial.contact_frame)


def one_hot(trial: Trial, emotions: Sequence[str]) -> Array:
    """Style weights (K,) of the trial's emotion.

    Raises:
        HighFiveError: the emotion is not among those of the training.
    """
    if trial.emotion not in emotions:
        raise HighFiveError(f"a trial of emotion {trial.emotion!r}; the model knows {', '.join(emotions)}")
    return np.eye(len(emotions))[list(emotions).index(trial.emotion)]


def to_channels(response: Reaction) -> Array:
    """A response as the avatar channels (channels,) that it came from."""
    clock = np.tanh(response.time_to_contact / CLOCK_SCALE)
    parts = [response.joints, response.root, [clock], response.palm, response.contact_point]
    return np.concatenate(parts)


def online(model: HGPDM, body: Body) -> Method:
    """The model, tick by tick at the trial's rate."""
    responders: dict[float, Responder] = {}

    def answer(trial: Trial) -> Prediction:
        one_hot(trial, model.emotions)  # known?
        if trial.rate_hz not in responders:
            responders[trial.rate_hz] = Responder(model, trial.emotion, trial.rate_hz)
        responder, where = responders[trial.rate_hz], model.channels
        responder.set_style(trial.emotion)
        responder.reset()
        responses = [responder.step(hand, None, arm_at(trial, n)) for n, hand in enumerate(trial.hand_points)]
        outputs, frames = np.array([to_channels(r) for r in responses]), scored_frames(trial)
        counted = [responses[int(frame)] for frame in frames]
        said = outputs[frames]
        uncertainty = Uncertainty(
            np.array([response.generated.avatar_deviations for response in counted]),
            np.array([response.generated.covariance(where.palm) for response in counted]),
            np.array([response.generated.covariance(where.contact) for response in counted]),
        )
        for row, response in enumerate(counted):
            _forecast(response, where, said[row], uncertainty.deviations[row], uncertainty.contact[row])
        return Prediction(frames, said, body.palm(outputs), uncertainty)

    return answer


def reacting(start: Callable[[str, float], OnlineResponder], body: Body) -> Method:
    """Another model, tick by tick at the trial's rate.

    Args:
        start: makes its responder in an emotion, at so many ticks per second.
        body: the avatar's body.
    """

    def answer(trial: Trial) -> Prediction:
        responder = start(trial.emotion, trial.rate_hz)
        responder.reset()
        outputs = np.array([to_channels(responder.step(hand)) for hand in trial.hand_points])
        frames = scored_frames(trial)
        return Prediction(frames, outputs[frames], body.palm(outputs), None)

    return answer


def _forecast(response: Response, where: Channels, said: Array, deviations: Array, contact: Array) -> None:
    """Writes the forecast of the contact, where there is one, over what the avatar layer says of it beside the pose."""
    if (forecast := response.contact) is None:
        return
    clock = np.tanh(forecast.time / CLOCK_SCALE)
    said[where.contact], said[where.clock] = forecast.point, clock
    contact[:] = forecast.covariance[:3, :3]
    deviations[where.clock] = forecast.deviation * (1.0 - clock**2) / CLOCK_SCALE


def regressed(regression: Regression, task: Problem, body: Body, posterior: Posterior | None = None) -> Method:
    """A baseline, frame by frame from the recorded hand and its history.

    Args:
        regression: the baseline.
        task: the training points that it was fitted to.
        body: the avatar's body.
        posterior: the same baseline as a sparse GP, where it is one: it says how sure it is.
    """
    layer = None if posterior is None else packed(posterior, len(task.data.emotions))

    def answer(trial: Trial) -> Prediction:
        style = one_hot(trial, task.data.emotions)
        times = np.arange(len(trial.joints)) / trial.rate_hz
        features = task.feature_map(hand_history(trial, times, task.preset.history))
        outputs = regression(features, np.tile(style, (len(features), 1)))
        frames = scored_frames(trial)
        uncertainty = None if layer is None else _uncertainty(layer, features[frames], style)
        return Prediction(frames, outputs[frames], body.palm(outputs), uncertainty)

    return answer


def _uncertainty(layer: Array, features: Array, style: Array) -> Uncertainty:
    variances = np.array([predict_layer(layer, point, style)[2] for point in features])
    where = Channels(variances.shape[1] - AUXILIARY)
    palm, contact = (variances[:, part, None] * np.eye(3) for part in (where.palm, where.contact))
    return Uncertainty(np.sqrt(variances), palm, contact)

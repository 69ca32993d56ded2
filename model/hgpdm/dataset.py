"""From trials to the training arrays: hand history, output channels and styles, sampled uniformly in time."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.presets import Preset
from highfive.model.hgpdm.trials import Gesture, Trial

CLOCK_SCALE = 0.4
"""s; the contact clock tanh((contact − t) / CLOCK_SCALE) is nearly linear this long before and after contact."""

HAND_DIMS = 6  # wrist and knuckles, x y z each
KNUCKLES = slice(3, 6)  # of a hand (6,)
AUXILIARY = 10  # root (3), contact clock (1), palm (3), contact point (3) follow the joint channels
MINIMUM_RATE = 10.0
MINIMUM_POINTS = 50
MAXIMUM_SAMPLE_RATE, MINIMUM_SAMPLE_RATE = 30.0, 10.0  # Hz; below, a reach would be a handful of points
FURTHEST = 50.0  # m from the origin at most; a hall, not a mistaken unit
LARGEST_TURN = 50.0  # rad; a mistaken degree, where a joint turns by a few
STILL = 1e-4  # m or rad; less motion than this in all channels is a constant recording
STILL_HAND = 5e-3  # m, standard deviation of a coordinate; less is the noise of markers on somebody who stands still


@dataclass(frozen=True)
class Channels:
    """Where the quantities lie in the avatar layer's output: joints (rad), root, clock, palm, contact point (m)."""

    joints: int

    @property
    def size(self) -> int:
        """Number of channels."""
        return self.joints + AUXILIARY

    @property
    def root(self) -> slice:
        """Root position, m."""
        return slice(self.joints, self.joints + 3)

    @property
    def clock(self) -> int:
        """The contact clock."""
        return self.joints + 3

    @property
    def palm(self) -> slice:
        """Palm centre, m."""
        return slice(self.joints + 4, self.joints + 7)

    @property
    def contact(self) -> slice:
        """Where the palms will meet (or met), m."""
        return slice(self.joints + 7, self.joints + 10)


@dataclass(frozen=True)
class TrainingSet:
    """N training points.

    Attributes:
        emotions: K names; column k of ``styles`` is emotion k.
        lag: s between a trial's successive points, which is the dynamics' step.
        history: (N, H + 1, P) m, the hand (P = 6: wrist and knuckles) at t and at its H earlier times.
        outputs: (N, channels) the avatar's channels, see :class:`Channels`.
        weights: (channels,) scale of each channel beside the others.
        styles: (N, K) one-hot style weights.
        trial: (N,) index of the trial of each point, non-decreasing.
        data_hash: digest of everything above.
    """

    emotions: tuple[str, ...]
    lag: float
    history: Array
    outputs: Array
    weights: Array
    styles: Array
    trial: NDArray[np.int64]
    data_hash: str


def hand_history(trial: Trial | Gesture, times: Array, history: Sequence[float]) -> Array:
    """The hand (T, H + 1, 6), m, at ``times`` (T,) s from the first frame and at each ``history`` s before.

    Interpolated linearly, so that it does not depend on the frame rate; before the first frame the hand is still.
    """
    frames = np.arange(len(trial.hand_points)) / trial.rate_hz
    points = trial.hand_points.reshape(len(frames), HAND_DIMS)
    times = np.asarray(times)[:, None] - np.array([0.0, *history])
    return np.stack([np.interp(times, frames, points[:, d]) for d in range(HAND_DIMS)], axis=-1)


def sample_times(trial: Trial, lag: float) -> Array:
    """Times (T,), s from the first frame, of a trial's points that are ``lag`` s apart."""
    return np.arange(0.0, (len(trial.joints) - 1) / trial.rate_hz + 1e-9, lag)


def output_channels(trial: Trial, times: Array) -> Array:
    """The avatar's channels (T, channels) at ``times`` (T,) s from the first frame."""
    frames = np.arange(len(trial.joints)) / trial.rate_hz
    contact = trial.contact_frame / trial.rate_hz
    recorded = np.concatenate([trial.joints, trial.root, trial.palm], axis=1)
    columns: list[Array] = [np.interp(times, frames, column) for column in recorded.T]
    sampled = np.stack(columns, axis=1)
    clock = np.tanh((contact - np.asarray(times)) / CLOCK_SCALE)[:, None]
    joints = trial.joints.shape[1]
    point = np.broadcast_to(trial.palm[trial.contact_frame], (len(times), 3))
    return np.concatenate([sampled[:, : joints + 3], clock, sampled[:, joints + 3 :], point], axis=1)


def check_trial(trial: Trial, number: int, joints: int) -> None:
    """Raises HighFiveError if a trial cannot be learned from; ``number`` names it in the message."""
    where = f"trial {number} ({trial.emotion or 'no emotion'}, cell {trial.cell or '?'})"
    frames = len(trial.hand_points)
    if trial.rate_hz < MINIMUM_RATE:
        raise HighFiveError(f"{where} has {trial.rate_hz:g} frames per second; at least {MINIMUM_RATE:g} are needed")
    expected = {"hand_points": (frames, 2, 3), "joints": (frames, joints)}
    expected |= {name: (frames, 3) for name in ("root", "palm")}
    for name, shape in expected.items():
        values = getattr(trial, name)
        if values.shape != shape:
            raise HighFiveError(f"{where}: {name} has shape {values.shape}, expected {shape}")
        if not np.all(np.isfinite(values)):
            raise HighFiveError(f"{where}: {name} holds NaN or infinity; fill or cut the gaps before training")
        largest, limit = np.abs(values).max(initial=0.0), LARGEST_TURN if name == "joints" else FURTHEST
        if largest > limit:
            unit, other = ("rad", "degrees") if name == "joints" else ("m", "millimetres")
            raise HighFiveError(f"{where}: {name} reaches {largest:.0f}; expected {unit}: are these {other}?")
    if frames < 3:
        raise HighFiveError(f"{where} has {frames} frames; at least 3 are needed")
    if not 0 <= trial.contact_frame < frames:
        raise HighFiveError(f"{where}: contact frame {trial.contact_frame} is outside its {frames} frames")


def sample_rate(seconds: float, slowest_hz: float, preset: Preset) -> float:
    """The common rate, Hz, at which trials of so many ``seconds`` together are sampled, the slowest of them recorded
    at ``slowest_hz``."""
    return min(MAXIMUM_SAMPLE_RATE, slowest_hz, max(preset.points / seconds, MINIMUM_SAMPLE_RATE))


def training_set(trials: Sequence[Trial], preset: Preset, emotions: Sequence[str] | None = None) -> TrainingSet:
    """Samples trials (held-out ones left out) at one common rate: about ``preset.points`` points, or 10 Hz.

    Raises:
        HighFiveError: too little data, broken values, constant recordings, or an emotion outside ``emotions``.
    """
    trials = [trial for trial in trials if not trial.test]
    if not trials:
        raise HighFiveError("no training trials; give at least one trial whose split is 'train'")
    for number, trial in enumerate(trials):
        check_trial(trial, number, trials[0].joints.shape[1])
    found = list(dict.fromkeys(trial.emotion for trial in trials))
    emotions = tuple(found if emotions is None else emotions)
    if unknown := [name for name in found if name not in emotions]:
        raise HighFiveError(f"trials of emotion {', '.join(unknown)}, but the model is for {', '.join(emotions)}")
    if missing := [name for name in emotions if name not in found]:
        raise HighFiveError(f"no training trial of emotion {', '.join(missing)}; there are {', '.join(found)}")

    seconds = sum(len(trial.joints) / trial.rate_hz for trial in trials)
    highest = sample_rate(seconds, min(trial.rate_hz for trial in trials), preset)
    times = [sample_times(trial, 1.0 / highest) for trial in trials]
    history = np.concatenate([hand_history(t, at, preset.history) for t, at in zip(trials, times, strict=True)])
    outputs = np.concatenate([output_channels(t, at) for t, at in zip(trials, times, strict=True)])
    trial_index = np.repeat(np.arange(len(trials)), [len(at) for at in times])
    labels = np.array([emotions.index(trial.emotion) for trial in trials])[trial_index]
    where = Channels(trials[0].joints.shape[1])
    _check_motion(history[:, 0], outputs[:, : where.joints], outputs[:, where.palm], trial_index)
    digest = hashlib.sha256(repr((emotions, highest)).encode())
    for array in (history, outputs, labels):
        digest.update(np.ascontiguousarray(array).tobytes())
    styles = np.eye(len(emotions))[labels]
    weights = np.ones(where.size)
    weights[where.clock] = preset.clock_weight
    weights[where.palm] = weights[where.contact] = preset.palm_weight
    return TrainingSet(emotions, 1.0 / highest, history, outputs, weights, styles, trial_index, digest.hexdigest()[:16])


def _check_motion(hand: Array, joints: Array, palm: Array, trial: NDArray[np.int64]) -> None:
    """Raises HighFiveError if there is too little, or if nobody moves within any trial."""
    if len(hand) < MINIMUM_POINTS:
        raise HighFiveError(
            f"{len(hand)} training points; at least {MINIMUM_POINTS} are needed: record more or longer trials"
        )
    if np.all(_motion(hand, trial) < STILL_HAND):
        raise HighFiveError(
            "the person's hand never moves in the training trials; check which markers were read as hand"
        )
    if np.all(_motion(joints, trial) < STILL) or np.all(_motion(palm, trial) < STILL_HAND):
        raise HighFiveError("the avatar actor never moves in the training trials; check the joint angles")


def _motion(values: Array, trial: NDArray[np.int64]) -> Array:
    """Standard deviation of each channel about its mean in the same trial: that trials differ is no motion."""
    means = np.array([values[trial == number].mean(axis=0) for number in range(trial[-1] + 1)])
    return np.std(values - means[trial], axis=0)

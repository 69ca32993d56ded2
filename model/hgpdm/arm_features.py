"""What a contact layer sees of the whole arm: where it is, how fast it went a moment ago, how far it is stretched.

Features of the last :data:`HISTORY` of wrist, knuckles, elbow, shoulder and head. Beside places and velocities they
have lengths, which no direction changes: how fast the hand is, and how much of the arm's reach is used up. A raised
hand goes on for as long as its arm is bent. Last comes the tempo of the reach (:mod:`highfive.model.hgpdm.tempo`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.features import scales
from highfive.model.hgpdm.tempo import TEMPO
from highfive.model.hgpdm.trials import Trial

HISTORY = (0.033, 0.067, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6)
"""s before now; near ones tell a fast hand, far ones when it rose."""
STILL = 0.01
"""m, and m/s: what varies less among the trials counts as if it varied so much; else a shoulder that nobody moved there
would say everything once somebody does."""
USUAL = 0.995
"""Share of the frames whose tempo is no larger than what counts as known."""
ENOUGH = 0.75
"""Share of the trials in which the arm has to be known, for a layer to be learned from these."""
POINTS = 5  # wrist, knuckles, elbow, shoulder, head
COORDINATES = 3 * POINTS
_WRIST, _KNUCKLES, _ELBOW, _SHOULDER, _HEAD = range(POINTS)
SHOULDER = slice(3 * _SHOULDER, 3 * _SHOULDER + 3)
"""Of an arm's coordinates."""
_TIMES = len(HISTORY) + 1
_VECTORS = 15  # of which features are the components; three more give lengths alone
_SPEEDS = len(HISTORY)
ARM_SIZE = 3 * _VECTORS + _SPEEDS + 3
"""Of the features, those of the arm."""
SIZE = ARM_SIZE + TEMPO
"""F, of the features."""


@dataclass(frozen=True)
class ArmFeatures:
    """How the features are scaled: ``(raw − centre) · factor``.

    Attributes:
        centre, factor: (F,).
        furthest: (TEMPO,) the largest of each that training had, as far as nearly all of it goes.
    """

    centre: Array
    factor: Array
    furthest: Array

    def __call__(self, arms: Array, tempo: Array) -> Array:
        """Features (N, F) of arms (N, H + 1, 15), m: now, and at each of :data:`HISTORY` before, and of the reach's
        ``tempo`` (N, TEMPO)."""
        return (_both(arms, tempo) - self.centre) * self.factor


def fit_arm_features(arms: Array, tempo: Array) -> ArmFeatures:
    """Scales vectors, lengths and ``tempo`` (N, TEMPO) of arms (N, H + 1, 15) by one factor each, which keeps the
    vectors' directions."""
    centre, factor = scales(_both(arms, tempo), _VECTORS, STILL)
    return ArmFeatures(centre, factor, np.quantile(tempo, USUAL, axis=0))


def _both(arms: Array, tempo: Array) -> Array:
    return np.column_stack([_raw(LINEAR, np.ascontiguousarray(arms.reshape(len(arms), -1))), tempo])


def arm_history(trial: Trial, times: Array) -> Array:
    """Arms (T, H + 1, 15), m, at ``times`` (T,) s from the first frame and at each of :data:`HISTORY` before.

    Interpolated linearly; before the first frame the arm is still.
    """
    assert trial.arm_points is not None
    frames = np.arange(len(trial.hand_points)) / trial.rate_hz
    points = np.concatenate([trial.hand_points, trial.arm_points], axis=1).reshape(len(frames), COORDINATES)
    at = np.asarray(times)[:, None] - np.array([0.0, *HISTORY])
    columns: list[Array] = [np.interp(at, frames, column) for column in points.T]
    return np.stack(columns, axis=-1)


def with_arms(trials: Sequence[Trial]) -> list[int]:
    """Indices of those whose elbow, shoulder and head are known."""
    return [index for index, trial in enumerate(trials) if trial.arm_points is not None]


def have_arms(trials: Sequence[Trial]) -> bool:
    """Whether elbow, shoulder and head are known in enough of them to learn from: one bad take shall not cost the rest
    theirs."""
    return bool(trials) and len(with_arms(trials)) >= ENOUGH * len(trials)


def check_arms(trials: Sequence[Trial]) -> None:
    """Raises HighFiveError unless :func:`have_arms`."""
    if not have_arms(trials):
        known = f"elbow, shoulder and head are known in {len(with_arms(trials))} of {len(trials)} trials"
        raise HighFiveError(f"{known}: too few to learn from the whole arm")


def _linear() -> Array:
    """(3 · 18, 15 (H + 1)): vectors of which features are made, from the arm and its history."""
    points = np.eye(_TIMES * POINTS).reshape(_TIMES, POINTS, -1)
    wrist, knuckles, elbow, shoulder, head = (points[:, one] for one in range(POINTS))
    spans = np.diff([0.0, *HISTORY])[:, None]
    rows = [
        knuckles[0],
        wrist[0] - knuckles[0],
        knuckles[0] - shoulder[0],
        elbow[0] - shoulder[0],
        head[0] - shoulder[0],
        elbow[0] - elbow[2],
        shoulder[0] - shoulder[2],
        *((knuckles[:-1] - knuckles[1:]) / spans),
        *(wrist[time] - shoulder[time] for time in (0, 2, 4)),
    ]
    return np.kron(np.array(rows), np.eye(3)).astype(float)


LINEAR = _linear()
_FIRST_SPEED, _FIRST_STRETCH = 3 * (_VECTORS - _SPEEDS), 3 * _VECTORS


@compiled
def features_of(linear: Array, arm: Array, value: Array) -> Array:
    """Puts the features of one arm (15 (H + 1),) into ``value``, not scaled; gives back the vectors' (54,)."""
    vectors = np.zeros(len(linear))
    for row in range(len(linear)):
        for column in range(len(arm)):
            vectors[row] += linear[row, column] * arm[column]
    for row in range(_FIRST_STRETCH):
        value[row] = vectors[row]
    for number in range(_SPEEDS):
        value[_FIRST_STRETCH + number] = _length(vectors, _FIRST_SPEED + 3 * number)
    now, before = _length(vectors, _FIRST_STRETCH), _length(vectors, _FIRST_STRETCH + 3)
    value[ARM_SIZE - 3], value[ARM_SIZE - 2] = now, now - before
    value[ARM_SIZE - 1] = before - _length(vectors, _FIRST_STRETCH + 6)
    return vectors


@compiled
def pulled_back(linear: Array, vectors: Array, slope: Array) -> Array:
    """Derivatives (D, 15 (H + 1)) by the arm, of what has the derivatives ``slope`` (D, F) by the unscaled features.

    The tempo counts as known: it hangs together with the whole reach, of which one tick is little.
    """
    result = np.zeros((len(slope), linear.shape[1]))
    for row in range(len(slope)):
        own, by = slope[row], np.zeros(len(linear))
        for number in range(_FIRST_STRETCH):
            by[number] = own[number]
        for number in range(_SPEEDS):
            _along(vectors, _FIRST_SPEED + 3 * number, own[_FIRST_STRETCH + number], by)
        _along(vectors, _FIRST_STRETCH, own[ARM_SIZE - 3] + own[ARM_SIZE - 2], by)
        _along(vectors, _FIRST_STRETCH + 3, own[ARM_SIZE - 1] - own[ARM_SIZE - 2], by)
        _along(vectors, _FIRST_STRETCH + 6, -own[ARM_SIZE - 1], by)
        for number in range(len(linear)):
            for column in range(linear.shape[1]):
                result[row, column] += by[number] * linear[number, column]
    return result


@compiled
def _length(vectors: Array, first: int) -> float:
    total = 0.0
    for i in range(3):
        total += vectors[first + i] * vectors[first + i]
    return np.sqrt(total)


@compiled
def _along(vectors: Array, first: int, slope: float, by: Array) -> None:
    """Adds the derivative of a length; of nothing it has none."""
    length = _length(vectors, first)
    if length > 0.0:
        for i in range(3):
            by[first + i] += slope * vectors[first + i] / length


@compiled_entry
def _raw(linear: Array, arms: Array) -> Array:
    """Features (N, ARM_SIZE), not scaled, of arms (N, 15 (H + 1))."""
    result = np.empty((len(arms), ARM_SIZE))
    for number in range(len(arms)):
        features_of(linear, arms[number], result[number])
    return result

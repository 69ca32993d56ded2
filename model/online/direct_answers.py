"""The direct answers beside the hierarchy, tick by tick: what is pooled with its pose."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.pose_ensemble import HIERARCHY, NEAREST, NEIGHBOURS, REGRESSION, PoseEnsemble
from highfive.model.online.layer import layer_mean
from highfive.model.online.tick import feature_value


class Direct(NamedTuple):
    """What does not change from tick to tick.

    Attributes:
        regression: as :func:`highfive.model.online.belief.packed`.
        features: (F, N) of the training points, ordered by style.
        first: (K + 1,) where each style's points begin.
        scores: (N, R).
        basis: (R + 1, channels), the channels' offset in the last row.
        share: how far each smoothing goes in a tick.
        usual: distance of neighbours from which on the direct answers count less; twice as far, not at all.
    """

    regression: Array
    features: NDArray[np.float32]
    first: NDArray[np.int64]
    scores: NDArray[np.float32]
    basis: Array
    share: float
    usual: float


def direct_of(ensemble: PoseEnsemble, regression: Array, share: float) -> Direct:
    """An ensemble as the tick reads it, its ``regression`` packed."""
    near = ensemble.neighbours
    features = np.ascontiguousarray(np.asarray(near.features, dtype=np.float32).T)
    scores = np.array(near.scores, dtype=np.float32, order="C")
    basis = np.concatenate([near.basis, near.offset[None]]).astype(float)
    return Direct(regression, features, np.array(near.first, np.int64), scores, basis, share, float(near.usual))


class PoseByArm(NamedTuple):
    """What the whole arm says of the pose.

    Attributes:
        channels: (channels,).
        share: in the pool, 0 to 1.
    """

    channels: Array
    share: float


NO_ARM = PoseByArm(np.zeros(0), 0.0)
"""It says nothing."""


class Looking(NamedTuple):
    """How the features are made of the hand's ticks; see :class:`highfive.model.online.tick_values.Plan`."""

    features: Array
    feature_offset: Array
    ticks: Array


@compiled_entry
def pooled(
    looking: Looking, direct: Direct, beyond: Array, first: bool, hands: Array, style: Array, avatar: Array, arm: Array,
    arm_share: float,
) -> Array:  # fmt: skip
    """What the pool has beyond the hierarchy's answer, (2, channels), after one and after two smoothings.

    Few arrays are handed in: compiled code counts the references to each, which takes longer than the sums.

    Args:
        looking, direct: what does not change.
        beyond: (2, channels) a tick ago.
        first: nothing was seen a tick ago, or the hand is seen anew: no smoothing.
        hands: (L, 2, P) the hand's last ticks, seen now.
        style: (K,) weights.
        avatar: (channels,) the hierarchy's answer.
        arm: (channels,) what the whole arm says; empty where it says nothing.
        arm_share: of that in the pool.
    """
    value = feature_value(looking.features, looking.feature_offset, looking.ticks, hands)
    answer = layer_mean(direct.regression, value, style)
    near, furthest = _neighbours(direct, value, style)
    trust = 1.0 - smooth_step(furthest / direct.usual - 1.0)
    share, next_beyond = 1.0 if first else direct.share, beyond.copy()
    for d in range(len(avatar)):
        towards = REGRESSION * answer[d] + NEIGHBOURS * near[d] - (1.0 - HIERARCHY) * avatar[d]
        if len(arm) > 0:
            towards += arm_share * (arm[d] - avatar[d] - towards)
        towards *= trust
        next_beyond[0, d] += share * (towards - next_beyond[0, d])
        next_beyond[1, d] += share * (next_beyond[0, d] - next_beyond[1, d])
    return next_beyond


@compiled
def _neighbours(direct: Direct, value: Array, style: Array) -> tuple[Array, float]:
    """Locally weighted averages (channels,) of the nearest points of each style, mixed by the style's weights (K,).

    Tricube weights (Cleveland 1979): a point comes and goes without a jump. Beside them, how far the furthest of these
    points is, in the style that has them nearest.
    """
    scores, closest = np.zeros(direct.scores.shape[1]), np.inf
    for k in range(len(style)):
        begin, end = direct.first[k], direct.first[k + 1]
        if style[k] != 0.0 and end > begin:
            distance = _distances(direct.features, value, begin, end)
            nearest, furthest = _nearest(distance)
            closest = min(closest, furthest)
            weights, total = np.empty(len(nearest)), 0.0
            for n in range(len(nearest)):
                ratio = math.sqrt(distance[nearest[n]] / max(furthest, 1e-18))
                weights[n] = (1.0 - ratio**3) ** 3 + 1e-9
                total += weights[n]
            for n in range(len(nearest)):
                part, row = style[k] * weights[n] / total, direct.scores[begin + nearest[n]]
                for r in range(len(scores)):
                    scores[r] += part * row[r]
    average = direct.basis[len(scores)].copy()
    for r in range(len(scores)):
        score, channel = scores[r], direct.basis[r]
        for d in range(len(average)):
            average[d] += score * channel[d]
    return average, math.sqrt(closest)


@compiled
def smooth_step(x: float) -> float:
    """0 up to 0, 1 from 1 on, and a cubic between."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@compiled
def _distances(features: NDArray[np.float32], value: Array, begin: int, end: int) -> NDArray[np.float32]:
    """Squared distances of the points from ``begin`` to ``end``; single precision halves what has to be read."""
    distance = np.zeros(end - begin, np.float32)
    for f in range(len(value)):
        at, row = np.float32(value[f]), features[f, begin:end]
        for n in range(end - begin):
            away = row[n] - at
            distance[n] += away * away
    return distance


@compiled
def _nearest(distance: NDArray[np.float32]) -> tuple[NDArray[np.int64], float]:
    """Indices of the nearest, at most :data:`NEAREST`, in no order; and the largest squared distance among them."""
    count = min(NEAREST, len(distance))
    nearest = np.arange(count)
    worst = 0
    for n in range(count):
        if distance[n] > distance[nearest[worst]]:
            worst = n
    furthest = distance[nearest[worst]]
    for n in range(count, len(distance)):
        if distance[n] < furthest:
            nearest[worst] = n
            for m in range(count):
                if distance[nearest[m]] > distance[nearest[worst]]:
                    worst = m
            furthest = distance[nearest[worst]]
    return nearest, float(furthest)

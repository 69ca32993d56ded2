"""The person's whole arm over the last ticks, and by it where and when the palms will meet, and the pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.arm_features import (
    ARM_SIZE,
    COORDINATES,
    HISTORY,
    LINEAR,
    SHOULDER,
    SIZE,
    features_of,
    pulled_back,
)
from highfive.model.hgpdm.contact_layer import CHANNELS, ArmContactLayer, pooled
from highfive.model.hgpdm.dataset import KNUCKLES
from highfive.model.hgpdm.pose_ensemble import ArmAnswer
from highfive.model.hgpdm.tempo import SPANS, STATE, TEMPO, at_rest, moved, tempo_of, unseen
from highfive.model.hgpdm.trials import Trial
from highfive.model.online.belief import packed, tick_weights
from highfive.model.online.contact_forecast import ContactForecast, contact_forecast
from highfive.model.online.direct_answers import NO_ARM, PoseByArm
from highfive.model.online.layer import layer_mean, predict_layer
from highfive.model.online.tick import history_of

MEASURED = 3e-3
"""m, standard deviation of a point: one that is known so well is as in training, and the layer's noise has that."""


class ArmPoints(NamedTuple):
    """Of the person's arm, beside the hand.

    Attributes:
        points: (3, 3) m, elbow, shoulder and centre of the head in the world.
        covariance: (3, 3, 3) m², of each.
    """

    points: Array
    covariance: Array


def arm_at(trial: Trial, frame: int) -> ArmPoints | None:
    """The arm in a frame of a trial, known as well as in training; None where the trial has none."""
    return None if trial.arm_points is None else ArmPoints(trial.arm_points[frame], np.zeros((3, 3, 3)))


class LastArm(NamedTuple):
    """The arm when all of it was known last, as :meth:`ArmTrack.forecast` takes it.

    Attributes:
        ticks: (L, 2, 15) m, and variances, m², newest first.
        tempo: (STATE,), of the reach.
        ago: s, since then.
        share: 0 to 1, of its share in what is pooled: less for a while where it was hidden.
    """

    ticks: Array
    tempo: Array
    ago: float
    share: float


class ArmTrack:
    """The last ticks of an arm. They are a window of a longer array, which moves down it: rows are written once."""

    def __init__(
        self, layer: ArmContactLayer, rate_hz: float, answer: ArmAnswer | None = None, styles: int = 1
    ) -> None:
        """Compiles what is called later.

        Args:
            layer: where and when the palms will meet.
            rate_hz: ticks per second.
            answer: what the arm says of the pose, if anything.
            styles: their number K.
        """
        self._layer, self._contact = layer.layer, packed(layer.layer.posterior)
        self._features, self._share, self._answer = layer.features, layer.share, answer
        self._pose = None if answer is None else packed(answer.regression, styles)
        self._ticks, self._seconds = tick_weights(HISTORY, rate_hz), 1.0 / rate_hz
        self._before = tick_weights(SPANS, rate_hz)[1:].mean(axis=0)
        self.reset()
        nothing = np.zeros(6), np.zeros(6), ArmPoints(np.zeros((3, 3)), np.zeros((3, 3, 3)))
        for _ in range(2):
            self.step(*nothing)
        self.reset()
        ticks = np.zeros((self._ticks.shape[1], 2, COORDINATES))
        arm = LastArm(ticks, np.zeros(STATE), 0.0, 1.0)
        self.forecast(arm, np.zeros(3), 0.0, (np.zeros(CHANNELS), np.eye(CHANNELS)))
        self.pose(arm, np.full(styles, 1.0 / styles))

    def reset(self) -> None:
        """Nobody is there yet: whoever comes first has stood still before."""
        self._rows, self._first, self._started, self._away = np.empty((0, 2, COORDINATES)), 0, False, 0
        self._last: LastArm | None = None
        self._tempo, self._hidden = np.zeros(STATE), 0

    def step(self, hand: Array | None, variance: Array, arm: ArmPoints | None) -> LastArm | None:
        """One tick: what is to be said of the arm; None where nothing is.

        While a point is hidden, and for as long after as the history reaches back to where one was, what was said last
        stands, and soon counts for nothing; later it comes back as slowly. So no forecast jumps.

        Args:
            hand: (6,) m, wrist and knuckles; None where it is hidden.
            variance: (6,) m², of it.
            arm: the rest; None where it is not known.
        """
        if hand is None or arm is None:
            return self.hide()
        count = self._ticks.shape[1]
        if self._first == 0:
            rows = np.empty((_WINDOWS * count, 2, COORDINATES))
            self._first = len(rows) - count
            rows[self._first :] = self._rows[:count] if self._started else 0.0
            self._rows = rows
        self._first -= 1
        _write(self._rows[self._first], hand, variance, arm.points, arm.covariance)
        if not self._started:
            self._rows[self._first + 1 :] = self._rows[self._first]
        self._away = max(self._away - 1, 0)
        rows = self._rows[self._first : self._first + count]
        self._tempo = self._tempo.copy()  # what was said before keeps its own
        known = self._ticks.shape[1] - self._away  # ticks since a point was hidden
        _advance(self._tempo, self._before, rows, self._seconds, self._started, known, self._hidden)
        self._started, self._hidden = True, 0
        return self._fading(rows if self._away == 0 else None)

    def hide(self, ticks: int = 1) -> LastArm | None:
        """A point is hidden in this tick, or in so many: what is still to be said."""
        if self._started:
            self._away, self._hidden = self._ticks.shape[1], self._hidden + ticks
        return self._fading(None, ticks)

    def _fading(self, ticks: Array | None, count: int = 1) -> LastArm | None:
        """With these ticks its share grows; without, for a ``count`` of them, it is what it was, and shrinks."""
        last, seconds = self._last, count * self._seconds
        change = seconds / FADE
        if ticks is not None:
            share = 1.0 if last is None else min(last.share + change, 1.0)
            self._last = LastArm(ticks, self._tempo, 0.0, share)
        elif last is not None:
            self._last = last._replace(ago=last.ago + seconds, share=max(last.share - change, 0.0))
        return self._last if self._last is not None and self._last.share > 0.0 else None

    def forecast(self, arm: LastArm, knuckles: Array, speed: float, hand: tuple[Array, Array]) -> ContactForecast:
        """Where and when the palms will meet, by an arm, and by what the hand's layer says.

        Args:
            arm: it.
            knuckles: (3,) m, now, of the hand.
            speed: m/s, of theirs.
            hand: way and time left by its layer, (4,) and (4, 4).
        """
        features = self._features
        tempo = np.empty(TEMPO)
        known = known_tempo(arm.tempo, features.furthest, tempo)
        by_arm, covariance = _forecast(
            LINEAR, features.centre, features.factor, self._ticks, self._contact, arm.ticks, tempo
        )
        by_arm[:3] += arm.ticks[0, 0, KNUCKLES] - knuckles  # what was said a while ago
        by_arm[3] -= arm.ago
        share = self._share * arm.share * known
        left, doubt = (pooled(one, other, share) for one, other in zip((by_arm, covariance), hand, strict=True))
        return contact_forecast(knuckles, speed, left, doubt, self._layer)

    def pose(self, arm: LastArm | None, style: Array) -> PoseByArm:
        """What an arm says of the pose, and its share in the pool.

        Args:
            arm: it.
            style: (K,) weights.
        """
        if arm is None or self._answer is None or self._pose is None:
            return NO_ARM
        features, tempo = self._answer.features, np.empty(TEMPO)
        known = known_tempo(arm.tempo, features.furthest, tempo)
        share = float(self._answer.share) * known * arm.share
        if share == 0.0:
            return NO_ARM
        parts = LINEAR, features.centre, features.factor, self._ticks, self._pose, arm.ticks, tempo, style
        return PoseByArm(_pose(*parts), share)


BEYOND = 0.15
"""Of the largest that training had, or of 1: a tempo that is further beyond it by this begins to count less, by twice
that it says nothing."""
FADE = 0.15
"""s, in which the arm's share goes where a point is hidden, and comes back."""
_WINDOWS = 8
"""Of ticks, that an array holds: it is made anew when they are used up."""


@compiled_entry
def _write(row: Array, hand: Array, variance: Array, points: Array, covariance: Array) -> None:
    """A tick (2, 15): places, and the variances beyond what they had in training."""
    for p in range(6):
        row[0, p], row[1, p] = hand[p], max(variance[p] - MEASURED**2, 0.0)
    for n in range(3):
        for i in range(3):
            row[0, 6 + 3 * n + i] = points[n, i]
            row[1, 6 + 3 * n + i] = max(covariance[n, i, i] - MEASURED**2, 0.0)


@compiled_entry
def _advance(tempo: Array, weights: Array, rows: Array, seconds: float, started: bool, known: int, hidden: int) -> None:
    """Another tick of the tempo (STATE,), ``known`` ticks after points were hidden, ``hidden`` before this one."""
    hand, before = rows[0, 0, KNUCKLES] - rows[0, 0, SHOULDER], np.zeros(3)
    if not started:
        at_rest(tempo, hand)
    elif hidden > 0 or known < len(weights):
        unseen(tempo, hand, rows[1, 0, KNUCKLES] - rows[1, 0, SHOULDER], seconds * (hidden + 1))
    else:
        for tick in range(len(weights)):
            for i in range(3):
                before[i] += weights[tick] * (rows[tick, 0, KNUCKLES.start + i] - rows[tick, 0, SHOULDER.start + i])
        moved(tempo, hand, before, seconds)


@compiled_entry
def known_tempo(state: Array, furthest: Array, value: Array) -> float:
    """How far a tempo is one that training had, 1 to 0: the least of its features. A hand that gestured before, or
    waited in mid-air, has moved for longer and further than any reach; it is the hand's layer's alone.

    Args:
        state: (STATE,), of the reach.
        furthest: (TEMPO,) that training had.
        value: (TEMPO,), into which its features are put.
    """
    share = 1.0
    tempo_of(state, value)
    for f in range(TEMPO):
        beyond = (value[f] - furthest[f]) / (BEYOND * max(abs(furthest[f]), 1.0))
        share = min(share, max(2.0 - beyond, 0.0), 1.0)
    return share


@compiled_entry
def _forecast(
    linear: Array, centre: Array, factor: Array, ticks: Array, contact: Array, arms: Array, tempo: Array
) -> tuple[Array, Array]:
    """Way and time left: mean (4,) and covariance (4, 4), by arms and a tempo (TEMPO,)."""
    doubts, value = history_of(ticks, arms, 1), np.empty(SIZE)
    vectors = _features(linear, centre, factor, history_of(ticks, arms, 0), tempo, value)
    doubted = doubts.max() > 0.0  # nobody asks for derivatives while all is known as well as in training
    mean, slope, variances = predict_layer(contact, value, np.ones(1), doubted)
    covariance = np.zeros((len(mean), len(mean)))
    for i in range(len(mean)):
        covariance[i, i] = variances[i]
    if not doubted:
        return mean, covariance
    for d in range(len(slope)):
        for f in range(SIZE):
            slope[d, f] *= factor[f]
    by_arm = pulled_back(linear, vectors, slope)
    for i in range(len(mean)):
        for j in range(len(mean)):
            for p in range(len(doubts)):
                covariance[i, j] += by_arm[i, p] * doubts[p] * by_arm[j, p]
    return mean, covariance


@compiled_entry
def _pose(
    linear: Array, centre: Array, factor: Array, ticks: Array, layer: Array, arms: Array, tempo: Array, style: Array
) -> Array:
    """The pose's channels (channels,), by arms and a tempo (TEMPO,), in a style (K,)."""
    value = np.empty(SIZE)
    _features(linear, centre, factor, history_of(ticks, arms, 0), tempo, value)
    return layer_mean(layer, value, style)


@compiled
def _features(linear: Array, centre: Array, factor: Array, arm: Array, tempo: Array, value: Array) -> Array:
    """Puts the features of an arm and its tempo, scaled, into ``value`` (F,); gives back the arm's vectors."""
    vectors = features_of(linear, arm, value)
    value[ARM_SIZE:] = tempo
    for f in range(SIZE):
        value[f] = (value[f] - centre[f]) * factor[f]
    return vectors

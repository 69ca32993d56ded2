"""The tempo of a reach: how a hand has moved since it rose, which tells how long it still takes.

A slow hand that has gone half its way and a quick one that has just begun may look alike for the last half second. What
tells them apart lies further back: since when the hand moves, how far it came, how fast it was at the most and how long
ago. Durations of reaches are the actor's own, and one reach has one (isochrony, Viviani & Flash 1995). All is measured
from the shoulder: who walks up has not begun to reach.
"""

from __future__ import annotations

import numpy as np

from highfive.model.compiled import compiled, compiled_entry
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trials import Trial

SPANS = (0.033, 0.067)
"""s before now; speeds are taken from the mean of the places there, half a tenth ago."""
_SPAN = sum(SPANS) / len(SPANS)
SLOW, NEAR, RISEN = 0.12, 0.08, 0.2
"""m/s, m, m/s: a hand that is this slow is at rest, if it is this near where it rested or was never this fast; all
from the shoulder."""
HANGS = 0.45
"""m below the shoulder; a hand that is slow there rests, wherever it rested before: an arm that swung in walking."""
LONGEST_PAUSE = 1.0
"""s; whoever is slow for longer rests there, wherever that is. A palm that is met waits less."""
TEMPO = 7
"""Features: what :func:`tempo_of` says."""
STATE = 9
_SINCE, _LENGTH, _PEAK, _SINCE_PEAK, _SPEED, _PAUSE, _REST = range(7)  # where it rested, the last, has three
_SOON, _LITTLE = 0.1, 0.1  # s and m/s, beside which durations and speeds count by their logarithm


@compiled
def at_rest(state: Array, hand: Array) -> None:
    """A ``hand`` (3,), m from the shoulder, rests where it is: puts that into the state (STATE,)."""
    for i in range(_REST):
        state[i] = 0.0
    for i in range(3):
        state[_REST + i] = hand[i]


@compiled
def unseen(state: Array, hand: Array, before: Array, seconds: float) -> None:
    """Some ``seconds`` after it was at ``before`` (3,) m the ``hand`` is there; its speed is not known."""
    _later(state, np.sqrt(_squares(hand, before)), seconds)


@compiled
def moved(state: Array, hand: Array, before: Array, seconds: float) -> None:
    """The hand has gone on for some ``seconds``.

    Args:
        state: (STATE,), changed.
        hand: (3,) m, the knuckles now, from the shoulder.
        before: (3,) m, mean of where they were :data:`SPANS` ago.
        seconds: since the last time.
    """
    speed, gone = np.sqrt(_squares(hand, before)) / _SPAN, _squares(hand, state[_REST:])
    _later(state, speed * seconds, seconds)
    state[_SPEED] = speed
    state[_PAUSE] = state[_PAUSE] + seconds if speed < SLOW else 0.0
    rests = gone < NEAR * NEAR or hand[2] < -HANGS or state[_PEAK] < RISEN or state[_PAUSE] > LONGEST_PAUSE
    if speed < SLOW and rests:
        pause = state[_PAUSE]
        at_rest(state, hand)
        state[_PAUSE] = pause
    elif speed >= state[_PEAK]:
        state[_PEAK], state[_SINCE_PEAK] = speed, 0.0


@compiled
def tempo_of(state: Array, value: Array) -> None:
    """Puts the features into ``value`` (TEMPO,): since when it moves, how far, mean and largest speed, its share now,
    since when it was that fast."""
    since, peak = state[_SINCE] + _SOON, state[_PEAK]
    value[0] = np.log(since)
    value[1] = state[_LENGTH]
    value[2] = state[_LENGTH] / since
    value[3] = peak
    value[4] = state[_SPEED] / max(peak, RISEN)
    value[5] = state[_SINCE_PEAK]
    value[6] = np.log(peak + _LITTLE)


@compiled
def _later(state: Array, length: float, seconds: float) -> None:
    state[_SINCE] += seconds
    state[_SINCE_PEAK] += seconds
    state[_LENGTH] += length


@compiled
def _squares(one: Array, other: Array) -> float:
    total = 0.0
    for i in range(3):
        total += (one[i] - other[i]) ** 2
    return total


def tempo_history(trial: Trial, times: Array) -> Array:
    """Features (T, TEMPO) of a trial's hand at ``times`` (T,) s from its first frame, before which it rested."""
    assert trial.arm_points is not None
    frames = np.arange(len(trial.hand_points)) / trial.rate_hz
    hand = trial.hand_points[:, 1] - trial.arm_points[:, 1]  # knuckles from the shoulder
    before = np.zeros_like(hand)
    for span in SPANS:
        for axis in range(3):
            before[:, axis] += np.interp(frames - span, frames, hand[:, axis]) / len(SPANS)
    found = _tempos(np.ascontiguousarray(hand), np.ascontiguousarray(before), 1.0 / trial.rate_hz)
    columns: list[Array] = [np.interp(times, frames, column) for column in found.T]
    return np.stack(columns, axis=-1)


@compiled_entry
def _tempos(hand: Array, before: Array, seconds: float) -> Array:
    state, result = np.zeros(STATE), np.empty((len(hand), TEMPO))
    at_rest(state, hand[0])
    for frame in range(len(hand)):
        if frame > 0:
            moved(state, hand[frame], before[frame], seconds)
        tempo_of(state, result[frame])
    return result

"""What was shown and what was answered: rates an emotion, and how far answers tell emotions apart.

A rate of right answers rises with a habit of giving the right label; the unbiased hit rate and the mutual information
do not.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int
from scipy.special import betaincinv

from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class EmotionRate:
    """Recognition of one emotion.

    Attributes:
        correct, shown, answered: right answers, times shown and times answered.
        mean: of the posterior Beta(k + 1, n − k + K − 1): a pseudo-count for each possible answer.
        interval: its central part, by default 95 %.
        unbiased: Wagner's (1993) unbiased hit rate k² / (shown × answered); 0 where it was never answered, None where
            it was never shown.
        answer_bias: share of all answers minus share of all that was shown: above 0, it is answered too often.
    """

    emotion: str
    correct: int
    shown: int
    answered: int
    mean: float
    interval: tuple[float, float]
    unbiased: float | None
    answer_bias: float


@dataclass(frozen=True)
class Confusion:
    """A confusion matrix.

    Attributes:
        emotions: the labels, of rows and columns.
        counts: (K, K), rows shown, columns answered.
    """

    emotions: tuple[str, ...]
    counts: Int[np.ndarray, "K K"]

    @property
    def trials(self) -> int:
        """All answers."""
        return int(self.counts.sum())


def confusion(shown: Sequence[str], answered: Sequence[str]) -> Confusion:
    """The matrix of what was shown and answered, trial by trial; labels are all that occur, in order of the alphabet.

    Raises:
        HighFiveError: no trial, or a single label.
    """
    emotions: tuple[str, ...] = tuple(sorted({*shown, *answered}))
    if not shown:
        raise HighFiveError("no trial to make a confusion matrix of")
    if len(emotions) < 2:
        raise HighFiveError(f"all that was shown and answered is {shown[0]}; a choice has two emotions or more")
    pairs = Counter(zip(shown, answered, strict=True))
    return Confusion(emotions, np.array([[pairs[row, column] for column in emotions] for row in emotions]))


def emotion_rates(matrix: Confusion, level: float = 0.95) -> list[EmotionRate]:
    """Each emotion's recognition, in the matrix's order; intervals hold ``level`` of the posterior."""
    choices, trials = len(matrix.emotions), matrix.trials
    rows, columns = matrix.counts.sum(axis=1), matrix.counts.sum(axis=0)
    found = []
    for place, emotion in enumerate(matrix.emotions):
        k, n, said = int(matrix.counts[place, place]), int(rows[place]), int(columns[place])
        a, b = k + 1.0, n - k + choices - 1.0
        low, high = betaincinv(a, b, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
        unbiased = None if n == 0 else 0.0 if said == 0 else k**2 / (n * said)
        bias = (said - n) / trials
        found.append(EmotionRate(emotion, k, n, said, a / (a + b), (float(low), float(high)), unbiased, bias))
    return found


def mutual_information(matrix: Confusion) -> float:
    """Bits that an answer says about what was shown, of the counts as they are; chance adds :func:`chance_bits`."""
    joint = matrix.counts / matrix.trials
    apart = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0, keepdims=True)
    there = joint > 0.0
    return max(0.0, float(np.sum(joint[there] * np.log2(joint[there] / apart[there]))))


def chance_bits(matrix: Confusion) -> float:
    """Bits that answers given blindly seem to say: (R − 1)(C − 1) / (2 N ln 2), to first order (Miller 1955)."""
    rows, columns = [int(np.count_nonzero(matrix.counts.sum(axis=axis))) for axis in (1, 0)]
    return (rows - 1) * (columns - 1) / (2.0 * matrix.trials * math.log(2.0))

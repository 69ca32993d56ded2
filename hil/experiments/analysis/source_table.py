"""Table 1 of Taubert et al. (2013), by the rules that give its printed figures to the third decimal.

A person's emotion classification rate has one pseudo-count in each cell of the K × K confusion matrix, so that its
diagonal's sum is Beta(k + K, n − k + K² − K) for k right answers of n. How probable it is that she is better in
interaction has the uniform prior on right and wrong instead: Beta(k + 1, n − k + 1) in both conditions. The paper says
neither prior; these two are what its numbers are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, betaincinv, betaln

from highfive.hil.experiments.analysis.counts import Count, PersonCounts
from highfive.model.errors import HighFiveError

EMOTIONS = 3
"""K of the source study: neutral, fearful, angry."""
WARNING = (
    "The overall P compares all people being better in interaction with all being worse, as if nothing lay between. "
    "It is no significance: without any effect it is above .97 in about one of five studies with five people, and in "
    "more with more people. See the hierarchical estimate."
)

_NODES, _OFFSETS = 400, 1e-16
"""Of the quadrature, between the quantiles of this tail: more nodes change no digit of double precision."""


@dataclass(frozen=True)
class Rate:
    """A classification rate: mean and standard deviation (the paper's standard error) of its Beta posterior."""

    mean: float
    se: float


@dataclass(frozen=True)
class SourceRow:
    """A person's row of the table.

    Attributes:
        p_interactive_higher: posterior probability that the rate is higher in interaction.
    """

    participant: str
    interactive: Rate
    replay: Rate
    p_interactive_higher: float


@dataclass(frozen=True)
class SourceTable:
    """The table; ``overall`` is ∏P / (∏P + ∏(1 − P)), of which :data:`WARNING` says what it is not."""

    rows: tuple[SourceRow, ...]
    overall: float


def source_table(people: Sequence[PersonCounts], emotions: int = EMOTIONS) -> SourceTable:
    """The paper's table of these people, ``emotions`` answers to choose from.

    Raises:
        HighFiveError: fewer than two emotions.
    """
    if emotions < 2:
        raise HighFiveError(f"{emotions} emotions; a choice has two or more")
    rows = tuple(
        SourceRow(
            person.participant,
            classification_rate(person.interactive, emotions),
            classification_rate(person.replay, emotions),
            p_higher(person.interactive, person.replay),
        )
        for person in people
    )
    return SourceTable(rows, overall([row.p_interactive_higher for row in rows]))


def classification_rate(count: Count, emotions: int) -> Rate:
    """Mean and standard deviation of Beta(k + K, n − k + K² − K)."""
    a, b = count.correct + emotions, count.wrong + emotions**2 - emotions
    mean = a / (a + b)
    return Rate(mean, math.sqrt(mean * (1.0 - mean) / (a + b + 1.0)))


def p_higher(first: Count, second: Count) -> float:
    """P(x > y) of x ~ Beta(k + 1, n − k + 1) of the first count and y of the second, by Gauss-Legendre quadrature.

    P = ∫ p(x) F(x) dx with x's density and y's distribution function.
    """
    a, b = first.correct + 1.0, first.wrong + 1.0
    low, high = betaincinv(a, b, [_OFFSETS, 1.0 - _OFFSETS])
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    half = 0.5 * (high - low)
    x = low + half * (nodes + 1.0)
    density = np.exp((a - 1.0) * np.log(x) + (b - 1.0) * np.log1p(-x) - betaln(a, b))
    below = betainc(second.correct + 1.0, second.wrong + 1.0, x)
    return min(1.0, float(half * np.sum(weights * density * below)))


def overall(probabilities: Sequence[float]) -> float:
    """∏P / (∏P + ∏(1 − P)): all people higher against all lower; through logits, as products of many are too small."""
    p = np.asarray(probabilities, dtype=float)
    if np.any(p == 0.0) and np.any(p == 1.0):
        return 0.5  # beyond what double precision tells apart, either way
    with np.errstate(divide="ignore"):
        logit = float(np.sum(np.log(p) - np.log1p(-p)))
    return 1.0 / (1.0 + math.exp(-logit)) if logit >= 0.0 else math.exp(logit) / (1.0 + math.exp(logit))

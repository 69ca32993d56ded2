"""Which morph to show next: the weight after whose answer least is left to know of PSE and JND.

The expected entropy of (m, ln s), lapses integrated out, over both answers (Kontsevich & Tyler 1999; Prins 2013, for
leaving the lapses out of what is sought). A share of trials shows an end of the morph instead: without them a lapse is
taken for a shift, and nobody likes a task in which every trial is hard.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from highfive.hil.experiments.analysis.psychometric import (
    Psychometric,
    PsychometricSettings,
    grid_of,
    log_likelihood,
    p_on_grid,
    summary,
)
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class AdaptiveSettings(Settings):
    """What may be shown."""

    levels: int = setting(21, least=3, most=49)
    """Weights from 0 to 1. At 21 a choice looks at 430,000 probabilities, in milliseconds; keep it below 10⁶."""
    easy: float = setting(0.1, least=0.0, most=1.0)
    """Share of trials that show an end of the morph."""


@dataclass(frozen=True)
class AdaptiveRun:
    """A run of one person in one condition, so far.

    Attributes:
        log_posterior: (M, S, L) on the grid of ``observer``, up to a constant.
        trials: answered.
        seed: of what is drawn: the easy trials.
    """

    log_posterior: Array
    trials: int
    seed: int
    observer: PsychometricSettings
    settings: AdaptiveSettings


def begin_run(
    seed: int, observer: PsychometricSettings | None = None, settings: AdaptiveSettings | None = None
) -> AdaptiveRun:
    """A run in which nothing was answered yet."""
    observer = observer or PsychometricSettings()
    return AdaptiveRun(grid_of(observer).log_prior, 0, seed, observer, settings or AdaptiveSettings())


def next_weight(run: AdaptiveRun) -> float:
    """The share of B to show next: the same for the same run."""
    chance = np.random.default_rng((run.seed, run.trials))
    if chance.random() < run.settings.easy:
        return float(chance.integers(2))
    weights, p = _candidates(run.observer, run.settings.levels)
    return float(weights[np.argmin(_expected_entropies(run.log_posterior, p))])


def answered(run: AdaptiveRun, weight: float, second: bool) -> AdaptiveRun:
    """The run after an answer to a weight, which may be any: ``second`` if B was seen."""
    p = p_on_grid(grid_of(run.observer), np.array([weight]))[0]
    return replace(run, log_posterior=run.log_posterior + log_likelihood(p, second), trials=run.trials + 1)


def so_far(run: AdaptiveRun) -> Psychometric:
    """What the answers say."""
    return summary(grid_of(run.observer), run.log_posterior, run.trials)


@lru_cache(maxsize=2)
def _candidates(observer: PsychometricSettings, levels: int) -> tuple[Array, Array]:
    weights = np.linspace(0.0, 1.0, levels)
    return weights, p_on_grid(grid_of(observer), weights)


def _expected_entropies(log_posterior: Array, p: Array) -> Array:
    """(W,) expected entropies of (m, ln s), in nats, after an answer to each candidate."""
    belief = np.exp(log_posterior - log_posterior.max())
    belief /= belief.sum()
    second = np.einsum("msl,wmsl->wms", belief, p).reshape(len(p), -1)
    first = np.maximum(belief.sum(axis=2).ravel() - second, 0.0)
    # Σ q ln q of both answers' joint probabilities, minus that of the answers themselves.
    return sum((_plogp(q.sum(axis=1)) - _plogp(q).sum(axis=1) for q in (first, second)), np.zeros(len(p)))


def _plogp(q: Array) -> Array:
    return q * np.log(np.maximum(q, 1e-300))

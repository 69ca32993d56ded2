"""How far off a person's PSE is after a run of morphs, by simulation: constant levels, or chosen by the answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from highfive.hil.experiments.analysis.adaptive import AdaptiveSettings, answered, begin_run, next_weight, so_far
from highfive.hil.experiments.analysis.psychometric import fit, p_second
from highfive.model.errors import HighFiveError
from highfive.model.settings import Settings, setting


@dataclass(frozen=True)
class MorphObserverSettings(Settings):
    """Who is simulated."""

    pse_spread: float = setting(0.1, least=0.0)
    """PSEs are normal about the middle of the morph."""
    width: float = setting(0.15, above=0.0)
    """Of the psychometric function: from 10 to 90 % within two fifths of the morph."""
    lapse: float = setting(0.03, least=0.0, below=0.5)
    """To either side."""
    observers: int = setting(100, least=10, most=100_000)
    """The error is then known to 7 %."""


def constant_error(shown: Sequence[float], seed: int, settings: MorphObserverSettings | None = None) -> float:
    """Root mean square of the PSE's error after these shares of the second style, a trial each.

    Raises:
        HighFiveError: no trial.
    """
    settings = settings or MorphObserverSettings()
    if not shown:
        raise HighFiveError("no trial to find a PSE with")
    rng, weights = np.random.default_rng(seed), np.array(shown, dtype=float)
    errors = []
    for pse in _pses(rng, settings):
        second = rng.random(len(weights)) < p_second(weights, pse, settings.width, settings.lapse)
        errors.append(fit(weights, second.tolist()).pse.value - pse)
    return float(np.sqrt(np.mean(np.square(errors))))


def adaptive_error(trials: int, easy: float, seed: int, settings: MorphObserverSettings | None = None) -> float:
    """The same of a run whose weights are chosen by the answers.

    Args:
        trials: of the run.
        easy: share of trials that show an end of the morph.
        seed: of the observers and the easy trials.
        settings: who is simulated.

    Raises:
        HighFiveError: no trial.
    """
    settings = settings or MorphObserverSettings()
    if trials < 1:
        raise HighFiveError("no trial to find a PSE with")
    rng, errors = np.random.default_rng(seed), list[float]()
    for number, pse in enumerate(_pses(rng, settings)):
        run = begin_run(seed + number, settings=AdaptiveSettings(easy=easy))
        for _ in range(trials):
            weight = next_weight(run)
            run = answered(run, weight, bool(rng.random() < p_second(weight, pse, settings.width, settings.lapse)))
        errors.append(so_far(run).pse.value - pse)
    return float(np.sqrt(np.mean(np.square(errors))))


def _pses(rng: np.random.Generator, settings: MorphObserverSettings) -> list[float]:
    return (0.5 + settings.pse_spread * rng.standard_normal(settings.observers)).tolist()

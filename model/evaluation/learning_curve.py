"""Errors over the number of trials: subsets to learn from, and a power law that says what more trials would bring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from highfive.model.evaluation.baselines import nearest_neighbours
from highfive.model.evaluation.splits import Fold
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.dataset import Channels, training_set
from highfive.model.hgpdm.hierarchy import problem
from highfive.model.hgpdm.presets import DEFAULT
from highfive.model.hgpdm.trials import Trial

EXPONENTS = np.linspace(0.1, 2.0, 39)
"""Of the power laws that are tried; errors of regression fall by 1/2 in theory, often more slowly."""


@dataclass(frozen=True)
class PowerLaw:
    """error(n) = floor + gain · n^−exponent, of n trials a style; floor and gain are not negative."""

    floor: float
    gain: float
    exponent: float

    def __call__(self, trials: float) -> float:
        """The error that so many trials a style would leave."""
        return self.floor + self.gain * float(trials) ** -self.exponent


def fit_power_law(trials: Sequence[float], errors: Sequence[float]) -> PowerLaw:
    """The power law with the smallest squared error; of one number of trials alone, that error for ever.

    Source: Hestness et al. 2017 (learning curves are power laws above a floor).
    """
    counts, values = np.asarray(trials, dtype=float), np.asarray(errors, dtype=float)
    best, least = PowerLaw(float(values.mean()), 0.0, 1.0), float(np.sum((values - values.mean()) ** 2))
    for exponent in EXPONENTS:
        falling: Array = counts**-exponent
        centred = falling - falling.mean()
        spread = float(centred @ centred)
        free = float(centred @ values) / spread if spread > 1e-15 else 0.0
        through_zero = float(falling @ values) / float(falling @ falling)
        for gain in (free, through_zero):
            floor = float((values - gain * falling).mean()) if gain == free else 0.0
            squares = float(np.sum((floor + gain * falling - values) ** 2))
            if gain >= 0.0 and floor >= 0.0 and squares < least - 1e-15:
                best, least = PowerLaw(floor, gain, float(exponent)), squares
    return best


def draws(trials: Sequence[Trial], counts: Sequence[int], seed: int) -> list[Fold]:
    """Folds that learn from so many trials of each style (all, where it has fewer), and hold out what is held out.

    The smaller sets of a seed are parts of the larger ones. Numbers of trials that no style has are left out; where
    none is left, all that there is is learned from, and named by how much that is.
    """
    rng = np.random.default_rng(seed)
    order: list[int] = rng.permutation(len(trials)).tolist()
    styles: dict[str, list[int]] = {}
    for index in order:
        if not trials[index].test:
            styles.setdefault(trials[index].emotion, []).append(index)
    most = max(map(len, styles.values()), default=0)
    held = [trial for trial in trials if trial.test]
    folds: list[Fold] = []
    fit = [count for count in sorted(set(counts)) if count <= most]
    for count in fit or ([most] if counts else []):
        chosen = sorted(index for members in styles.values() for index in members[:count])
        folds.append(Fold(f"{count} a style", (*(trials[index] for index in chosen), *held)))
    return folds


def proxy_curve(trials: Sequence[Trial], seed: int = 0, repeats: int = 3) -> tuple[list[int], Array]:
    """Numbers of trials a style (n,), and the neighbours' RMS error (repeats, n), m, of the palm in trials left out.

    It costs a second: a cheap stand-in for the model's curve, whose errors are others and whose slope is alike. A fifth
    of the trials, one at least, is left out; ([], (repeats, 0)) of fewer than three trials a style.
    """
    learn = [replace(trial, test=False) for trial in trials if not trial.test]
    fewest = min((sum(t.emotion == name for t in learn) for name in {t.emotion for t in learn}), default=0)
    most = fewest - max(1, fewest // 5)
    if most < 2:
        return [], np.zeros((repeats, 0))
    counts = sorted({max(1, round(most * part)) for part in (0.25, 0.5, 0.75, 1.0)})
    errors = np.zeros((repeats, len(counts)))
    for repeat in range(repeats):
        rng = np.random.default_rng([seed, repeat])
        styles: dict[str, list[Trial]] = {}
        order: list[int] = rng.permutation(len(learn)).tolist()
        for index in order:
            styles.setdefault(learn[index].emotion, []).append(learn[index])
        out = [trial for members in styles.values() for trial in members[most:]]
        names = list(styles)
        held = training_set(out, DEFAULT, names)
        for column, count in enumerate(counts):
            task = problem(training_set([t for m in styles.values() for t in m[:count]], DEFAULT, names), DEFAULT)
            palm = Channels(out[0].joints.shape[1]).palm
            said = nearest_neighbours(task)(task.feature_map(held.history), held.styles)
            squares: Array = np.sum((said - held.outputs)[:, palm] ** 2, axis=1)
            errors[repeat, column] = np.sqrt(np.mean(squares))
    return counts, errors


def gains(counts: Sequence[float], errors: Array, more: Sequence[float]) -> list[tuple[float, float, float]]:
    """What further trials would bring: the fall of the error from the last count on, in the middle and its range.

    Args:
        counts: (n,) trials a style.
        errors: (draws, n).
        more: so many further trials a style.

    Returns:
        For each of ``more`` median, smallest and largest over the draws' own power laws.
    """
    laws = [fit_power_law(counts, row) for row in errors]
    found: list[tuple[float, float, float]] = []
    for further in more:
        falls = [law(counts[-1]) - law(counts[-1] + further) for law in laws]
        found.append((float(np.median(falls)), min(falls), max(falls)))
    return found

"""Which of several models is being trained, and for how long that will go on."""

from __future__ import annotations

import math
from collections.abc import Callable

from highfive.hil.runtime.clock import MACHINE
from highfive.hil.runtime.console import Advance, Bar
from highfive.model.gp.optimise import Progress, ProgressCallback

ENOUGH = 5
"""Steps, after the one that compiles, from which on the time is said."""


class TrainingCount:
    """Counts models that are trained one after the other; each tells once how long all that are left will take.

    A model takes as long as those before it took, with all that was done with them. The first is judged by the pace of
    its own steps: what comes after the stage that it is in is not known yet.
    """

    def __init__(self, bar: Bar, total: int, say: Callable[[str], None], now: Callable[[], int] = MACHINE.now):
        """Of ``total`` models; ``say`` gets a line for each, ``now`` is a clock, ns."""
        self._bar, self._total, self._say = bar, total, say
        self._clock = lambda: 1e-9 * now()
        self._number = 0
        self._took: list[float] = []  # s, of models that were trained and not found ready
        self._began: float | None = None

    def next(self, name: str = "") -> ProgressCallback:
        """What is called after each step of the next model; ``name`` says what distinguishes it."""
        if self._began is not None:
            self._took.append(self._clock() - self._began)
        self._number, self._began = self._number + 1, None
        which = f"model {self._number} of {self._total}"
        shown = training_bars(self._bar, ", ".join(part for part in (which, name) if part) + ", ")
        first: Progress | None = None
        start, said = 0.0, False

        def step(progress: Progress) -> None:
            nonlocal first, start, said
            shown(progress)
            now = self._clock()
            self._began = now if self._began is None else self._began
            if said or not math.isfinite(progress.objective):
                return
            if first is None or first.stage != progress.stage:
                first, start = progress, now
            elif progress.iteration >= min(first.iteration + ENOUGH, progress.iterations):
                pace = (now - start) / (progress.iteration - first.iteration)
                left = self._left(now - self._began, pace * (progress.iterations - progress.iteration))
                self._say(f"{which}, about {max(1, round(left / 60.0))} min{'' if self._total == 1 else ' for all'}")
                said = True

        return step

    def _left(self, since: float, stage: float) -> float:
        """Seconds until all are trained, after ``since`` s of a model whose stage takes another ``stage`` s."""
        more = self._total - self._number
        if not self._took:
            return stage + more * (since + stage)
        each = sum(self._took) / len(self._took)
        return max(stage, each - since) + more * each


def training_bars(bar: Bar, label: str = "") -> ProgressCallback:
    """Shows each stage of a training as a bar, with the objective; a resumed stage begins where it was."""
    bars: dict[str, Advance] = {}

    def step(progress: Progress) -> None:
        if progress.stage not in bars:
            bars[progress.stage] = bar(label + progress.stage, progress.iterations)
        known = math.isfinite(progress.objective)
        bars[progress.stage](f"objective {progress.objective:.3f}" if known else "compiling", progress.iteration)

    return step

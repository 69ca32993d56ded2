"""An optimisation begun from several seeds, of which the best is kept; it can be resumed wherever it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Generic, TypeVar

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.gp.optimise import Diverged, State
from highfive.model.hgpdm.checkpoint import Checkpoint, Unfitting

Tree = TypeVar("Tree")
Say = Callable[[str], None]
Optimise = Callable[[Tree, str, State | None, Callable[[State], None]], tuple[Tree, list[float]]]
"""From a start, the name of the stage, a state to resume and who keeps states, to parameters and objectives."""

SPARE = 2  # further seeds that are tried for those that fail


@dataclass(frozen=True)
class Start:
    """What became of one seed.

    Attributes:
        seed: the seed.
        steps: steps done.
        objective: where it ended, or None where it failed.
        failure: why it failed, or ''.
    """

    seed: int
    steps: int
    objective: float | None
    failure: str = ""


@dataclass(frozen=True)
class Best(Generic[Tree]):
    """The seed with the lowest objective.

    Attributes:
        parameters: what it found.
        seed: the seed.
        trace: objective after each step.
        starts: all seeds that were tried.
    """

    parameters: Tree
    seed: int
    trace: list[float]
    starts: list[Start]


class _Memory:
    """The seeds that are done, the best of them, and the state of the one under way."""

    def __init__(self, checkpoint: Checkpoint | None, say: Say) -> None:
        self.checkpoint, self.say = checkpoint, say
        self.starts: list[Start] = []
        self.best: tuple[int, NDArray[Any], list[float]] | None = None  # seed, parameters, trace
        self.state: State | None = None
        self._writes = True
        if checkpoint is None:
            return
        try:
            arrays = checkpoint.load()
        except Unfitting as error:
            say(f"{error}; it is kept as {checkpoint.set_aside().name}, and training begins anew")
            return
        if arrays is None:
            return
        try:
            self.starts = [Start(**start) for start in json.loads(str(arrays["starts"]))]
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            say(f"the checkpoint's seeds cannot be read ({type(error).__name__}); it is kept as "
                f"{checkpoint.set_aside().name}, and training begins anew")  # fmt: skip
            return
        if "best_point" in arrays:
            self.best = (int(arrays["best_seed"]), arrays["best_point"], arrays["best_trace"].tolist())
        if "point" in arrays:
            point, mean, square = (arrays[name] for name in ("point", "mean", "square"))
            self.state = State(point, mean, square, float(arrays["rate"]), tuple(arrays["trace"].tolist()))

    @property
    def found(self) -> int:
        """Seeds that did not fail."""
        return sum(not start.failure for start in self.starts)

    def finish(self, start: Start, point: NDArray[Any], trace: list[float]) -> None:
        """One more seed is done; ``point`` counts if it is the best."""
        found = [s.objective for s in self.starts if s.objective is not None]
        if start.objective is not None and start.objective < min(found, default=np.inf):
            self.best = (start.seed, point, trace)
        self.starts.append(start)
        self.keep(None)

    def keep(self, state: State | None) -> None:
        """Writes everything; a disk that takes nothing is reported once, and training goes on."""
        self.state = state
        if self.checkpoint is None:
            return
        arrays: dict[str, NDArray[Any]] = {"starts": np.array(json.dumps([asdict(start) for start in self.starts]))}
        if self.best is not None:
            seed, point, trace = self.best
            arrays |= {"best_seed": np.array(seed), "best_point": point, "best_trace": np.array(trace)}
        if state is not None:
            arrays |= {name: np.asarray(value) for name, value in state._asdict().items()}
        try:
            self.checkpoint.save(arrays)
            self._writes = True
        except HighFiveError as error:
            if self._writes:
                self.say(f"{error}; training goes on, but a kill would lose it")
            self._writes = False


def best_of(
    optimise: Optimise[Tree],
    draw: Callable[[int], Tree],
    seed: int,
    restarts: int,
    checkpoint: Checkpoint | None = None,
    say: Say = lambda line: None,
) -> Best[Tree]:
    """Optimises from ``restarts`` seeds, ``seed`` and those after it, and keeps the lowest objective.

    Args:
        optimise: one optimisation.
        draw: the start of a seed; the trees of all seeds have the same shapes.
        seed: the first seed.
        restarts: how many seeds; for one that fails the next one is taken, twice at most.
        checkpoint: where to keep what is needed to go on, and where to look for it first.
        say: called with a line about what a user should know.

    Raises:
        HighFiveError: every seed that was tried fails.
    """
    memory = _Memory(checkpoint, say)
    stage = "training" if restarts == 1 else "training, seed {}"
    if memory.starts or memory.state is not None:
        done = ", ".join(f"seed {s.seed}: {s.failure or f'{s.objective:.3f}'}" for s in memory.starts)
        at = 0 if memory.state is None else len(memory.state.trace)
        where = "" if checkpoint is None else f"found {checkpoint.path}: "
        if memory.found < restarts:
            say(f"{where}training goes on after step {at} of seed {seed + len(memory.starts)}{done and f' ({done})'}")
        else:
            say(f"{where}training is done ({done})")
    while memory.found < restarts:
        current = seed + len(memory.starts)
        begin = draw(current)
        state = memory.state
        if state is not None and state.point.size != ravel_pytree(begin)[0].size:
            raise HighFiveError("the checkpoint holds another number of parameters; delete it to begin anew")
        try:
            found, trace = optimise(begin, stage.format(current), state, memory.keep)
        except Diverged as error:
            memory.finish(Start(current, 0, None, str(error)), np.zeros(0), [])
            failures = sum(bool(start.failure) for start in memory.starts)
            if failures > SPARE:
                raise HighFiveError(f"{failures} seeds failed, the last one: {error}") from None
            say(f"seed {current} failed ({error}); trying seed {current + 1}")
            continue
        point = np.asarray(ravel_pytree(found)[0])
        memory.finish(Start(current, len(trace), trace[-1]), point, trace)
    assert memory.best is not None
    best_seed, point, trace = memory.best
    _, unravel = ravel_pytree(draw(best_seed))
    return Best(unravel(jnp.asarray(point)), best_seed, trace, memory.starts)

"""Adam, then L-BFGS, over any tree of parameters, with progress, a state to resume from, and named failures.

Both see the whole objective; nothing is random. L-BFGS alone crawls here, because latents, inducing inputs and
log-scales differ by orders of magnitude in curvature: 250 steps of it reached what 150 steps of Adam reach, and 8.2 cm
at contact instead of 5.9 (2,000 points, 100 inducing inputs). L-BFGS then finishes what Adam is too coarse for,
unless the preset ends before: the default one does, since what is gained then is lost on new trials.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from scipy.optimize import minimize

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

Tree = TypeVar("Tree")

UNUSABLE = 1e10  # value given to a step whose covariance is not positive definite, so that the line search backs off


@dataclass(frozen=True)
class OptimiserSettings(Settings):
    """How steps are taken. Chosen on 2,000 points of simulated pairs, 100 inducing inputs; decays by convention."""

    mean_decay: float = setting(0.9, above=0.0, below=1.0)
    """Of Adam's running mean of the gradient (Kingma & Ba 2015)."""
    square_decay: float = setting(0.99, above=0.0, below=1.0)
    """Of its running mean of the gradient's square."""
    warmup: int = setting(20, "steps", least=1)
    """Over which the learning rate rises, so that the first, unscaled gradients do no harm."""
    last_rate: float = setting(0.05, above=0.0, most=1.0)
    """Share of the learning rate left at Adam's last step."""
    halvings: int = setting(10, least=1)
    """Times that the learning rate is halved at steps into the unusable, before giving up."""
    memory: int = setting(20, least=1)
    """Curvature pairs that L-BFGS keeps."""
    stretch: int = setting(100, "steps", least=1)
    """After which L-BFGS begins anew, so that a resumed run can take the same way."""
    keep_every: int = setting(20, "steps", least=1)
    """Steps of Adam between states to resume from."""
    tail: float = setting(0.1, above=0.0, most=1.0)
    """Share of the steps, at the end, that tells whether an optimisation has converged."""


OPTIMISER = OptimiserSettings()


class Diverged(HighFiveError):
    """An optimisation that cannot start from where it was put, or runs to where it has no value."""


@dataclass(frozen=True)
class Progress:
    """Where an optimisation is.

    Attributes:
        stage: what is being fitted.
        iteration: steps done.
        iterations: steps at most.
        objective: negative log density a training point; NaN before the first step.
    """

    stage: str
    iteration: int
    iterations: int
    objective: float


ProgressCallback = Callable[[Progress], None]


class State(NamedTuple):
    """Everything that an optimisation remembers between two steps: with it, a resumed run takes the same way.

    Attributes:
        point: (P,) parameters.
        mean, square: (P,) Adam's running means of the gradient and of its square; empty once L-BFGS has begun.
        rate: factor of the learning rate; halved where a step led into the unusable.
        trace: objective after each step done.
    """

    point: Array
    mean: Array
    square: Array
    rate: float
    trace: tuple[float, ...]


def fall_at_the_end(trace: Sequence[float], settings: OptimiserSettings = OPTIMISER) -> float:
    """Fall of the objective over the last steps, relative to where it ends; 0 with less than two steps."""
    values = np.asarray(trace, dtype=float)
    if len(values) < 2:
        return 0.0
    tail = max(1, round(settings.tail * len(values)))
    return float((values[-1 - tail] - values[-1]) / max(abs(values[-1]), 1e-12))


class _Run:
    """One optimisation: evaluates, counts steps, reports, and hands out states to keep."""

    def __init__(
        self,
        evaluate: Callable[[Array], tuple[jax.Array, jax.Array]],
        stage: str,
        iterations: int,
        progress: ProgressCallback | None,
        keep: Callable[[State], None] | None,
        settings: OptimiserSettings,
    ) -> None:
        self.evaluate, self.stage, self.iterations = evaluate, stage, iterations
        self.progress, self.keep, self.settings = progress, keep, settings

    def value_and_gradient(self, point: Array) -> tuple[float, Array]:
        value, gradient = self.evaluate(point)
        value, gradient = float(value), np.asarray(gradient)
        if not (np.isfinite(value) and np.all(np.isfinite(gradient))):
            return UNUSABLE, np.zeros_like(gradient)
        return value, gradient

    def report(self, trace: Sequence[float]) -> None:
        if self.progress is not None:
            self.progress(Progress(self.stage, len(trace), self.iterations, trace[-1] if trace else np.nan))

    def save(self, state: State) -> None:
        if self.keep is not None:
            self.keep(state)

    def diverged(self, steps: int) -> Diverged:
        return Diverged(
            f"{self.stage} diverged after {steps} steps: a covariance is no longer positive definite; use another "
            "seed or fewer inducing inputs"
        )


def _adam(run: _Run, state: State, value: float, gradient: Array, steps: int, rate: float) -> State:
    """Full-batch Adam up to step ``steps``, its rate falling along half a cosine.

    A step to where the objective has no value is taken again at half the rate, which stays halved.
    """
    own = run.settings
    try:
        while (done := len(state.trace)) < steps:
            age = done + 1
            mean = own.mean_decay * state.mean + (1.0 - own.mean_decay) * gradient
            square = own.square_decay * state.square + (1.0 - own.square_decay) * gradient**2
            falling = own.last_rate + (1.0 - own.last_rate) * 0.5 * (1.0 + np.cos(np.pi * done / steps))
            spread = np.sqrt(square / (1.0 - own.square_decay**age)) + 1e-12
            direction = mean / (1.0 - own.mean_decay**age) / spread
            factor = state.rate
            while True:
                point = state.point - rate * factor * min(1.0, age / own.warmup) * falling * direction
                value, gradient = run.value_and_gradient(point)
                if value != UNUSABLE:
                    break
                factor *= 0.5
                if factor < 0.5**own.halvings:
                    raise run.diverged(done)
            state = State(point, mean, square, factor, (*state.trace, value))
            run.report(state.trace)
            if age % own.keep_every == 0 or age == steps:
                run.save(state)
    except KeyboardInterrupt:
        run.save(state)
        raise
    return state


def _lbfgs(run: _Run, state: State) -> State:
    """One stretch of L-BFGS; ends early where it finds no lower value."""
    begun = len(state.trace)
    trace, last = list(state.trace), [np.inf]

    def evaluate(point: Array) -> tuple[float, Array]:
        value, gradient = run.value_and_gradient(point)
        last[0] = value
        return value, gradient

    def step(_: Array) -> None:
        trace.append(last[0])
        run.report(trace)

    steps = min(run.settings.stretch, run.iterations - begun)
    options = {"maxiter": steps, "maxcor": run.settings.memory, "maxfun": 3 * run.iterations, "ftol": 1e-9}
    result = minimize(evaluate, state.point, jac=True, method="L-BFGS-B", callback=step, options=options)
    if not np.all(np.isfinite(result.x)) or result.fun >= UNUSABLE:
        raise run.diverged(len(trace))
    return State(np.asarray(result.x), np.zeros(0), np.zeros(0), state.rate, tuple(trace))


def minimise(
    function: Callable[..., jax.Array],
    start: Tree,
    iterations: int,
    adam_steps: int = 0,
    learning_rate: float = 0.1,
    stage: str = "training",
    progress: ProgressCallback | None = None,
    resume: State | None = None,
    keep: Callable[[State], None] | None = None,
    arguments: tuple[Any, ...] = (),
    settings: OptimiserSettings = OPTIMISER,
) -> tuple[Tree, list[float]]:
    """Parameters that minimise ``function``, and its value after every step.

    Args:
        function: a scalar of a tree of float64 arrays, and of ``arguments``, traceable by JAX.
        start: where to start.
        iterations: steps at most, Adam's included.
        adam_steps: how many of them are Adam's.
        learning_rate: Adam's, in the parameters' units.
        stage: name for progress and messages.
        progress: called at the beginning, when compiling takes seconds, and after every step.
        resume: a state that ``keep`` was given in a run with the same arguments; goes on from there on the same way.
        keep: called with a state to resume from every few steps of Adam, after each stretch of L-BFGS, and when
            Ctrl-C interrupts Adam.
        arguments: trees of arrays handed on to ``function``; they may be spread over devices.
        settings: how steps are taken.

    Raises:
        Diverged: the start is unusable, or the steps lead where a covariance is not positive definite.
    """
    vector, unravel = ravel_pytree(start)

    def of_vector(flat: Any, *given: Any) -> jax.Array:
        return function(unravel(flat), *given)

    evaluate = jax.jit(jax.value_and_grad(of_vector))
    run = _Run(lambda flat: evaluate(flat, *arguments), stage, iterations, progress, keep, settings)
    first = np.asarray(vector)
    state = resume or State(first, np.zeros_like(first), np.zeros_like(first), 1.0, ())
    run.report(state.trace)
    if len(state.trace) < iterations:
        value, gradient = run.value_and_gradient(state.point)
        if value == UNUSABLE:
            raise Diverged(
                f"{stage} cannot start: a covariance is not positive definite; look for duplicated trials or huge "
                "values in the data, or use fewer inducing inputs"
            )
        state = _adam(run, state, value, gradient, min(adam_steps, iterations), learning_rate)
    while (begun := len(state.trace)) < iterations:
        state = _lbfgs(run, state)
        if len(state.trace) - begun < settings.stretch:  # it has converged, or all steps are done
            break
        run.save(state)
    return unravel(jnp.asarray(state.point)), list(state.trace)

"""L-BFGS over any tree of parameters, with progress, checkpoints and named failures."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from scipy.optimize import minimize

from model.errors import HighFiveError
from model.rotations import Array

Tree = TypeVar("Tree")

MEMORY = 20  # curvature pairs that L-BFGS keeps
CHECKPOINT_EVERY = 20  # steps between checkpoints
UNUSABLE = 1e10  # value given to a step whose covariance is not positive definite, so that the line search backs off


@dataclass(frozen=True)
class Progress:
    """Where an optimisation is.

    Attributes:
        stage: what is being fitted.
        iteration: steps done.
        iterations: steps at most.
        objective: negative log density a training point.
        seconds_left: s, at the present speed, if all steps are needed.
    """

    stage: str
    iteration: int
    iterations: int
    objective: float
    seconds_left: float


ProgressCallback = Callable[[Progress], None]


def save_checkpoint(path: Path, key: str, iteration: int, vector: Array) -> None:
    """Writes a checkpoint in one piece: a kill leaves the old one or the new one."""
    partial = path.with_name(path.name + ".partial")
    with partial.open("wb") as file:
        np.savez(file, key=np.array(key), iteration=np.array(iteration), vector=vector)
    os.replace(partial, path)


def load_checkpoint(path: Path, key: str, size: int) -> tuple[int, Array] | None:
    """Steps done and parameters of a checkpoint, or None if there is none for this key (data, preset, seed, sizes)."""
    if not path.exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as stored:
            found, iteration, vector = str(stored["key"]), int(stored["iteration"]), stored["vector"]
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise HighFiveError(f"{path} is not a training checkpoint ({error}); delete it to start afresh") from None
    except Exception as error:  # zipfile has its own root for a truncated archive
        raise HighFiveError(f"{path} is a broken training checkpoint ({error}); delete it to start afresh") from None
    return (iteration, vector) if found == key and vector.shape == (size,) else None


def minimise(
    function: Callable[[Tree], jax.Array],
    start: Tree,
    iterations: int,
    stage: str = "training",
    progress: ProgressCallback | None = None,
    checkpoint: Path | None = None,
    key: str = "",
) -> tuple[Tree, list[float]]:
    """Parameters that minimise ``function``, and its value after every step.

    Args:
        function: a scalar of a tree of float64 arrays, traceable by JAX.
        start: where to start.
        iterations: steps at most.
        stage: name for progress and messages.
        progress: called after every step.
        checkpoint: file to write every few steps and to resume from if it belongs to ``key``.
        key: what the checkpoint belongs to.

    Raises:
        HighFiveError: the start is unusable, or every step from somewhere on is.
    """
    vector, unravel = ravel_pytree(start)
    evaluate = jax.jit(jax.value_and_grad(lambda flat: function(unravel(flat))))
    begun, point = 0, np.asarray(vector)
    if checkpoint is not None and (resumed := load_checkpoint(checkpoint, key, point.size)) is not None:
        begun, point = resumed
    started, done, last = time.monotonic(), begun, [np.inf]
    trace: list[float] = []

    def value_and_gradient(flat: Array) -> tuple[float, Array]:
        value, gradient = evaluate(jnp.asarray(flat))
        value, gradient = float(value), np.asarray(gradient)
        if not (np.isfinite(value) and np.all(np.isfinite(gradient))):
            return UNUSABLE, np.zeros_like(gradient)
        last[0] = value
        return value, gradient

    def after_step(flat: Array) -> None:
        nonlocal done
        done += 1
        trace.append(last[0])
        if checkpoint is not None and done % CHECKPOINT_EVERY == 0:
            save_checkpoint(checkpoint, key, done, flat)
        if progress is not None:
            left = (time.monotonic() - started) / (done - begun) * (iterations - done)
            progress(Progress(stage, done, iterations, last[0], left))

    if value_and_gradient(point)[0] == UNUSABLE:
        raise HighFiveError(
            f"{stage} cannot start: a covariance is not positive definite; look for duplicated trials or huge values in "
            "the data, or use fewer inducing inputs"
        )
    if done < iterations:
        options = {"maxiter": iterations - done, "maxcor": MEMORY, "maxfun": 3 * iterations, "ftol": 1e-9, "gtol": 1e-7}
        result = minimize(value_and_gradient, point, jac=True, method="L-BFGS-B", callback=after_step, options=options)
        if not np.all(np.isfinite(result.x)) or result.fun >= UNUSABLE:
            raise HighFiveError(f"{stage} diverged after {done} steps; use another seed or fewer inducing inputs")
        point = result.x
    if checkpoint is not None:
        save_checkpoint(checkpoint, key, iterations, point)
    return unravel(jnp.asarray(point)), trace

"""One layer of a published sparse GP library, timed: a program of its own, for an interpreter that has the library.

Arguments: points, channels, inducing inputs, seed. Prints the library and its version as JSON once it is ready, then
for every line that it reads the seconds of one objective with its gradient. It imports nothing of High Five, because
GPflow wants another NumPy.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from importlib.metadata import version

import numpy as np

DIMS = 2  # latent inputs, which are parameters


def _data(points: int, channels: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (N, 2) and smooth functions of them (N, D) with noise."""
    rng = np.random.default_rng(seed)
    inputs = rng.normal(size=(points, DIMS))
    values = np.sin(inputs @ rng.normal(size=(DIMS, channels)) + rng.uniform(0.0, 6.0, channels))
    return inputs, values + 0.1 * rng.normal(size=values.shape)


def _gpflow(inputs: np.ndarray, values: np.ndarray, inducing: int) -> Callable[[], object]:
    import gpflow  # noqa: PLC0415  # pyright: ignore[reportMissingImports]
    import tensorflow  # noqa: PLC0415  # pyright: ignore[reportMissingModuleSource]

    kernel = gpflow.kernels.RBF(lengthscales=np.ones(DIMS))
    model = gpflow.models.SGPR((inputs, values), kernel, inputs[:inducing].copy())
    model.data = (gpflow.Parameter(inputs), tensorflow.constant(values))

    @tensorflow.function
    def evaluate():
        with tensorflow.GradientTape() as tape:
            loss = -model.elbo()
        return loss, tape.gradient(loss, model.trainable_variables)

    def once() -> object:
        loss, gradients = evaluate()
        return loss.numpy(), [tensorflow.convert_to_tensor(gradient).numpy() for gradient in gradients]

    return once


def _gpy(inputs: np.ndarray, values: np.ndarray, inducing: int) -> Callable[[], object]:
    import GPy  # noqa: PLC0415  # pyright: ignore[reportMissingImports]

    kernel = GPy.kern.RBF(DIMS, ARD=True)
    model = GPy.models.SparseGPLVM(values, DIMS, X=inputs.copy(), kernel=kernel, num_inducing=inducing)
    start = model.optimizer_array.copy()
    rng = np.random.default_rng(0)
    return lambda: model._objective_grads(start + 1e-6 * rng.normal(size=start.shape))


def main() -> None:
    """Answers each line on standard input with the seconds that one evaluation took."""
    points, channels, inducing, seed = (int(argument) for argument in sys.argv[1:])
    inputs, values = _data(points, channels, seed)
    for name, build in (("gpflow", _gpflow), ("GPy", _gpy)):
        try:
            once = build(inputs, values, inducing)
        except ImportError:
            continue
        once()  # compiles
        print(json.dumps({"name": name, "version": version(name)}), flush=True)
        for _ in sys.stdin:
            begun = time.perf_counter()
            once()
            print(time.perf_counter() - begun, flush=True)
        return
    print(json.dumps(None), flush=True)


if __name__ == "__main__":
    main()

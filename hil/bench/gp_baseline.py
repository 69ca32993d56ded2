"""One layer of a published sparse GP library, timed: a program of its own, for an interpreter that has the library.

Arguments: points, channels, inducing inputs, seed, and the layers of the model as JSON, dimensions of the inputs and
channels of each. Prints the library and its version as JSON once it is ready, and whether it can do all layers; then
for every line that it reads the seconds of one objective with its gradient: of one layer with two inputs, or, for the
line ``all``, of all layers in one. It imports nothing of High Five, because GPflow wants another NumPy.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version

import numpy as np

DIMS = 2  # latent inputs, which are parameters


def _data(points: int, channels: int, seed: int, dims: int = DIMS) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (N, q) and smooth functions of them (N, D) with noise."""
    rng = np.random.default_rng(seed)
    inputs = rng.normal(size=(points, dims))
    values = np.sin(inputs @ rng.normal(size=(dims, channels)) + rng.uniform(0.0, 6.0, channels))
    return inputs, values + 0.1 * rng.normal(size=values.shape)


Data = tuple[np.ndarray, np.ndarray]


def _gpflow(layers: Sequence[Data], inducing: int) -> Callable[[], object]:
    """The sum of the layers' bounds and its gradient by kernels, noises, inducing inputs and inputs."""
    import gpflow  # noqa: PLC0415  # pyright: ignore[reportMissingImports]
    import tensorflow  # noqa: PLC0415  # pyright: ignore[reportMissingModuleSource]

    models = []
    for inputs, values in layers:
        dims = inputs.shape[1]
        kernel = gpflow.kernels.RBF(lengthscales=np.ones(dims)) + gpflow.kernels.Linear(variance=np.full(dims, 0.1))
        model = gpflow.models.SGPR((inputs, values), kernel, inputs[:inducing].copy())
        model.data = (gpflow.Parameter(inputs), tensorflow.constant(values))
        models.append(model)
    variables = [variable for model in models for variable in model.trainable_variables]

    @tensorflow.function
    def evaluate():
        with tensorflow.GradientTape() as tape:
            loss = -tensorflow.add_n([model.elbo() for model in models])
        return loss, tape.gradient(loss, variables)

    def once() -> object:
        loss, gradients = evaluate()
        return loss.numpy(), [tensorflow.convert_to_tensor(gradient).numpy() for gradient in gradients]

    return once


def _gpy(layers: Sequence[Data], inducing: int) -> Callable[[], object]:
    import GPy  # noqa: PLC0415  # pyright: ignore[reportMissingImports]

    ((inputs, values),) = layers
    kernel = GPy.kern.RBF(DIMS, ARD=True)
    model = GPy.models.SparseGPLVM(values, DIMS, X=inputs.copy(), kernel=kernel, num_inducing=inducing)
    start = model.optimizer_array.copy()
    rng = np.random.default_rng(0)
    return lambda: model._objective_grads(start + 1e-6 * rng.normal(size=start.shape))


def main() -> None:
    """Answers each line on standard input with the seconds that one evaluation took."""
    points, channels, inducing, seed = (int(argument) for argument in sys.argv[1:5])
    shapes: list[tuple[int, int]] = json.loads(sys.argv[5])
    one = [_data(points, channels, seed)]
    every = [_data(points, wide, seed, dims) for dims, wide in shapes]
    for name, build, several in (("gpflow", _gpflow, True), ("GPy", _gpy, False)):
        try:
            ways = {"": build(one, inducing)}
            if several:
                ways["all"] = build(every, inducing)
        except ImportError:
            continue
        for once in ways.values():
            once()  # compiles
        print(json.dumps({"name": name, "version": version(name), "all": several}), flush=True)
        for line in sys.stdin:
            once = ways[line.strip()]
            begun = time.perf_counter()
            once()
            print(time.perf_counter() - begun, flush=True)
        return
    print(json.dumps(None), flush=True)


if __name__ == "__main__":
    main()

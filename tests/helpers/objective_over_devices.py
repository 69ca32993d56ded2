"""Prints the objective and its gradient, over all devices of all processes, as JSON: a program for test_sharding.py.

Arguments: preset, number of processes, number of this one, address of the first one.
"""

import json
import sys
from dataclasses import replace

import jax
import numpy as np
from jax.experimental import multihost_utils


def main(name: str, processes: int, number: int, address: str) -> None:
    if processes > 1:
        jax.config.update("jax_cpu_collectives_implementation", "gloo")
        patience = {"initialization_timeout": 900, "heartbeat_timeout_seconds": 900, "shutdown_timeout_seconds": 900}
        jax.distributed.initialize(address, processes, number, **patience)
        # They connect now, while they are together: the one that compiles longer would be given up after 30 s.
        multihost_utils.sync_global_devices("begun")
    # Only now: these imports ask JAX for its devices.
    from made_up import EMOTIONS, made_up_trial  # noqa: PLC0415

    from highfive.model.hgpdm.dataset import training_set  # noqa: PLC0415
    from highfive.model.hgpdm.hierarchy import objective, problem  # noqa: PLC0415
    from highfive.model.hgpdm.initial import initial_parameters  # noqa: PLC0415
    from highfive.model.hgpdm.presets import PRESETS  # noqa: PLC0415
    from highfive.model.hgpdm.sharding import spread  # noqa: PLC0415

    rng = np.random.default_rng(2)
    trials = [made_up_trial(goal, emotion, 60.0, rng) for goal in (0.3, 0.5, 0.7) for emotion in EMOTIONS]
    preset = PRESETS[name]
    alone = problem(training_set(trials, replace(preset, points=300)), preset)
    start = initial_parameters(alone, 20, np.random.default_rng(0))
    start = jax.tree.map(lambda leaf: leaf + 0.01 * np.random.default_rng(1).normal(size=leaf.shape), start)
    spread_out = spread(alone)
    evaluate = jax.jit(jax.value_and_grad(lambda p, points: objective(p, spread_out, points)))
    value, gradient = evaluate(jax.tree.map(np.asarray, start), spread_out.points)
    found = {
        "devices": jax.device_count(),
        "points": len(alone.data.trial),
        "value": float(value),
        "gradient": [np.asarray(leaf).ravel().tolist() for leaf in jax.tree.leaves(gradient)],
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])

"""The objective's points spread over devices, of one host or of several, by JAX's own sharding.

Every device sums over its share of the points; only sums of the size of the inducing inputs are exchanged. Parameters
are the same everywhere. With several hosts each calls :func:`join_hosts` before anything else and then runs the same
program on the same data; every one ends with the same model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.hierarchy import POINTS, PointArrays, Problem

PATIENCE_S = 900
"""For hosts that are not there yet, s or compile."""


def join_hosts(hosts: Sequence[str], process: int | None = None) -> int:
    """Makes this process one of several that train together; call it before anything else of JAX.

    Args:
        hosts: addresses in the same order everywhere, the first with a port, where the processes meet; or ``auto``
            alone where a scheduler that JAX knows (SLURM, Open MPI, Kubernetes) started them.
        process: which of them this is, from 0; with ``auto`` the scheduler says it.

    Returns:
        Which process this is; process 0 writes the model.

    Raises:
        HighFiveError: addresses that do not fit, no scheduler, or processes that do not meet.
    """
    automatic = list(hosts) == ["auto"]
    if not automatic and (len(hosts) < 2 or ":" not in hosts[0]):
        raise HighFiveError(f"hosts {','.join(hosts)}; expected auto, or several with a port behind the first")
    if not automatic and (process is None or not 0 <= process < len(hosts)):
        which = "which of them is this" if process is None else f"process {process} of {len(hosts)}"
        raise HighFiveError(f"{len(hosts)} hosts, {which}? --process-id takes its number, from 0 to {len(hosts) - 1}")
    jax.config.update("jax_cpu_collectives_implementation", "gloo")  # of CPUs; GPUs have their own
    try:
        jax.distributed.initialize(
            None if automatic else hosts[0],
            None if automatic else len(hosts),
            process,
            initialization_timeout=PATIENCE_S,
            heartbeat_timeout_seconds=PATIENCE_S,
        )
        # They connect now, while they are together: the one that compiles longer would be given up after 30 s.
        multihost_utils.sync_global_devices("begun")
    except (RuntimeError, ValueError) as error:
        line = str(error).strip().split("\n")[0]
        raise HighFiveError(f"the hosts did not meet ({line}); does a scheduler run, is the port open?") from None
    return host_number()


def host_number() -> int:
    """Which of the joined processes this is; 0 where none were joined."""
    return jax.process_index()


def host_count() -> int:
    """How many processes were joined; 1 where none were."""
    return jax.process_count()


def points_mesh(devices: Sequence[Any] | None = None) -> Mesh:
    """Devices in a row, by default all of all hosts."""
    return Mesh(np.array(jax.devices() if devices is None else devices), (POINTS,))


def spread(task: Problem, mesh: Mesh | None = None) -> Problem:
    """The problem with its points in equal shares on the devices of ``mesh``, by default on all there are.

    Where N does not divide, rows that do not count fill it up. On a single device nothing changes.
    """
    if mesh is None and jax.device_count() == 1:
        return task
    mesh = points_mesh() if mesh is None else mesh
    sharding = NamedSharding(mesh, PartitionSpec(POINTS))

    def place(array: jax.Array) -> jax.Array:
        rows = -len(array) % mesh.size
        filled = np.pad(np.asarray(array), [(0, rows)] + [(0, 0)] * (array.ndim - 1))
        return jax.make_array_from_callback(filled.shape, sharding, lambda index: filled[index])

    return replace(task, points=PointArrays(*(place(array) for array in task.points)), mesh=mesh)

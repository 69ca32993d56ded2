"""The objective's points spread over devices, of one host or of several, by JAX's own sharding.

Every device sums over its share of the points; only sums of the size of the inducing inputs are exchanged. Parameters
are the same everywhere. With several hosts each calls ``jax.distributed.initialize`` before anything else and then runs
the same program on the same data; every one ends with the same model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from highfive.model.hgpdm.hierarchy import POINTS, PointArrays, Problem


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

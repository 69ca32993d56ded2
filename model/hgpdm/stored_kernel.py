"""A kernel as named arrays, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from highfive.model.geometry.rotations import Array
from highfive.model.gp.kernels import KERNELS, Kernel, MotionKernel, Product, Sum

CLASSES = {**KERNELS, "Sum": Sum, "Product": Product}


def kernel_arrays(name: str, kernel: Kernel) -> dict[str, Array]:
    """The parameters of a kernel, their names beginning with ``name``.

    They say the class, as in ``avatar.kernel.Sum.left.RBF.log_variance``; only those of :class:`MotionKernel` do not.
    """
    prefix = name if isinstance(kernel, MotionKernel) else f"{name}.{type(kernel).__name__}"
    arrays: dict[str, Array] = {}
    for parameter in kernel.parameters():
        value, key = getattr(kernel, parameter), f"{prefix}.{parameter}"
        arrays |= kernel_arrays(key, value) if isinstance(value, Kernel) else {key: np.asarray(value)}
    return arrays


def kernel_of(name: str, arrays: dict[str, Array]) -> Kernel:
    """Inverse of :func:`kernel_arrays`.

    Raises:
        KeyError: a parameter is missing, or the class is none that is known here.
    """
    below = {key.removeprefix(f"{name}.").split(".")[0] for key in arrays if key.startswith(f"{name}.")}
    if below <= set(MotionKernel.parameters()):
        prefix, cls = name, MotionKernel
    else:
        prefix, cls = f"{name}.{min(below)}", CLASSES[min(below)]
    values: dict[str, Any] = {}
    for parameter in cls.parameters():
        key = f"{prefix}.{parameter}"
        within = any(other.startswith(f"{key}.") for other in arrays)
        values[parameter] = kernel_of(key, arrays) if within else arrays[key]
    return cls(**values)

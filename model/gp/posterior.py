"""A trained layer as a value of arrays. Reading one, and the online tick, need no JAX."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

if TYPE_CHECKING:
    import jax

Numbers: TypeAlias = "Array | jax.Array"
"""NumPy's where a layer was read, JAX's where it was trained."""


class MotionParameters(NamedTuple):
    """The parameters of a :class:`highfive.model.gp.kernels.MotionKernel`, as a model file holds them.

    Attributes:
        log_lengthscale, log_linear: (q,).
        log_rbf, log_bias: ().
    """

    log_lengthscale: Array
    log_rbf: Array
    log_linear: Array
    log_bias: Array


def motion_parameters(kernel: Any) -> MotionParameters:
    """Those of a layer's kernel.

    Raises:
        HighFiveError: it is another kernel than ``MotionKernel``.
    """
    if isinstance(kernel, MotionParameters):
        return kernel
    if (name := type(kernel).__name__) != "MotionKernel":
        raise HighFiveError(f"the online tick computes MotionKernel only, this layer has a {name}")
    return MotionParameters(*(np.asarray(getattr(kernel, field)) for field in MotionParameters._fields))


class Posterior(NamedTuple):
    """A trained layer, ready for prediction at one input: everything that does not depend on the input is precomputed.

    Attributes:
        kernel: covariance over the inputs: a :class:`highfive.model.gp.kernels.Kernel`, or its
            :class:`MotionParameters`.
        inducing: (M, q).
        style: (M, K) inducing style weights times B, or None.
        style_covariance: (K, K) B, or None.
        weights: (M, D): the mean is k(x, inducing) · weights + offset.
        offset: (D,).
        reduction: (M, M): the variance of the function is k(x, x) − k reduction kᵀ (before ``scale``).
        noise: () or (D,) variance of the noise, before ``scale``.
        scale: (D,) standard deviation of a channel that has unit variance in the layer's own units.
    """

    kernel: Any
    inducing: Numbers
    style: Numbers | None
    style_covariance: Numbers | None
    weights: Numbers
    offset: Numbers
    reduction: Numbers
    noise: Numbers
    scale: Numbers

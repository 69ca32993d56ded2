# SciPy ships no types: what the project uses of this module.

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

class OptimizeResult:
    x: NDArray[np.float64]
    fun: float
    success: bool
    message: str

def minimize(
    fun: Callable[..., Any],
    x0: ArrayLike,
    args: tuple[Any, ...] = (),
    method: str | None = None,
    jac: Callable[..., Any] | bool | None = None,
    bounds: Any = None,
    callback: Callable[..., Any] | None = None,
    options: Mapping[str, Any] | None = None,
) -> OptimizeResult: ...

class _LeastSquaresResult(OptimizeResult):
    jac: NDArray[np.float64]

def least_squares(
    fun: Callable[..., Any], x0: ArrayLike, *, args: tuple[Any, ...] = (), loss: str = "linear"
) -> _LeastSquaresResult: ...

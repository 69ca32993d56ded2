# SciPy ships no types: what the project uses of this module.

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Floats = NDArray[np.float64]

def butter(
    N: int, Wn: ArrayLike, btype: str = "low", *, output: Literal["sos"], fs: float | None = None
) -> _Floats: ...
def sosfiltfilt(sos: _Floats, x: ArrayLike, axis: int = -1) -> _Floats: ...
def lfilter(b: ArrayLike, a: ArrayLike, x: ArrayLike, axis: int = -1) -> _Floats: ...
def find_peaks(
    x: ArrayLike, *, prominence: float | None = None
) -> tuple[NDArray[np.intp], dict[str, NDArray[np.float64]]]: ...

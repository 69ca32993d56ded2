# SciPy ships no types: what the project uses of this module.

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Floats = NDArray[np.float64]

def cho_factor(a: ArrayLike, lower: bool = False) -> tuple[_Floats, bool]: ...
def cho_solve(c_and_lower: tuple[_Floats, bool], b: ArrayLike) -> _Floats: ...

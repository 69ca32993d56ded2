# SciPy ships no types: what the project uses of this module.

from typing import Any

from numpy.typing import ArrayLike

def chdtr(v: ArrayLike, x: ArrayLike) -> Any: ...
def chdtri(v: ArrayLike, p: ArrayLike) -> Any: ...

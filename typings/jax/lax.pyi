from collections.abc import Callable
from typing import Any, TypeVar

from jax._src.lax.control_flow.loops import scan as scan

_T = TypeVar("_T")

def map(f: Callable[[Any], Any], xs: Any) -> Any: ...
def with_sharding_constraint(x: _T, shardings: Any) -> _T: ...

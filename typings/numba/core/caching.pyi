# Numba types what it means users to call; this is what the project uses of its cache.

from collections.abc import Callable
from typing import Any

class _CacheImpl:
    filename_base: str

class FunctionCache:
    _cache_path: str
    _cache_file: IndexDataCacheFile
    _impl: _CacheImpl
    _py_func: Callable[..., Any]
    def __init__(self, py_func: Callable[..., Any]) -> None: ...
    def load_overload(self, sig: Any, target_context: Any) -> Any: ...
    def save_overload(self, sig: Any, data: Any) -> None: ...

class IndexDataCacheFile:
    def __init__(self, cache_path: str, filename_base: str, source_stamp: object) -> None: ...

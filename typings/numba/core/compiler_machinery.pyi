from collections.abc import Callable
from typing import Any, TypeVar

_T = TypeVar("_T")

class AnalysisPass:
    def __init__(self) -> None: ...
    def run_pass(self, state: Any) -> bool: ...

def register_pass(mutates_CFG: bool, analysis_only: bool) -> Callable[[type[_T]], type[_T]]: ...

# JAX's compiled half ships no types; what passes through its signatures is a device.

from typing import Any

class Device: ...

def __getattr__(name: str) -> Any: ...

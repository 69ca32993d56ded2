# Numba types what it means users to call; this is what the project uses of its events.

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager

class Event: ...

class Listener(ABC):
    @abstractmethod
    def on_start(self, event: Event) -> None: ...
    @abstractmethod
    def on_end(self, event: Event) -> None: ...

def install_listener(kind: str, listener: Listener) -> AbstractContextManager[None]: ...

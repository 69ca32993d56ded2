"""Machine code for functions of numbers and arrays, kept from one process to the next."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import event as events

Compiled = TypeVar("Compiled", bound=Callable)

# Sums may run in vector lanes; NaN and infinity keep their meaning, and a division by zero gives them.
OPTIONS = {"fastmath": {"reassoc", "contract", "nsz"}, "error_model": "numpy"}


def compiled(function: Compiled) -> Compiled:
    """The function, inlined into the compiled functions that call it."""
    return cast(Compiled, njit(**OPTIONS)(function))


def compiled_entry(function: Compiled) -> Compiled:
    """The function, to be called from Python: compiled at its first call and stored where Python keeps its own.

    That is ``__pycache__`` beside the source, or the user's cache where the installation cannot be written to. What is
    stored is renewed when the function's own source file changes, and that file only: what it calls must stand there.
    """
    try:
        return cast(Compiled, njit(**OPTIONS, cache=True)(function))
    except RuntimeError:  # no place can be written to: each process compiles for itself
        return cast(Compiled, njit(**OPTIONS)(function))


class _Listener(events.Listener):
    def __init__(self, tell: Callable[[], Any]):
        self._tell, self._told = tell, False

    def on_start(self, event: events.Event) -> None:
        if not self._told:
            self._told = True
            self._tell()

    def on_end(self, event: events.Event) -> None:
        """Nothing to tell."""


@contextmanager
def when_compiling(tell: Callable[[], Any]) -> Iterator[None]:
    """Calls ``tell`` once, as soon as a function really is compiled meanwhile; what is only loaded is quick."""
    with events.install_listener("numba:compile", _Listener(tell)):
        yield

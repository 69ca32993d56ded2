"""Ctrl-C that reaches Python where no exception may pass: in a callback of the garbage collector, or in ``__del__``.

JAX has such a callback. Python prints "Exception ignored" there, and the command would run on to its end.
"""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

AGAIN_S = 0.05
"""s after which a swallowed Ctrl-C is raised again: whoever swallowed it has returned by then, or swallows it again."""


_answered: list[None] = []


@contextmanager
def answered_by_a_stop() -> Iterator[None]:
    """In here Ctrl-C has pulled an emergency stop, which ends the session in order: nothing is raised again."""
    _answered.append(None)
    try:
        yield
    finally:
        _answered.pop()


def raise_swallowed_interrupts() -> None:
    """From now on a swallowed ``KeyboardInterrupt`` is raised again in the main thread; all else goes the earlier way.

    It is the exception that is raised again, not the signal: handlers have counted that signal already.
    """
    earlier = sys.unraisablehook

    def hook(unraisable: UnraisableHookArgs, /) -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            earlier(unraisable)
            return
        if _answered:
            return
        # Not from here: what is raised before the hook returns would be swallowed, too.
        threading.Thread(target=_raise_in_main_thread, daemon=True).start()

    sys.unraisablehook = hook


def _raise_in_main_thread() -> None:
    time.sleep(AGAIN_S)
    main = ctypes.c_ulong(threading.main_thread().ident or 0)
    ctypes.pythonapi.PyThreadState_SetAsyncExc(main, ctypes.py_object(KeyboardInterrupt))

"""Ctrl-C that reaches Python where no exception may pass: in a callback of the garbage collector, or in ``__del__``.

JAX has such a callback. Python prints "Exception ignored" there, and the command would run on to its end.
"""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

AGAIN_S = 0.05
"""s after which a swallowed Ctrl-C is raised again: whoever swallowed it has returned by then, or swallows it again."""


def raise_swallowed_interrupts() -> None:
    """From now on a swallowed ``KeyboardInterrupt`` is raised again in the main thread; all else goes the earlier way.

    It is the exception that is raised again, not the signal: handlers have counted that signal already.
    """
    earlier = sys.unraisablehook

    def hook(unraisable: UnraisableHookArgs, /) -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            earlier(unraisable)
            return
        # Not from here: what is raised before the hook returns would be swallowed, too.
        threading.Thread(target=_raise_in_main_thread, daemon=True).start()

    sys.unraisablehook = hook


def _raise_in_main_thread() -> None:
    time.sleep(AGAIN_S)
    main = ctypes.c_ulong(threading.main_thread().ident or 0)
    ctypes.pythonapi.PyThreadState_SetAsyncExc(main, ctypes.py_object(KeyboardInterrupt))

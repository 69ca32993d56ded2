"""Ctrl-C where no exception may pass: in a callback of the garbage collector, in ``__del__``, in a compiled answer.

JAX has such a callback. Python prints "Exception ignored" there, and the command would run on to its end. Numba calls
Python to make a named tuple of what a compiled function answers, and crashes where that raises.
"""

from __future__ import annotations

import ctypes
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from highfive.hil.runtime.clock import MACHINE, Clock
from highfive.hil.runtime.shutdown import AGAIN_S as ANOTHER_S

if TYPE_CHECKING:
    from sys import UnraisableHookArgs
    from types import FrameType, TracebackType

AGAIN_S = 0.05
"""s after which a swallowed Ctrl-C is raised again: whoever swallowed it has returned by then, or swallows it again."""

INTERRUPTS = (signal.SIGINT, signal.SIGTERM)
"""What interrupts a command: Ctrl-C, and :func:`ended_as_interrupted`."""

_answered: list[None] = []
_swallowed: list[None] = []


class _Ticks:
    """Whether the main thread is in a tick, and when Ctrl-C came in it, ns."""

    def __init__(self) -> None:
        self.within = False
        self.asked_ns: int | None = None


_ticks = _Ticks()


@contextmanager
def interrupted_between_ticks(clock: Clock = MACHINE) -> Iterator[None]:
    """In here Ctrl-C interrupts as ever, but for a :class:`WholeTick`, which it interrupts as that ends.

    Another Ctrl-C, more than a second later, interrupts a tick that hangs. Only in the main thread, and where Ctrl-C
    does what Python makes of it; handlers that are set in here, and call this one, wait for the tick, too.
    """
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):
        yield
        return

    def handle(number: int, frame: object) -> None:
        asked_ns, _ticks.asked_ns = _ticks.asked_ns, None
        if not _ticks.within or (asked_ns is not None and clock.now() - asked_ns > ANOTHER_S * 1e9):
            raise KeyboardInterrupt
        _ticks.asked_ns = clock.now() if asked_ns is None else asked_ns

    signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


class WholeTick:
    """A tick in a ``with``: see :func:`interrupted_between_ticks`. Costs a microsecond; do not nest."""

    def __enter__(self) -> None:
        """Begins."""
        if threading.current_thread() is threading.main_thread():
            _ticks.within = True

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends.

        Raises:
            KeyboardInterrupt: Ctrl-C came meanwhile.
        """
        if not _ticks.within or threading.current_thread() is not threading.main_thread():
            return
        _ticks.within = False
        if _ticks.asked_ns is not None:
            _ticks.asked_ns = None
            raise KeyboardInterrupt


@contextmanager
def answered_by_a_stop() -> Iterator[None]:
    """In here Ctrl-C has pulled an emergency stop, which ends the session in order: nothing is raised again."""
    _answered.append(None)
    try:
        yield
    finally:
        _answered.pop()


@contextmanager
def ended_as_interrupted() -> Iterator[None]:
    """In here SIGTERM does what Ctrl-C does at that moment.

    Where Ctrl-C is switched off (a shell's ``&`` does that) SIGTERM interrupts all the same, between ticks. Where
    SIGTERM itself is switched off it stays so. Only in the main thread.
    """
    off = signal.getsignal(signal.SIGINT) == signal.SIG_IGN

    def handle(number: int, frame: FrameType | None) -> None:
        interrupts = signal.getsignal(signal.SIGINT)
        if callable(interrupts) and not off:
            interrupts(signal.SIGINT, frame)
        elif _ticks.within:
            _ticks.asked_ns = MACHINE.now()
        else:
            raise KeyboardInterrupt

    if signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def comes_of_an_interrupt(error: BaseException) -> bool:
    """A ``KeyboardInterrupt`` was swallowed, and was not raised again yet; or ``error`` was raised because of one.

    LLVM hands compiled code over in such a callback: who is interrupted there is told that there is none. Where a
    compiled function calls Python, Python makes a ``SystemError`` of it.
    """
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__
    return cause is not None or bool(_swallowed)


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
        _swallowed.append(None)
        # Not from here: what is raised before the hook returns would be swallowed, too.
        threading.Thread(target=_raise_in_main_thread, daemon=True).start()

    sys.unraisablehook = hook


def _raise_in_main_thread() -> None:
    time.sleep(AGAIN_S)
    _swallowed.clear()
    if _ticks.within:
        _ticks.asked_ns = MACHINE.now()
        return
    main = ctypes.c_ulong(threading.main_thread().ident or 0)
    ctypes.pythonapi.PyThreadState_SetAsyncExc(main, ctypes.py_object(KeyboardInterrupt))

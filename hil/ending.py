"""Commands that run until they are told to end: Ctrl-C, or a polite kill, is how one ends them, not a failure."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

AGAIN_S = 1.0
"""A Ctrl-C that comes later than this after the first one is another one, s."""


@contextmanager
def until_told() -> Iterator[threading.Event]:
    """An event that Ctrl-C or SIGTERM sets; another Ctrl-C more than a second later interrupts as ever.

    One Ctrl-C may come as two signals, to the process and to its group. It is set up even where whoever started this
    process had switched Ctrl-C off (a shell's ``&`` does).
    """
    told, when = threading.Event(), time.monotonic()

    def tell(number: int, _: object) -> None:
        nonlocal when
        if not told.is_set():
            when = time.monotonic()
        elif number == signal.SIGINT and time.monotonic() - when > AGAIN_S:
            raise KeyboardInterrupt
        told.set()

    before = {number: signal.signal(number, tell) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield told
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

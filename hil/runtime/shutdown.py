"""Commands that run until they are ended: Ctrl-C, or a polite kill, is how one ends them, not a failure."""

from __future__ import annotations

import os
import select
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from highfive.hil.runtime.clock import MACHINE, Clock

AGAIN_S = 1.0
"""A Ctrl-C that comes later than this after the first one is another one, s."""


class EndRequest:
    """Whether an end of the command was requested. May be set from a signal's handler, at any instruction.

    ``threading.Event`` may not: its lock is not re-entrant, and a signal that comes while it is held waits for itself.
    Here a flag is raised and a byte goes down a pipe. It is an :class:`~highfive.hil.runtime.clock.Event`, too.
    """

    def __init__(self) -> None:
        """Not yet."""
        self._is_set = False
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)

    def set(self) -> None:
        """Tells it."""
        self._is_set = True
        with suppress(OSError):  # full: whoever waits has enough to read; closed: nobody waits
            os.write(self._write, b"!")

    def fileno(self) -> int:
        """Readable once an end was requested."""
        return self._read

    @property
    def due_ns(self) -> int | None:
        """0 once an end was requested."""
        return 0 if self._is_set else None

    def is_set(self) -> bool:
        """Whether an end was requested."""
        return self._is_set

    def wait(self, timeout: float | None = None) -> bool:
        """Waits until an end is requested, for so many s at most; whether it was."""
        if not self._is_set:
            with suppress(OSError, ValueError):
                select.select([self._read], [], [], None if timeout is None else max(0.0, timeout))
        return self._is_set

    def close(self) -> None:
        """Lets go of the pipe."""
        for descriptor in (self._read, self._write):
            with suppress(OSError):
                os.close(descriptor)
        self._read = self._write = -1


@contextmanager
def until_ended(clock: Clock = MACHINE) -> Iterator[EndRequest]:
    """What Ctrl-C or SIGTERM sets; another Ctrl-C more than a second later interrupts as ever.

    One Ctrl-C may come as two signals, to the process and to its group. It is set up even where whoever started this
    process had switched Ctrl-C off (a shell's ``&`` does).
    """
    request, when = EndRequest(), clock.now()

    def tell(number: int, _: object) -> None:
        nonlocal when
        if not request.is_set():
            when = clock.now()
        elif number == signal.SIGINT and clock.now() - when > AGAIN_S * 1e9:
            raise KeyboardInterrupt
        request.set()

    before = {number: signal.signal(number, tell) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        request.close()

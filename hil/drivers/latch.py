"""The latch that every emergency stop ends in.

It lies in memory that processes share, and says when it was pulled. A loop asks ``pulled_ns`` every cycle; who sleeps
has its clock wait for it (:meth:`highfive.hil.runtime.clock.Clock.wait_for`). It stays pulled until a person lets it
go.
"""

from __future__ import annotations

import os
import select
from enum import IntEnum
from multiprocessing import Pipe
from multiprocessing.sharedctypes import RawArray

from highfive.hil.runtime.clock import MACHINE, Clock


class Cause(IntEnum):
    """What pulled."""

    NOTHING = 0
    KEY = 1
    PIPE = 2
    SIGNAL = 3
    PROGRAM = 4
    PAGE = 5


_HOW = {
    Cause.KEY: " by a key",
    Cause.PIPE: " through its pipe",
    Cause.SIGNAL: " by a signal, such as Ctrl-C or SIGTERM",
    Cause.PAGE: " on the page",
}


class Latch:
    """One emergency stop, for every thread and every process that it is passed to (as an argument of ``Process``).

    Pulling takes no lock, so that a signal handler may pull while the interrupted code looks.
    """

    def __init__(self, clock: Clock = MACHINE) -> None:
        """Not pulled; ``clock`` says when it is."""
        self._clock = clock
        self._words = RawArray("q", 2)  # when (monotonic, ns; 0: not pulled), why
        self._told, self._tell = Pipe(duplex=False)

    def pull(self, cause: Cause = Cause.PROGRAM) -> None:
        """Pulls it; the first pull counts."""
        if self._words[0]:
            return
        self._words[1] = cause
        self._words[0] = self._clock.now()
        os.write(self._tell.fileno(), b"!")  # one byte a pull: never more than a pipe takes

    @property
    def pulled_ns(self) -> int | None:
        """When it was pulled, ns of the monotonic clock (one for all processes); None while it is not."""
        return self._words[0] or None

    due_ns = pulled_ns

    @property
    def cause(self) -> Cause:
        """What pulled it."""
        return Cause(self._words[1]) if self._words[0] else Cause.NOTHING

    @property
    def said(self) -> str:
        """That it was pulled, and by what; empty while it is not."""
        return f"the emergency stop was pulled{_HOW.get(self.cause, '')}" if self._words[0] else ""

    def fileno(self) -> int:
        """Readable while it is pulled. Read nothing from it."""
        return self._told.fileno()

    def let_go(self) -> None:
        """A person says that it may go on. Only one process does this, and no listener of its own accord."""
        self._words[0] = 0
        while select.select([self], [], [], 0.0)[0]:
            os.read(self.fileno(), 1)
        if self._words[0]:  # pulled again meanwhile, and that byte may be gone
            os.write(self._tell.fileno(), b"!")

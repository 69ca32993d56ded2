"""The emergency stop: what pulls it (a key, a pipe, a signal, any code) and the latch that they all end in.

The latch lies in memory that processes share, and says when it was pulled. A loop asks ``pulled_ns`` every cycle; who
sleeps waits for ``fileno()`` to become readable. It stays pulled until a person lets it go.
"""

from __future__ import annotations

import os
import select
import signal
import stat
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from enum import IntEnum
from multiprocessing import Pipe
from multiprocessing.sharedctypes import RawArray
from pathlib import Path

from model.errors import HighFiveError

KEYS = b" \x1b"
"""Keys that pull: space and Esc (and so every key that begins with Esc, such as an arrow)."""

SIGNALS = (signal.SIGUSR1, signal.SIGTERM, signal.SIGINT)
"""Signals that pull."""


class Cause(IntEnum):
    """What pulled."""

    NOTHING = 0
    KEY = 1
    PIPE = 2
    SIGNAL = 3
    VIEWER = 4
    PROGRAM = 5


class Latch:
    """One emergency stop, for every thread and every process that it is passed to (as an argument of ``Process``).

    Pulling takes no lock, so that a signal handler may pull while the interrupted code looks.
    """

    def __init__(self) -> None:
        """Not pulled."""
        self._words = RawArray("q", 2)  # when (monotonic, ns; 0: not pulled), why
        self._told, self._tell = Pipe(duplex=False)

    def pull(self, cause: Cause = Cause.PROGRAM) -> None:
        """Pulls it; the first pull counts."""
        if self._words[0]:
            return
        self._words[1] = cause
        self._words[0] = time.monotonic_ns()
        os.write(self._tell.fileno(), b"!")  # one byte a pull: never more than a pipe takes

    @property
    def pulled_ns(self) -> int | None:
        """When it was pulled, ns of the monotonic clock (one for all processes); None while it is not."""
        return self._words[0] or None

    @property
    def cause(self) -> Cause:
        """What pulled it."""
        return Cause(self._words[1]) if self._words[0] else Cause.NOTHING

    def fileno(self) -> int:
        """Readable while it is pulled: for ``select`` and ``multiprocessing.connection.wait``. Read nothing from it."""
        return self._told.fileno()

    def wait(self, seconds: float | None = None) -> bool:
        """Waits until it is pulled, at most so long (None: for ever). Is it?"""
        select.select([self], [], [], seconds)
        return self.pulled_ns is not None

    def let_go(self) -> None:
        """A person says that it may go on. Only one process does this, and no listener of its own accord."""
        self._words[0] = 0
        while select.select([self], [], [], 0.0)[0]:
            os.read(self.fileno(), 1)
        if self._words[0]:  # pulled again meanwhile, and that byte may be gone
            os.write(self._tell.fileno(), b"!")


@contextmanager
def listening(
    latch: Latch,
    keys: int | None = None,
    descriptors: tuple[int, ...] = (),
    pipe: Path | None = None,
    signals: tuple[signal.Signals, ...] = SIGNALS,
    other_keys: Callable[[bytes], None] | None = None,
) -> Iterator[None]:
    """Pulls the latch while in here whenever one of these says so.

    Args:
        latch: what is pulled.
        keys: a terminal's descriptor (0 for this one's): space or Esc pulls, and so does its end. It is put into cbreak
            mode, so that a key comes without Enter.
        descriptors: anything that comes through one of these pulls, and so does its end: the other side holds it open
            like a dead man's handle.
        pipe: a named pipe, made if there is none: anything written into it pulls.
        signals: these pull, and then call what handled them before, if it was a function; only in the main thread.
        other_keys: called, in a thread of its own, with keys that do not pull.

    Raises:
        HighFiveError: ``keys`` is no terminal, or ``pipe`` is there and is no pipe.
    """
    with ExitStack() as stack:
        ears: dict[int, Callable[[bytes], None]] = {}
        if keys is not None:
            stack.enter_context(_cbreak(keys))
            ears[keys] = lambda data: _key(latch, data, other_keys)
        for descriptor in descriptors:
            ears[descriptor] = lambda _: latch.pull(Cause.PIPE)
        if pipe is not None:
            ears[stack.enter_context(_named_pipe(pipe))] = lambda _: latch.pull(Cause.PIPE)
        stack.enter_context(_handled(latch, signals))
        stack.enter_context(_heard(latch, ears))
        yield


def _key(latch: Latch, data: bytes, others: Callable[[bytes], None] | None) -> None:
    if not data or any(key in KEYS for key in data):  # no data: the terminal is gone, and with it the key
        latch.pull(Cause.KEY)
    elif others is not None:
        others(data)


@contextmanager
def _heard(latch: Latch, ears: dict[int, Callable[[bytes], None]]) -> Iterator[None]:
    """A thread that calls for each descriptor with what comes through it; with nothing at its end."""
    if not ears:
        yield
        return
    wake, leave = os.pipe()

    def hear() -> None:
        try:
            _hear(wake, ears)
        except BaseException:  # who no longer listens must not be trusted to be heard
            latch.pull()
            raise

    thread = threading.Thread(target=hear, name="emergency stop", daemon=True)
    thread.start()
    try:
        yield
    finally:
        os.close(leave)
        thread.join()
        os.close(wake)


def _hear(wake: int, ears: dict[int, Callable[[bytes], None]]) -> None:
    open_ones = {wake, *ears}
    while True:
        ready = select.select(open_ones, [], [])[0]
        if wake in ready:
            return
        for descriptor in ready:
            try:
                data = os.read(descriptor, 4096)
            except BlockingIOError:
                continue
            except OSError:  # a terminal that was hung up
                data = b""
            if not data:
                open_ones.discard(descriptor)
            ears[descriptor](data)


@contextmanager
def _cbreak(terminal: int) -> Iterator[None]:
    """The terminal gives every key at once; as it was, afterwards."""
    if not os.isatty(terminal):
        raise HighFiveError("the emergency stop's key needs a terminal; start from one, or give a named pipe instead")
    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal, termios.TCSANOW)
    try:
        yield
    finally:
        with _gone_terminal():
            termios.tcsetattr(terminal, termios.TCSANOW, before)


@contextmanager
def _gone_terminal() -> Iterator[None]:
    """A terminal that was hung up cannot be put back."""
    try:
        yield
    except termios.error:
        return


@contextmanager
def _named_pipe(path: Path) -> Iterator[int]:
    """A named pipe that is read from; taken away afterwards if it was made here."""
    made = not path.exists()
    try:
        if made:
            os.mkfifo(path, 0o600)
        elif not stat.S_ISFIFO(path.stat().st_mode):
            raise HighFiveError(f"{path} is no named pipe; give a path where none is, or one made by mkfifo")
        descriptor = os.open(path, os.O_RDWR | os.O_NONBLOCK)  # for writing, too: then it does not end with a writer
    except OSError as error:
        raise HighFiveError(f"cannot open the named pipe {path}: {error.strerror}") from None
    try:
        yield descriptor
    finally:
        os.close(descriptor)
        if made:
            path.unlink(missing_ok=True)


@contextmanager
def _handled(latch: Latch, signals: tuple[signal.Signals, ...]) -> Iterator[None]:
    """Signals pull, and then call what handled them before."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in signals}

    def pull(number: int, frame: object) -> None:
        latch.pull(Cause.SIGNAL)
        earlier = before[signal.Signals(number)]
        if callable(earlier):
            earlier(number, frame)  # pyright: ignore[reportArgumentType]

    for number in signals:
        signal.signal(number, pull)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

"""What pulls the emergency stop: a key, a pipe, a signal (and any code, through the latch itself)."""

from __future__ import annotations

import os
import select
import signal
import stat
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from highfive.hil.drivers.latch import Cause, Latch
from highfive.model.errors import HighFiveError

KEYS = b" \x1b"
"""Keys that pull: space and Esc (and so every key that begins with Esc, such as an arrow)."""

SIGNALS = (signal.SIGUSR1, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGTSTP)
"""Signals that pull; SIGHUP says that the terminal is gone, SIGTSTP is Ctrl-Z: a suspended host watches over nobody."""

_ENDS = (signal.SIGUSR1, signal.SIGHUP, signal.SIGTSTP)  # what would end, or suspend, who still writes a report
_NOT_SUSPENDED = b"\nCtrl-Z stops the arm; the program goes on to its end\n"


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


@contextmanager
def uninterrupted(
    signals: tuple[signal.Signals, ...] = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP),
    once: bool = False,
) -> Iterator[Callable[[], None]]:
    """Yields what is called once these signals shall only stop the arm, and interrupt nothing: until this is left.

    What was played is then still there to be written, however often somebody presses Ctrl-C. Before that call they do
    what they did, or, where that is to kill, end the program in order (``SystemExit``). Only in the main thread.

    Args:
        signals: which.
        once: the first one that interrupts is that call, too.
    """
    begun = False
    before = {number: signal.getsignal(number) for number in signals}

    def begin() -> None:
        nonlocal begun
        begun = True

    def handle(number: int, frame: object) -> None:
        nonlocal begun
        if begun:
            return
        begun, earlier = once, before[signal.Signals(number)]
        if not callable(earlier):
            raise SystemExit(128 + number)  # as a shell says it; the terminal, the pipe and the arm are let go of
        earlier(number, frame)  # pyright: ignore[reportArgumentType]

    for number in signals:
        if before[number] != signal.SIG_IGN:
            signal.signal(number, handle)
    try:
        yield begin
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


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


def check_pipe(path: Path) -> None:
    """Looks whether a named pipe is there, or can be made.

    Raises:
        HighFiveError: neither.
    """
    if path.exists():
        if not stat.S_ISFIFO(path.stat().st_mode):
            raise HighFiveError(f"{path} is no named pipe; give a path where none is, or one made by mkfifo")
    elif not path.parent.is_dir():
        raise HighFiveError(f"cannot open the named pipe {path}: there is no folder {path.parent}")


@contextmanager
def _named_pipe(path: Path) -> Iterator[int]:
    """A named pipe that is read from; taken away afterwards if it was made here."""
    check_pipe(path)
    made = not path.exists()
    try:
        if made:
            os.mkfifo(path, 0o600)
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
    """Signals pull, and then call what handled them before.

    Where nothing did, SIGUSR1, SIGHUP and SIGTSTP do nothing any more afterwards: who stops an arm that stands already
    must not end the program that writes its report. A program that is to outlive its terminal (``nohup``) does.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in signals}

    def pull(number: int, frame: object) -> None:
        latch.pull(Cause.SIGNAL)
        if number == signal.SIGTSTP:
            with suppress(OSError):
                os.write(2, _NOT_SUSPENDED)
        earlier = before[signal.Signals(number)]
        if callable(earlier):
            earlier(number, frame)  # pyright: ignore[reportArgumentType]

    for number in signals:
        if number != signal.SIGHUP or before[number] != signal.SIG_IGN:
            signal.signal(number, pull)
    try:
        yield
    finally:
        for number, handler in before.items():
            unhandled = signal.SIG_IGN if number in _ENDS else signal.SIG_DFL
            signal.signal(number, unhandled if handler in (None, signal.SIG_DFL) else handler)

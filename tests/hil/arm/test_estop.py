"""The emergency stop, pulled by real keys on a pseudo-terminal, real pipes, real signals, and across processes."""

import multiprocessing
import os
import pty
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from highfive.hil.arm.emergency_stop import SIGNALS, listening, uninterrupted
from highfive.hil.drivers.latch import Cause, Latch
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.model.errors import HighFiveError

SOON = 60.0  # s; far more than it takes, but for a machine that is busy


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """The person's end of a pseudo-terminal, and the program's."""
    person, program = pty.openpty()
    yield person, program
    for end in (person, program):
        with suppress(OSError):
            os.close(end)


def waits(true: Callable[[], bool]) -> bool:
    end = time.monotonic() + SOON
    while not true() and time.monotonic() < end:
        time.sleep(0.002)
    return true()


def pulled(latch: Latch, seconds: float) -> bool:
    return MACHINE.wait_for(latch, MACHINE.now() + round(1e9 * seconds))


def test_a_latch_keeps_the_first_pull() -> None:
    latch = Latch()
    assert latch.pulled_ns is None
    assert latch.cause is Cause.NOTHING and not latch.said
    assert not pulled(latch, 0.0)
    before = time.monotonic_ns()
    latch.pull(Cause.PIPE)
    first = latch.pulled_ns
    assert first is not None
    assert before <= first <= time.monotonic_ns()
    latch.pull(Cause.KEY)
    assert (latch.pulled_ns, latch.cause) == (first, Cause.PIPE)
    assert latch.said == "the emergency stop was pulled through its pipe"
    assert pulled(latch, 0.0)
    assert pulled(latch, 0.0)  # waiting takes nothing away


def test_it_is_let_go_only_by_who_says_so_and_can_be_pulled_again() -> None:
    latch = Latch()
    for _ in range(3):
        latch.pull()
        latch.pull()
        latch.let_go()
        assert latch.pulled_ns is None
        assert latch.cause is Cause.NOTHING
        assert not pulled(latch, 0.0)


def test_many_threads_may_pull_at_once() -> None:
    latch = Latch()
    threads = [threading.Thread(target=latch.pull) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert pulled(latch, 0.0)
    latch.let_go()
    assert not pulled(latch, 0.0)


def pull_there(latch: Latch) -> None:
    latch.pull(Cause.KEY)


def wait_there(latch: Latch, answer: Connection) -> None:
    answer.send("waiting")
    pulled(latch, SOON)
    answer.send((latch.pulled_ns, latch.cause))


def test_it_is_one_latch_in_all_processes() -> None:
    """Pulled here it wakes a process that waits, and the other way round; they agree on when."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    latch = Latch()
    child = context.Process(target=wait_there, args=(latch, there))
    child.start()
    assert here.poll(30.0) and here.recv() == "waiting"
    latch.pull(Cause.PROGRAM)
    assert here.poll(SOON)
    assert here.recv() == (latch.pulled_ns, Cause.PROGRAM)
    child.join(SOON)

    latch.let_go()
    child = context.Process(target=pull_there, args=(latch,))
    child.start()
    assert pulled(latch, 30.0)
    assert latch.cause is Cause.KEY
    child.join(SOON)


@pytest.mark.parametrize("key", [b" ", b"\x1b", b"\x1b[A", b"ab c"])
def test_a_key_pulls_without_enter(terminal: tuple[int, int], key: bytes) -> None:
    person, program = terminal
    latch = Latch()
    with listening(latch, keys=program, signals=()):
        os.write(person, key)
        assert pulled(latch, SOON)
        assert latch.cause is Cause.KEY


def test_other_keys_do_not_pull_and_are_passed_on(terminal: tuple[int, int]) -> None:
    person, program = terminal
    latch, heard = Latch(), []
    with listening(latch, keys=program, signals=(), other_keys=heard.append):
        os.write(person, b"a")
        assert waits(lambda: heard == [b"a"])
        assert latch.pulled_ns is None


def test_the_terminal_is_afterwards_as_it_was(terminal: tuple[int, int]) -> None:
    _, program = terminal
    before = termios.tcgetattr(program)
    with listening(Latch(), keys=program, signals=()):
        assert not termios.tcgetattr(program)[3] & termios.ICANON
        assert termios.tcgetattr(program)[3] & termios.ISIG  # Ctrl-C is still a signal
    assert termios.tcgetattr(program) == before


def test_a_terminal_that_goes_away_pulls(terminal: tuple[int, int]) -> None:
    person, program = terminal
    latch = Latch()
    with listening(latch, keys=program, signals=()):
        os.close(person)
        assert pulled(latch, SOON)
        assert latch.cause is Cause.KEY


def test_what_listens_no_more_pulls(terminal: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """A listener that fails takes the arm with it."""
    person, program = terminal
    latch = Latch()
    monkeypatch.setattr(threading, "excepthook", lambda _: None)

    def fails(_: bytes) -> None:
        raise ValueError("other keys")

    with listening(latch, keys=program, signals=(), other_keys=fails):
        os.write(person, b"a")
        assert pulled(latch, SOON)
        assert latch.cause is Cause.PROGRAM


@pytest.mark.parametrize("end", ["written", "closed"])
def test_a_descriptor_pulls_when_something_comes_and_when_it_ends(end: str) -> None:
    read, write = os.pipe()
    latch = Latch()
    with listening(latch, descriptors=(read,), signals=()):
        assert not pulled(latch, 0.02)
        if end == "written":
            os.write(write, b"x")
        else:
            os.close(write)
        assert pulled(latch, SOON)
        assert latch.cause is Cause.PIPE
    os.close(read)
    if end == "written":
        os.close(write)


def test_a_named_pipe_pulls_and_outlives_its_writers(tmp_path: Path) -> None:
    path, latch = tmp_path / "estop", Latch()
    with listening(latch, pipe=path, signals=()):
        assert path.is_fifo()
        assert path.stat().st_mode & 0o777 == 0o600
        with path.open("wb"):  # opened and closed: nobody pulled
            pass
        assert not pulled(latch, 0.05)
        subprocess.run(["/bin/sh", "-c", f"echo stop > '{path}'"], check=True)
        assert pulled(latch, SOON)
        assert latch.cause is Cause.PIPE
    assert not path.exists()


def test_a_pipe_that_was_there_stays(tmp_path: Path) -> None:
    path = tmp_path / "estop"
    os.mkfifo(path)
    with listening(Latch(), pipe=path, signals=()):
        pass
    assert path.is_fifo()


def test_what_is_no_pipe_and_no_terminal_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "estop"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(HighFiveError, match="is no named pipe"), listening(Latch(), pipe=path, signals=()):
        pass
    assert path.read_text(encoding="utf-8") == "mine"
    with pytest.raises(HighFiveError, match="cannot open"), listening(Latch(), pipe=tmp_path / "no" / "e", signals=()):
        pass
    read, write = os.pipe()
    with pytest.raises(HighFiveError, match="needs a terminal"), listening(Latch(), keys=read, signals=()):
        pass
    os.close(read)
    os.close(write)


CHILD = """
import signal, sys, time
from highfive.hil.drivers.latch import Latch
from highfive.hil.arm.emergency_stop import listening
def earlier(number, frame):
    print("earlier", number, flush=True)
signal.signal(signal.SIGTERM, earlier)
signal.signal(signal.SIGINT, earlier)
latch, before = Latch(), time.monotonic_ns()
with listening(latch):
    print("listening", flush=True)
    while latch.pulled_ns is None:  # a loop that looks, and is interrupted anywhere
        pass
    print("pulled", latch.cause.name, before <= latch.pulled_ns <= time.monotonic_ns(), flush=True)
print("again", signal.getsignal(signal.SIGTERM) is earlier, flush=True)
"""


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_pulls_and_is_then_what_it_was(number: signal.Signals) -> None:
    with subprocess.Popen([sys.executable, "-c", CHILD], stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "listening\n"
        child.send_signal(number)
        said = child.communicate(timeout=SOON)[0].splitlines()
    expected = [f"earlier {int(number)}"] if number in (signal.SIGTERM, signal.SIGINT) else []
    assert said == [*expected, "pulled SIGNAL True", "again True"]
    assert child.returncode == 0


def test_a_loop_that_looks_every_cycle_sees_it_within_one() -> None:
    """120 Hz, at every phase of a cycle: nothing stands between the latch and the loop."""
    period = 8_333_333
    for phase in range(0, period, period // 12):
        with VirtualClock() as clock:
            latch, seen = Latch(clock), []

            def loop(clock: VirtualClock = clock, latch: Latch = latch, seen: list[int] = seen) -> None:
                due = clock.now()
                while latch.pulled_ns is None:
                    due += period
                    clock.wait_until(due)
                seen.append(clock.now() - latch.pulled_ns)

            clock.start("loop", loop)
            clock.wait_until(clock.now() + 5 * period + phase)
            latch.pull()
            clock.wait_until(clock.now() + 3 * period)
            assert seen and 0 <= seen[0] <= period + 10_000  # a look takes a µs


def test_threads_see_a_pull_however_late() -> None:
    latch, seen = Latch(), threading.Event()

    def loop() -> None:
        while latch.pulled_ns is None:
            time.sleep(1 / 120)
        seen.set()

    thread = threading.Thread(target=loop)
    thread.start()
    latch.pull()
    assert seen.wait(SOON)
    thread.join()


def test_what_would_stop_an_arm_that_stands_costs_no_report() -> None:
    """In order: an arm that is driven, its way to rest, and the report; then everything is as it was."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    latch = Latch()
    with uninterrupted() as begin:
        with listening(latch):
            begin()
            for number in SIGNALS:
                signal.raise_signal(number)
                assert latch.cause is Cause.SIGNAL
                latch.let_go()
        for number in SIGNALS:
            signal.raise_signal(number)
        assert latch.pulled_ns is None
    assert {number: signal.getsignal(number) for number in before} == before


def test_before_that_an_interrupt_interrupts() -> None:
    with pytest.raises(KeyboardInterrupt), uninterrupted():
        signal.raise_signal(signal.SIGINT)
    for number in (signal.SIGTERM, signal.SIGHUP):
        with pytest.raises(SystemExit) as end, uninterrupted():
            signal.raise_signal(number)
        assert end.value.code == 128 + number


def test_a_second_interrupt_does_not_interrupt_what_the_first_one_ends() -> None:
    with uninterrupted((signal.SIGINT,), once=True):
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)

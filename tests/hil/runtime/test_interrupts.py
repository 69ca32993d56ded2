"""A Ctrl-C that comes in a callback of the garbage collector is not lost; one in a tick waits for its end."""

import gc
import signal
import subprocess
import sys
import threading
from contextlib import ExitStack

import pytest

from highfive.hil.arm.emergency_stop import listening, uninterrupted
from highfive.hil.drivers.latch import Latch
from highfive.hil.runtime.interrupts import WholeTick, interrupted_between_ticks, raise_swallowed_interrupts
from highfive.hil.runtime.virtual_clock import VirtualClock

SWALLOWED = """
import gc, sys
from highfive.hil.cli import main as cli
def work():
    def callback(phase, info):
        gc.callbacks.remove(callback)
        raise KeyboardInterrupt
    gc.callbacks.append(callback)
    gc.collect()
    while True:
        pass
cli.app = lambda **_: work()
cli.main()
"""


def ran(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)


def test_ctrl_c_in_a_callback_of_the_collector_ends_a_command() -> None:
    done = ran(SWALLOWED)
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "interrupted\n")


COMES_OF_IT = """
import ctypes, os, signal
from highfive.hil.cli import main as cli
def work():
    called = []
    @ctypes.CFUNCTYPE(None)
    def hand_over():  # as LLVM hands compiled code over
        os.kill(os.getpid(), signal.SIGTERM)
        called.append(1)
    hand_over()
    if not called:
        raise RuntimeError("no compiled object yet")
cli.app = lambda **_: work()
cli.main()
"""


def test_what_comes_of_an_interrupt_that_a_library_swallowed_is_told_as_the_interrupt() -> None:
    done = ran(COMES_OF_IT)
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "interrupted\n")


def test_what_python_makes_of_an_interrupt_that_compiled_code_met_is_told_as_the_interrupt() -> None:
    """As where a compiled function unpickles a type, and Ctrl-C comes."""
    work = "\n    ".join(
        (
            "def work():",
            "try:",
            "    raise KeyboardInterrupt",
            "except KeyboardInterrupt as error:",
            "    raise SystemError('returned a result with an exception set') from error",
        )
    )
    done = ran(f"from highfive.hil.cli import main as cli\n{work}\ncli.app = lambda **_: work()\ncli.main()")
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "interrupted\n")


TERMINATED = """
import os, signal, sys
signal.signal(signal.SIGINT, {before})
from highfive.hil.cli import main as cli
from highfive.hil.arm.emergency_stop import listening
from highfive.hil.drivers.latch import Latch
from highfive.hil.runtime.interrupts import WholeTick, interrupted_between_ticks
def work():
    with interrupted_between_ticks(), {around}, WholeTick():
        os.kill(os.getpid(), signal.SIGTERM)
        print("after", flush=True)
    print("never", flush=True)
cli.app = lambda **_: work()
cli.main()
"""


@pytest.mark.parametrize("before", ["signal.default_int_handler", "signal.SIG_IGN"])
@pytest.mark.parametrize("around", ["listening(Latch())", "interrupted_between_ticks()"])
def test_sigterm_does_what_ctrl_c_does_also_where_that_is_switched_off(before: str, around: str) -> None:
    command = [sys.executable, "-c", TERMINATED.format(before=before, around=around)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (1, "after\n", "interrupted\n")


def test_other_exceptions_there_are_told_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    reported, threads = [], threading.active_count()
    monkeypatch.setattr(sys, "unraisablehook", lambda unraisable: reported.append(unraisable.exc_type))
    raise_swallowed_interrupts()

    def callback(phase: str, info: object) -> None:
        gc.callbacks.remove(callback)
        raise ValueError

    gc.callbacks.append(callback)
    gc.collect()
    assert reported == [ValueError] and threading.active_count() == threads


@pytest.mark.parametrize("arm", [False, True])
def test_ctrl_c_waits_for_the_end_of_a_tick_and_stops_an_arm_at_once(arm: bool) -> None:
    before, done = signal.getsignal(signal.SIGINT), []
    latch = Latch()
    with interrupted_between_ticks(), ExitStack() as stack:
        if arm:
            stack.enter_context(uninterrupted((signal.SIGINT,), once=True))
            stack.enter_context(listening(latch, signals=(signal.SIGINT,)))
        with pytest.raises(KeyboardInterrupt), WholeTick():
            signal.raise_signal(signal.SIGINT)
            assert (latch.pulled_ns is not None) == arm
            done.append("whole")
        with WholeTick():  # it was answered once
            done.append("next")
        if not arm:
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
    assert done == ["whole", "next"] and signal.getsignal(signal.SIGINT) is before


def test_another_ctrl_c_interrupts_a_tick_that_hangs() -> None:
    clock = VirtualClock()
    with interrupted_between_ticks(clock):
        with pytest.raises(KeyboardInterrupt), WholeTick():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)  # to the process and to its group: one Ctrl-C
            clock.wait_until(clock.now() + 1_100_000_000)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            raise KeyboardInterrupt
        with WholeTick():
            pass


def test_a_tick_in_another_thread_holds_nothing() -> None:
    entered, leave = threading.Event(), threading.Event()

    def tick() -> None:
        with interrupted_between_ticks(), WholeTick():
            entered.set()
            leave.wait()

    thread = threading.Thread(target=tick)
    thread.start()
    entered.wait()
    with interrupted_between_ticks(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    leave.set()
    thread.join()

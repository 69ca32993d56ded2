"""A Ctrl-C that comes in a callback of the garbage collector is not lost."""

import gc
import subprocess
import sys
import threading

import pytest

from highfive.hil.runtime.interrupts import raise_swallowed_interrupts

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


def test_ctrl_c_in_a_callback_of_the_collector_ends_a_command() -> None:
    done = subprocess.run([sys.executable, "-c", SWALLOWED], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "interrupted\n")


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

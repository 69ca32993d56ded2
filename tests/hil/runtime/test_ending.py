"""Being told to end, from signals that come at any instruction."""

import signal
import subprocess
import sys
import threading
import time

from highfive.hil.runtime.shutdown import Told, until_told

# Signals come while the flag is being waited for, and while another signal's handler runs.
STORM = """
import os, signal, sys, threading, time
from highfive.hil.runtime.shutdown import until_told
for _ in range(1500):
    with until_told() as told:
        storm = threading.Thread(target=lambda: [os.kill(os.getpid(), signal.SIGTERM) for _ in range(3)])
        storm.start()
        while not told.wait(0.0003):
            pass
        storm.join()
print("ended")
"""


def test_signals_that_come_one_in_the_other_never_hang():
    done = subprocess.run([sys.executable, "-c", STORM], capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout == "ended\n", done.stderr


def test_it_waits_like_an_event():
    told = Told()
    begun = time.monotonic()
    assert not told.wait(0.05)
    assert time.monotonic() - begun >= 0.04
    threading.Timer(0.05, told.set).start()
    assert told.wait(10.0) and told.is_set() and told.wait()
    for _ in range(100_000):  # more than a pipe holds
        told.set()
    told.close()
    told.close()
    told.set()


def test_what_was_there_is_put_back():
    before = signal.getsignal(signal.SIGINT)
    with until_told() as told:
        signal.raise_signal(signal.SIGINT)
        assert told.is_set()
    assert signal.getsignal(signal.SIGINT) is before

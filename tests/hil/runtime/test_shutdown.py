"""Being ended, from signals that come at any instruction."""

import signal
import subprocess
import sys
import threading
import time

from highfive.hil.runtime.shutdown import EndRequest, until_ended

# Signals come while the flag is being waited for, and while another signal's handler runs.
STORM = """
import os, signal, sys, threading, time
from highfive.hil.runtime.shutdown import until_ended
for _ in range(1500):
    with until_ended() as end:
        storm = threading.Thread(target=lambda: [os.kill(os.getpid(), signal.SIGTERM) for _ in range(3)])
        storm.start()
        while not end.wait(0.0003):
            pass
        storm.join()
print("ended")
"""


def test_signals_that_come_one_in_the_other_never_hang():
    done = subprocess.run([sys.executable, "-c", STORM], capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout == "ended\n", done.stderr


def test_it_waits_like_an_event():
    end = EndRequest()
    begun = time.monotonic()
    assert not end.wait(0.05)
    assert time.monotonic() - begun >= 0.04
    threading.Timer(0.05, end.set).start()
    assert end.wait(10.0) and end.is_set() and end.wait()
    for _ in range(100_000):  # more than a pipe holds
        end.set()
    end.close()
    end.close()
    end.set()


def test_what_was_there_is_put_back():
    before = signal.getsignal(signal.SIGINT)
    with until_ended() as end:
        signal.raise_signal(signal.SIGINT)
        assert end.is_set()
    assert signal.getsignal(signal.SIGINT) is before

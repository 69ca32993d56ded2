"""The watch sees a standstill."""

import os
import signal
import time

from stall_watch import STILL_S, StallWatch


def test_a_standstill_is_seen() -> None:
    with StallWatch() as watch:
        time.sleep(0.5)
        os.kill(watch.process.pid, signal.SIGSTOP)
        time.sleep(3.0 * STILL_S)
        os.kill(watch.process.pid, signal.SIGCONT)
        assert watch.longest() > 2.0 * STILL_S

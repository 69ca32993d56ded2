"""Processes that share work, and what becomes of them."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from highfive.hil.runtime.threads import parallel_map


def wait(name: str) -> None:
    Path(name).touch()
    time.sleep(600.0)


def begin(folder: str) -> None:
    list(parallel_map(wait, [f"{folder}/{number}" for number in range(4)], lambda total: lambda: None))


def test_workers_end_with_a_parent_that_was_killed(tmp_path: Path) -> None:
    program = (
        f"import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})\n"
        f"import test_threads\ntest_threads.begin({str(tmp_path)!r})"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as parent:
        try:
            while parent.poll() is None and not any(tmp_path.iterdir()):
                time.sleep(0.02)
            assert parent.poll() is None
        finally:
            parent.send_signal(signal.SIGKILL)
        assert parent.communicate(timeout=60)[0] == b""  # read until the workers, too, have closed it

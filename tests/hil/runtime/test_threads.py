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


def test_a_script_needs_no_guard_of_its_own(tmp_path: Path) -> None:
    """A user's five lines stand at the top level of a file, which a worker does not run again."""
    script = tmp_path / "script.py"
    script.write_text(
        "from highfive.hil.runtime.threads import parallel_map\n"
        "print(sum(parallel_map(abs, [-1, -2, -3, -4, -5], lambda total: lambda: None)))\n"
    )
    ran = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=False)
    assert (ran.stdout, ran.stderr) == ("15\n", "")

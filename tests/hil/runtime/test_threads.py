"""Processes that share work, and what becomes of them."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

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


def fail_or_wait(name: str) -> None:
    """Fails once another job has begun, which has no end."""
    folder = Path(name).parent
    if not name.endswith("0"):
        with tempfile.NamedTemporaryFile(delete=False) as file:
            Path(f"{name}.temporary").write_text(file.name)
        Path(f"{name}.temporary").rename(name)
        time.sleep(600.0)
    while not any(folder.glob("[1-9]")):
        time.sleep(0.01)
    raise ValueError("of the first job")


def test_a_job_that_fails_ends_those_that_have_begun(tmp_path: Path) -> None:
    """They would take ten minutes, longer than a test may."""
    jobs = [f"{tmp_path}/{number}" for number in range(4)]
    with pytest.raises(ValueError, match="of the first job"):
        list(parallel_map(fail_or_wait, jobs, lambda total: lambda: None))
    written = [Path(path.read_text()) for path in tmp_path.glob("[1-9]")]
    assert written and not any(path.exists() for path in written)


@pytest.mark.slow
def test_a_script_needs_no_guard_of_its_own(tmp_path: Path) -> None:
    """A user's five lines stand at the top level of a file, which a worker does not run again."""
    script = tmp_path / "script.py"
    script.write_text(
        "from highfive.hil.runtime.threads import parallel_map\n"
        "print(sum(parallel_map(abs, [-1, -2, -3, -4, -5], lambda total: lambda: None)))\n"
    )
    ran = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=False)
    assert (ran.stdout, ran.stderr) == ("15\n", "")

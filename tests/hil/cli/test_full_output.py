"""Standard output that takes no more: a full disk is told in a line, whoever reads no further in none."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="only Linux has a device that is always full")
NO_ROOM = "error: No space left on device: make room, or send standard output elsewhere; what is written already stays"


def highfive(stdout: int, *words: str, unbuffered: bool = False) -> tuple[int, list[str]]:
    """Exit code, and lines on standard error."""
    command = [sys.executable, "-m", "highfive.hil.cli.main", *words]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1" if unbuffered else ""}
    done = subprocess.run(
        command, stdout=stdout, stderr=subprocess.PIPE, env=environment, text=True, timeout=180, check=False
    )
    return done.returncode, done.stderr.splitlines()


@needs_full
@pytest.mark.parametrize("words", [("--version",), ("--help",), ("rig", "joints"), ("rig", "joints", "--json")])
@pytest.mark.parametrize("unbuffered", [True, False])
def test_a_full_disk_is_one_line(words: tuple[str, ...], unbuffered: bool) -> None:
    with FULL.open("w") as full:
        assert highfive(full.fileno(), *words, unbuffered=unbuffered) == (2, [NO_ROOM])


@pytest.mark.parametrize("unbuffered", [True, False])
def test_whoever_reads_no_further_is_told_nothing(unbuffered: bool) -> None:
    read, write = os.pipe()
    os.close(read)
    try:
        code, lines = highfive(write, "rig", "joints", unbuffered=unbuffered)
    finally:
        os.close(write)
    assert (code, lines) == (1, [])


@needs_full
@pytest.mark.slow(12)
def test_what_a_session_wrote_stays(tmp_path: Path) -> None:
    with FULL.open("w") as full:
        words = ("simulate", "--trials", "1", "--no-pictures", "--json", "--out", str(tmp_path / "session"))
        code, lines = highfive(full.fileno(), *words)
    assert code == 2 and lines[-1] == NO_ROOM and not any("Traceback" in line for line in lines)
    assert {"session.mcap", "report.html", "report.json"} <= {path.name for path in (tmp_path / "session").iterdir()}

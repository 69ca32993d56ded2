"""SIGTERM while a session prepares: the command is ended then and there, as by Ctrl-C, and leaves nothing behind."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from live_commands import HIGHFIVE, ended

from highfive.hil.commands.simulate import PREPARING
from highfive.hil.view import SHIPPED_RECORDING

SIMULATE = ("simulate", "--view", "--no-open", "--no-pictures", "--trials", "1")
PAGE, COMPILES = "open http", "compiles"


def said(process: subprocess.Popen[str], words: str) -> None:
    """Waits for a line."""
    assert process.stderr is not None
    lines = list[str]()
    while not lines or words not in lines[-1]:
        lines.append(process.stderr.readline())
        assert lines[-1], lines


def compiles(process: subprocess.Popen[str], cache: Path) -> None:
    """Waits until the first machine code is kept; most is still to come."""
    while not any(cache.rglob("*.nbi")):
        assert process.poll() is None
        time.sleep(0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "phase"),
    [
        (SIMULATE, PREPARING[:40]),  # the model is not there yet
        (SIMULATE, COMPILES),
        (SIMULATE, PAGE),
        ((*SIMULATE, "--rig", "emulated"), PAGE),  # the arm is ready; nobody has opened the page, for which it waits
        (("rig", "play", str(SHIPPED_RECORDING), "--view", "--no-open"), PAGE),
    ],
)
def test_it_is_obeyed_at_once_in_each_phase(words: tuple[str, ...], phase: str, tmp_path: Path) -> None:
    """Nothing but the last line follows: neither what the phase would have led to, nor a wait for somebody to come."""
    out, environment = tmp_path / "out", dict(os.environ)
    if phase == COMPILES:
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")
    process = subprocess.Popen(
        [*HIGHFIVE, *words, "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment,
    )  # fmt: skip
    if phase == COMPILES:
        compiles(process, tmp_path / "cache")
    else:
        said(process, phase)
    code, told, error = ended(process, signal.SIGTERM)
    assert (code, told) == (1, "") and error.splitlines()[-1] == "interrupted", error
    assert phase == PAGE or PAGE not in error
    assert not out.exists()

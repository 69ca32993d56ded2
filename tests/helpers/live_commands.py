"""The commands of the live bridge in processes of their own."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set

HIGHFIVE = [sys.executable, "-m", "highfive.hil.cli.main"]


def lab_recording(path: Path, frames: int = 240) -> Path:
    """A C3D file of someone who stands still (paper's markers) and of a partner with two markers."""
    paper = load_marker_set("paper")
    body = np.array([paper.segments[joint].centre for joint in paper.joints]) + paper.local_positions + [0.4, 0.2, 0.0]
    names = [*(f"human:{name}" for name in paper.names), "avatar:RFIN", "avatar:LFIN"]
    points = np.concatenate([body, [[-0.3, 0.2, 1.2], [-0.3, -0.4, 0.9]]]) + np.zeros((frames, 1, 1))
    write_c3d(path, make_recording(120.0, names, points, np.ones((frames, len(names)), dtype=bool)))
    return path


def start(*words: object) -> subprocess.Popen[str]:
    """Starts a command."""
    command = [*HIGHFIVE, *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ)


def serving(*words: object) -> tuple[subprocess.Popen[str], str, str]:
    """A server that is up, its address, and what it said about what it sends."""
    process = start("serve", *words)
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line.startswith("serving "), line + process.communicate()[1]
    return process, line.split()[1], process.stdout.readline()


def ended(process: subprocess.Popen[str], with_signal: int | None = None, within: float = 60.0) -> tuple[int, str, str]:
    """Exit code and output of a command, after a signal if one is given."""
    if with_signal is not None:
        process.send_signal(with_signal)
    try:
        out, err = process.communicate(timeout=within)
    except subprocess.TimeoutExpired:
        process.kill()
        raise
    assert "Traceback" not in err, err
    return process.returncode, out, err


def summary(address: str, *words: object) -> dict:
    """What ``highfive stream --json`` says."""
    code, out, err = ended(start("stream", address, "--json", *words))
    assert code == 0, err
    return json.loads(out)


def stop(process: subprocess.Popen[str]) -> None:
    """Ends a command for good, whatever state it is in."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=5.0)
        except subprocess.TimeoutExpired:
            process.kill()


def wait_for(path: Path, size: int, seconds: float = 15.0) -> bool:
    """Whether a file grows to a size in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if path.exists() and path.stat().st_size >= size:
            return True
        time.sleep(0.05)
    return False

"""Runs the published trackers of :mod:`highfive.hil.bench.tracking_baselines` in a process of their own."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.bench import tracking_baselines as tracking_peers
from highfive.hil.bench.tracker_cases import RATE_HZ, Case
from highfive.hil.bench.tracking_baseline_models import biorbd_text, opensim_text
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

PEERS = ("opensim", "biorbd")
SETTINGS: dict[str, dict[str, float]] = {"opensim": {"accuracy": 1e-5}, "biorbd": {"noise": 1e-10, "error": 1e-5}}
"""What each is given beside the model: as they come."""

_LONGEST_S = 1800.0


def installed(python: Path) -> dict[str, str]:
    """Peers that ``python`` can import, with their versions.

    Raises:
        HighFiveError: it cannot be run.
    """
    return json.loads(_run(python, ["--which"]).splitlines()[-1])


def follow(python: Path, method: str, case: Case, **settings: float) -> tuple[Array, Array]:
    """What a peer makes of a case: coordinates (T, n) of its model, and milliseconds per frame (T,).

    Raises:
        HighFiveError: it fails; the message has the last line that it said.
    """
    text = opensim_text(case.peer) if method == "opensim" else biorbd_text(case.peer)
    columns = case.marker_set.indices(case.peer.markers)
    points = np.where(case.seen[:, columns, None], case.measured[:, columns], np.nan)
    job: dict[str, Any] = {
        "method": method,
        "model": text,
        "names": np.array(case.peer.markers),
        "points": points,
        "rate_hz": RATE_HZ,
        "start": case.start,
        "soft": case.peer.unsteady,
        **SETTINGS[method],
        **settings,
    }
    with tempfile.TemporaryDirectory() as folder:
        given, got = Path(folder) / "job.npz", Path(folder) / "result.npz"
        np.savez(given, **job)
        _run(python, [str(given), str(got)])
        with np.load(got, allow_pickle=False) as result:
            return result["coordinates"], result["took_ms"]


def _run(python: Path, arguments: list[str]) -> str:
    command = [str(python), str(Path(tracking_peers.__file__)), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST_S, check=False)
    except OSError as error:
        raise HighFiveError(f"--peers-python {python} cannot be run: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise HighFiveError(f"--peers-python {python}: no answer within {_LONGEST_S:g} s") from None
    if done.returncode or (arguments == ["--which"] and not done.stdout.strip()):
        said = done.stderr.strip().splitlines()
        raise HighFiveError(f"--peers-python {python} failed: {said[-1] if said else f'code {done.returncode}'}")
    return done.stdout


HERE = Path(sys.executable)
"""The interpreter that runs this."""

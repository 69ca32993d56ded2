"""The first session of an installation, which compiles, is played again to the last bit by those that load."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow(125)
def test_the_session_that_compiles_is_played_again_to_the_last_bit(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "empty")}

    def simulate(*words: str) -> dict:
        command = [sys.executable, "-m", "highfive.hil.cli.main", "simulate", "--no-pictures", "--json", *words]
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    simulate("--trials", "1", "--out", "first")
    replayed = simulate("--source", "first/session.mcap", "--out", "again")["replayed"]
    assert replayed["ticks"] == replayed["same"] > 200 and replayed["differs"] == []

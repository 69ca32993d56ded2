"""A small capture that several tests look at."""

import json
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with angry high fives at all nine cells, one each, of seed 5; not to be written to."""
    folder = tmp_path_factory.mktemp("lab") / "captured"
    words = ["capture", "--emotion", "angry", "--repetitions", "1", "--seed", "5", "--out", str(folder), "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "highfive.hil.cli.main", *words], check=True, stdout=subprocess.PIPE, text=True
    )
    said = json.loads(done.stdout)
    assert said == {"trials": 9, "emotions": ["angry"], "seed": 5, "folder": str(folder), "simulated": True}
    return folder

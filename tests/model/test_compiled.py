"""Compiling is told when it happens, and only then."""

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
from model.compiled import compiled_entry, when_compiling

@compiled_entry
def doubled(x):
    return 2.0 * x

with when_compiling(lambda: print("compiling")):
    print(doubled(21.0), doubled(21))
"""


def test_what_is_only_loaded_is_not_told_as_compiled(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    environment = os.environ | {
        "PYTHONPATH": str(Path(__file__).parents[2]),
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
    }
    said = [
        subprocess.run(
            [sys.executable, str(program)], env=environment, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    assert said == ["compiling\n42.0 42.0\n", "42.0 42.0\n"]

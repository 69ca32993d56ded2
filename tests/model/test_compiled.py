import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from paths import ROOT

from highfive.model.compiled import compiled_entry


def made_from_text(text: str) -> Callable:
    """A function that stands in no file, so that there is no place beside it to store its machine code."""
    names: dict[str, Callable] = {}
    exec(compile(text, "<text>", "exec"), names)
    return names["function"]


def test_a_place_that_cannot_be_written_to_is_no_obstacle():
    function = compiled_entry(made_from_text("def function(x):\n    return 2.0 * x"))
    assert function(1.5) == 3.0


def test_infinity_and_not_a_number_keep_their_meaning():
    function = compiled_entry(made_from_text("def function(x):\n    return (x - x) * 0.0, 1.0 / (x - x)"))
    np.testing.assert_array_equal(function(np.inf), [np.nan, np.nan])
    np.testing.assert_array_equal(function(1.0), [0.0, np.inf])


PROGRAM = """
from highfive.model.compiled import compiled_entry, when_compiling

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
        "PYTHONPATH": str(ROOT),
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
    }
    said = [
        subprocess.run(
            [sys.executable, str(program)], env=environment, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    assert said == ["compiling\n42.0 42.0\n", "42.0 42.0\n"]
